import numpy as np
import pytest

from chamfer.analysis.design.design_accuracy import DrawnDesignsScenario
from chamfer.models.validation import ParameterError


def test_sizes_lie_in_their_ranges_and_fill_them() -> None:
    scenario = DrawnDesignsScenario()
    sizes = [scenario.sizes(0, design) for design in range(200)]
    for name in sizes[0]:
        low, high = getattr(scenario, name)
        of = np.array([one[name] for one in sizes])
        assert low <= of.min() < low + 0.2 * (high - low), name
        assert high - 0.2 * (high - low) < of.max() <= high, name
    middle = np.median([one["stiffness"] for one in sizes])
    assert 500 < middle < 1000  # evenly in its logarithm: the root of 100 times 5000 is 707


def test_a_design_is_what_was_drawn_and_the_same_again() -> None:
    scenario = DrawnDesignsScenario(hole="fixture", duration=12.0, draws=77)
    for design in range(20):
        sizes, cell = scenario.sizes(3, design), scenario.drawn(3, design)
        assert cell == scenario.drawn(3, design)
        parts = cell.parts
        assert parts.hole_radius == pytest.approx(sizes["radius"])
        assert parts.clearance == pytest.approx(sizes["clearance"] * sizes["radius"])
        assert parts.friction == sizes["friction"]
        assert parts.peg_length / parts.hole_radius == pytest.approx(6.0, rel=0.01)
        assert cell.impedance.stiffness == (sizes["stiffness"],) * 3
        assert cell.cameras.width * cell.cameras.pixel_size == pytest.approx(0.16)
        assert (cell.hole.kind, cell.duration, cell.draws) == ("fixture", 12.0, 77)
        # A step doesn't cross the play, and is a whole part of the controllers' period.
        assert cell.insert.speed * cell.step <= 2 * parts.clearance
        assert cell.impedance.period / cell.step == pytest.approx(
            round(cell.impedance.period / cell.step)
        )
    assert scenario.drawn(4, 0) != scenario.drawn(3, 0)


@pytest.mark.parametrize(
    ("fields", "name"),
    [
        ({"designs": 0}, "designs"),
        ({"draws": 10}, "draws"),
        ({"radius": (0.01, 0.001)}, "radius"),
        ({"friction": (0.0, 0.5)}, "friction"),
        ({"clearance": (0.1, 1.5)}, "clearance"),
        ({"hole": "vice"}, "hole"),
        ({"duration": -1.0}, "duration"),
    ],
)
def test_what_is_not_allowed(fields: dict[str, object], name: str) -> None:
    with pytest.raises(ParameterError, match=f"^{name} is"):
        DrawnDesignsScenario(**fields)  # type: ignore[arg-type]
