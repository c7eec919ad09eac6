"""Cells of which the design once said what was not true, with what simulated insertions say."""

from importlib.metadata import PackageNotFoundError, distribution

import pytest

from chamfer.analysis.design.design import Verdict, assess
from chamfer.analysis.design.design_scenario import DesignScenario, resolve_design
from chamfer.analysis.scenario.scenario_io import make_scenario

SMALL = (
    *("parts.hole_radius=0.00153", "parts.peg_radius=0.0015", "parts.chamfer_width=0.0003"),
    *("parts.peg_length=0.012", "parts.hole_length=0.012", "parts.outer_radius=0.0021"),
    *("insert.depth=0.0085", "cameras.pixel_size=0.00015"),
    *("cameras.width=640", "cameras.height=480"),
)
ROBOTS = "cmeel.prefix/share/example-robot-data/robots"


def arm(path: str, base: str, *more: str) -> tuple[str, ...]:
    return (f"peg.model={path}", f"peg.base.position={base}", "hole.kind=fixture", *more)


def friction(joints: int) -> str:
    return f"peg.joint_friction={[0.1] * joints}"


KINOVA = "kinova_description/robots/kinova.urdf"
HAND = "peg.tool_frame=j2s6s200_end_effector"
PANDA = "panda_description/urdf/panda.urdf"


@pytest.mark.parametrize(
    ("settings", "verdict", "limit", "low", "high"),
    [
        # 3 of 4 are seated, the other does not align in time.
        (("parts.chamfer_width=0",), "likely", "settled.lateral", 0.45, 0.85),
        # A rim of 0.6 mm around the bore is lost from sight on the way in.
        (SMALL, "no", "sight.way", 0.0, 0.0),
        # 4 of 4, once the simulated wrists have their rotors.
        (("impedance.rotational_stiffness=[40,40,40]",), "certain", "range.lateral", 1.0, 1.0),
        # 0 of 4: the elbow gets straight.
        (arm(KINOVA, "[-0.8,0,0]", HAND, friction(6)), "no", "posture", 0.0, 0.0),
        (arm(KINOVA, "[-0.6,0,0]", HAND, friction(6)), "likely", "push", 0.9, 1.0),
        # 4 of 4.
        (
            arm(PANDA, "[-0.8,0,0]", "peg.tool_frame=panda_link8", friction(7)),
            "likely",
            "edge",
            0.9,
            1.0,
        ),
        # 0 of 4: by the file's friction of 1 N m most don't get to the mouth.
        (
            arm("xarm_description/urdf/xarm7.urdf", "[-0.6,0,-0.2]"),
            "likely",
            "settled.lateral",
            0.0,
            0.35,
        ),
    ],
    ids=["unchamfered", "3 mm", "stiff", "kinova", "kinova near", "panda", "xarm7"],
)
def test_what_was_said_wrong(
    settings: tuple[str, ...], verdict: Verdict, limit: str, low: float, high: float
) -> None:
    if settings[0].startswith("peg.model="):
        try:
            place = distribution("example-robot-data").locate_file(ROBOTS)
        except PackageNotFoundError:
            pytest.skip("example-robot-data is not installed: pip install 'chamfer[robots]'")
        settings = (settings[0].replace("=", f"={place}/"), *settings[1:])
    cell = resolve_design(make_scenario(DesignScenario(draws=100, pictures=2), settings=settings))
    found = assess(cell)
    assert (found.verdict, found.limiting_link) == (verdict, limit)
    assert low <= found.share <= high
    assert bool(found.warnings) == ("impedance.rotational_stiffness=[40,40,40]" in settings)
