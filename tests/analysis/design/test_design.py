from dataclasses import replace

import pytest

from chamfer.analysis.design.changes import FIELDS, changed, changes, smallest_change
from chamfer.analysis.design.design import Design, assess
from chamfer.analysis.design.design_scenario import DesignScenario, drawn_design, resolve_design
from chamfer.analysis.scenario.scenario_io import make_scenario
from chamfer.models.validation import ParameterError

USUAL = DesignScenario(draws=80, pictures=2)


def assessed(scenario: DesignScenario) -> Design:
    return assess(resolve_design(scenario))


def test_the_papers_cell_is_certain() -> None:
    found = assessed(USUAL)
    assert found.verdict == "certain"
    assert found.share == 1.0
    assert found.share_low > 0.95
    assert all(link.margin >= 0 for link in found.links)
    assert found.limiting_link != "settling"  # which is kept by design


def test_parts_too_tight_for_the_dead_zones_are_never_decided_for() -> None:
    parts = replace(USUAL.parts, peg_radius=0.01003, friction=0.6)
    found = assessed(replace(USUAL, step=0.00025, parts=parts))
    assert found.verdict == "no"
    assert found.share == 0.0
    settled = next(link for link in found.links if link.name == "settled.tilt")
    assert settled.margin < 0


def test_arms_too_stiff_for_the_largest_start_are_stopped_by_their_own_springs() -> None:
    stiff = changed(USUAL, "impedance.stiffness", 3000.0)
    found = assessed(stiff)
    start = next(link for link in found.links if link.name == "start.force")
    assert start.bound == pytest.approx(3000 * 0.01 * 2**0.5)
    assert start.margin < 0
    assert found.verdict == "likely"
    assert 0.1 < found.share < 0.5  # pi (15 N / 3000 N/m)^2 / (20 mm)^2 = 0.196


def test_parts_that_are_not_found_are_not_inserted() -> None:
    small = replace(
        USUAL,
        parts=replace(
            USUAL.parts,
            hole_radius=0.002,
            peg_radius=0.00195,
            outer_radius=0.0028,
            chamfer_width=0.0008,
            peg_length=0.012,
            hole_length=0.008,
        ),
        insert=replace(USUAL.insert, depth=0.007),
    )
    found = assessed(small)
    assert found.verdict == "no"
    assert found.limiting_link == "sight"


def test_draws_are_those_of_the_simulated_trials() -> None:
    scenario = resolve_design(replace(USUAL, spread=replace(USUAL.spread, cameras=0.5)))
    one, again, other = (drawn_design(scenario, 3, trial) for trial in (0, 0, 1))
    assert one == again != other
    assert one.initial_error != scenario.initial_error
    assert one.cameras.xz.true != scenario.cameras.xz.true
    assert one.compensator == scenario.compensator


@pytest.mark.slow
def test_what_makes_a_cell_certain_that_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    # What bears on it, what does not, and a width: each field takes a second.
    tried = ("impedance.stiffness", "spread.lateral", "insert.force_limit")
    other = ("parts.friction", "parts.chamfer_width")
    fields = [one for one in FIELDS if one.path in (*tried, *other)]
    assert len(fields) == 5
    monkeypatch.setattr("chamfer.analysis.design.changes.FIELDS", fields)
    stiff = changed(USUAL, "impedance.stiffness", 1300.0)
    assert assessed(stiff).limiting_link == "start.force"
    found = {one.path: one for one in changes(stiff)}
    stiffness, start = found["impedance.stiffness"], found["spread.lateral"]
    assert stiffness.sensitivity == pytest.approx(start.sensitivity, rel=0.05)
    assert stiffness.sensitivity < 0 < found["insert.force_limit"].sensitivity
    assert found["parts.friction"].sensitivity == 0.0
    # 15 N at a start of 10 mm in both planes.
    most = 15 / (0.01 * 2**0.5)
    assert 0.9 * most < known(stiffness.to) <= most
    smallest = smallest_change(tuple(found.values()))
    assert smallest is not None
    assert smallest.path in tried
    remade = make_scenario(stiff, settings=smallest.settings)
    assert remade == changed(stiff, smallest.path, known(smallest.to))
    assert assessed(remade).verdict == "certain"


def known(value: float | None) -> float:
    assert value is not None
    return value


def test_a_field_that_there_is_not_is_refused() -> None:
    with pytest.raises(ParameterError, match="path is 'nothing'"):
        changed(USUAL, "nothing", 1.0)


def test_fewer_draws_could_not_say_no() -> None:
    with pytest.raises(ParameterError, match="draws is 71, allowed: 72 to"):
        DesignScenario(draws=71)
