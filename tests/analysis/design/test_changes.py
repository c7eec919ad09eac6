from collections.abc import Callable
from dataclasses import replace

import pytest

import chamfer.analysis.design.changes as what_to_change
from chamfer.analysis.design.changes import CHOICES, FIELDS, Advice, Change, Pair, advise, size
from chamfer.analysis.design.design import Design, assess
from chamfer.analysis.design.design_scenario import FEWEST, DesignScenario, resolve_design
from chamfer.analysis.design.link import Link, at_least, at_most
from chamfer.analysis.scenario.scenario_io import make_scenario

USUAL = DesignScenario(draws=80, pictures=2)
Links = Callable[[DesignScenario], list[Link]]


def friction(scenario: DesignScenario) -> Link:
    return at_most("wedging", scenario.parts.friction, 0.3, "", "")


def push(scenario: DesignScenario) -> Link:
    return at_least("push", scenario.insert.push, 9.0, "N", "")


def cameras(scenario: DesignScenario) -> Link:
    return at_most("sight", scenario.cameras.pixel_size, 4e-4, "m", "")


def settled(scenario: DesignScenario) -> Link:
    return at_most("settled", 2.0 - (scenario.controller.kind == "pid"), 1.5, "", "")


def advised(
    monkeypatch: pytest.MonkeyPatch,
    *links: Callable[[DesignScenario], Link],
    fields: tuple[str, ...] = ("parts.friction", "insert.push"),
    most: float = 1.0,
) -> Advice:
    """Return the advice where the share is that of the links that are inside.

    With all draws it is most at the best.
    """

    def told(scenario: DesignScenario, seed: int = 0, *, draws: int = 200) -> Design:
        chain = tuple(link(scenario) for link in links)
        share = sum(link.margin >= 0 for link in chain) / len(chain)
        share = share if draws == FEWEST else min(share, most)
        verdict = "certain" if share == 1 else "likely"
        numbers = {"share": share, "share_low": share - 0.1, "share_high": share + 0.1}
        return Design(links=chain, verdict=verdict, draws=draws, **numbers)  # type: ignore[arg-type]

    monkeypatch.setattr(what_to_change, "assess", told)
    monkeypatch.setattr(what_to_change, "resolve_design", lambda scenario: scenario)
    monkeypatch.setattr(what_to_change, "FIELDS", {one: FIELDS[one] for one in fields})
    choices = {"controller.kind": CHOICES["controller.kind"]}
    monkeypatch.setattr(what_to_change, "CHOICES", choices)
    return advise(USUAL)


def test_nearest_value_that_is_certain_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    found = advised(monkeypatch, friction)
    change, *rest = found.changes
    assert change.path == "parts.friction"
    assert change.sensitivity == pytest.approx(-0.045 / 0.3)
    assert isinstance(change.to, float)
    assert 0.27 < change.to <= 0.3
    assert (change.best, change.share) == (change.to, 1.0)
    assert make_scenario(USUAL, settings=change.settings).parts.friction == change.to
    assert all(one.best is None and not one.sensitivity for one in rest)
    assert (found.smallest, found.pairs) == (change, ())


def test_two_where_none_is_certain_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    found = advised(monkeypatch, friction, push)
    *helpful, choice = found.changes
    assert [(one.to, one.share) for one in helpful] == [(None, 0.5)] * 2
    assert (choice.path, choice.best, choice.share) == ("controller.kind", None, None)
    (pair,) = found.pairs
    assert (pair.certain, pair.share) == (True, 1.0)
    made = make_scenario(USUAL, settings=pair.settings)
    assert friction(made).margin >= 0 <= push(made).margin
    assert found.smallest is pair
    assert size(pair) == pytest.approx(sum(map(size, helpful)))


def test_choice_is_a_change(monkeypatch: pytest.MonkeyPatch) -> None:
    found = advised(monkeypatch, settled)
    change = found.smallest
    assert isinstance(change, Change)
    assert (change.path, change.value, change.to) == ("controller.kind", "fsm", "pid")
    assert change.settings == ("controller.kind=pid",)
    assert change.sensitivity is None


def test_choice_and_number_are_paired(monkeypatch: pytest.MonkeyPatch) -> None:
    found = advised(monkeypatch, settled, friction)
    assert isinstance(found.smallest, Pair)
    assert "controller.kind=pid" in found.smallest.settings


def test_certain_with_few_draws_alone_is_not_certain(monkeypatch: pytest.MonkeyPatch) -> None:
    found = advised(monkeypatch, friction, settled, most=0.99)
    assert found.smallest is None
    assert [(one.certain, one.share) for one in found.pairs] == [(False, 0.99)]


def test_smaller_pixels_see_as_much(monkeypatch: pytest.MonkeyPatch) -> None:
    (change, *_) = advised(monkeypatch, cameras, fields=("cameras.pixel_size",)).changes
    made, usual = make_scenario(USUAL, settings=change.settings).cameras, USUAL.cameras
    assert made.pixel_size == change.to != usual.pixel_size
    for name in ("width", "height"):
        seen = getattr(usual, name) * usual.pixel_size
        assert getattr(made, name) * made.pixel_size == pytest.approx(seen, rel=0.01)


def test_base_from_which_the_arm_can_feed(monkeypatch: pytest.MonkeyPatch) -> None:
    choice, cell = CHOICES["peg.base.position"], resolve_design(USUAL)
    assert choice.others(cell) == []

    def posture(scenario: DesignScenario) -> list[Link]:
        x, _, z = scenario.peg.base.position
        return [at_least("posture", x, -0.65, "", ""), at_most("torque", z, -0.05, "", "")]

    monkeypatch.setattr(what_to_change, "path_links", posture)
    first, *others = choice.others(cell)
    assert first == "[-0.6, 0.0, -0.1]"
    assert len(others) == 3


def test_chamfers_where_there_are_none() -> None:
    others = CHOICES["parts.chamfer_width"].others
    bare = replace(USUAL, parts=replace(USUAL.parts, chamfer_width=0.0))
    assert others(resolve_design(USUAL)) == []
    assert others(resolve_design(bare))[0] == pytest.approx(0.05 * bare.parts.peg_radius)


@pytest.mark.slow
def test_force_of_the_start_is_mended_by_what_it_is_made_of(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tried = ("impedance.stiffness", "spread.lateral")
    fields = {one: FIELDS[one] for one in (*tried, "parts.friction")}
    monkeypatch.setattr(what_to_change, "FIELDS", fields)
    monkeypatch.setattr(what_to_change, "CHOICES", {})
    stiff = FIELDS["impedance.stiffness"].set(USUAL, 1300.0)
    found = advise(stiff)
    changes = {one.path: one for one in found.changes}
    stiffness, start = (changes[one] for one in tried)
    assert stiffness.sensitivity == pytest.approx(start.sensitivity, rel=0.05)
    assert changes["parts.friction"].sensitivity == 0.0
    most = 15 / (0.01 * 2**0.5)  # N/m: 15 N at a start of 10 mm in both planes
    assert isinstance(stiffness.to, float)
    assert 0.9 * most < stiffness.to <= most
    assert found.smallest is not None
    made = make_scenario(stiff, settings=found.smallest.settings)
    assert assess(resolve_design(made)).verdict == "certain"


@pytest.mark.slow
def test_a_tight_fit_goes_in_with_two_changes_or_with_pid(monkeypatch: pytest.MonkeyPatch) -> None:
    parts = {"peg_radius": 0.0063375, "hole_radius": 0.00635, "friction": 0.2}
    lengths = {"hole_length": 0.025, "chamfer_width": 0.0008, "peg_chamfer_share": 0.0}
    cell = DesignScenario()
    tight = replace(cell, parts=replace(cell.parts, **parts, **lengths))
    names = ("impedance.rotational_stiffness", "compensator.rotational.increment")
    monkeypatch.setattr(what_to_change, "FIELDS", {one: FIELDS[one] for one in names})
    monkeypatch.setattr(what_to_change, "CHOICES", {})
    found = advise(tight)
    assert [one.to for one in found.changes] == [None, None]
    both = ("impedance.rotational_stiffness=[20,20,20]", "compensator.rotational.increment=0.001")
    for settings in (both, ("controller.kind=pid",)):
        made = resolve_design(make_scenario(tight, settings=settings))
        assert assess(made).verdict == "certain"
