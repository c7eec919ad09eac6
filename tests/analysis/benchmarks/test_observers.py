import pytest

from chamfer.analysis.benchmarks import observers
from chamfer.analysis.benchmarks.observers import NEWTON, TARGETS, Updates, measure
from chamfer.analysis.benchmarks.report import Findings, document, summary_text, updates_text
from chamfer.analysis.benchmarks.targets import targets
from chamfer.analysis.surface.normal_trials import Contender, Slide
from chamfer.systems.estimation.normal_filter import ConstrainedFilter
from chamfer.systems.estimation.surface_observer import KINDS


@pytest.fixture
def timed(monkeypatch: pytest.MonkeyPatch) -> dict[str, object]:
    """What is timed, in order, with a cost that counts up; and how many updates were wanted."""
    seen: dict[str, object] = {"filters": [], "updates": set(), "slides": set()}

    def cost(one: Contender, on: Slide, *, up: object, updates: int) -> float:
        filters = seen["filters"]
        assert isinstance(filters, list)
        filters.append(one.filter)
        seen["updates"] |= {updates}  # type: ignore[operator]
        seen["slides"] |= {id(on)}  # type: ignore[operator]
        return 1e-5 * len(filters)

    monkeypatch.setattr(observers, "cost", cost)
    return seen


@pytest.mark.slow
def test_every_kind_is_timed_on_the_same_slide(timed: dict[str, object]) -> None:
    found = Updates()
    measure(found, updates=77)
    assert list(found.seconds) == [*KINDS, NEWTON]
    assert list(found.seconds.values()) == pytest.approx(
        [1e-5 * (i + 1) for i in range(len(KINDS) + 1)]
    )
    filters = timed["filters"]
    assert isinstance(filters, list)
    assert len(set(map(id, filters))) == len(KINDS) + 1
    assert timed["updates"] == {77}
    assert len(timed["slides"]) == 1  # type: ignore[arg-type]
    newton, thesis = filters[-1], filters[KINDS.index("thesis")]
    assert isinstance(newton, ConstrainedFilter)
    assert (newton._params.solver, thesis._params.solver) == ("newton", "closed_form")
    assert newton._params.gated == thesis._params.gated


@pytest.mark.slow
def test_an_update_takes_time() -> None:
    found = Updates()
    measure(found, updates=1)
    assert all(1e-7 < seconds < 1.0 for seconds in found.seconds.values())


def test_targets_are_put_beside_what_was_measured() -> None:
    found = Findings()
    found.updates.seconds |= {"thesis": 30e-6, "adaptive": 250e-6, NEWTON: 90e-6}
    asked = {
        target.text: target
        for target in targets(
            found.times, found.cold, found.real_time, found.updates, found.insertions
        )
    }
    thesis = asked["an update of the observer thesis, us"]
    adaptive = asked["an update of the observer adaptive, us"]
    assert (thesis.bound, thesis.measured) == (pytest.approx(40), pytest.approx(30))
    assert (adaptive.bound, adaptive.measured) == (pytest.approx(200), pytest.approx(250))
    assert (thesis.ok, adaptive.ok) == (True, False)
    assert document(found)["updates"]["seconds"]["thesis"] == 30e-6
    text = updates_text(found.updates)
    assert "|  30 |        1.00 |" in text
    assert "| 250 |        8.33 |" in text
    assert "an update of the observer adaptive, us" in summary_text(found)


def test_targets_are_of_what_is_timed() -> None:
    assert set(TARGETS) <= {*KINDS, NEWTON}
    nothing = Findings()
    asked = targets(
        nothing.times, nothing.cold, nothing.real_time, nothing.updates, nothing.insertions
    )
    missing = [one for one in asked if one.text.startswith("an update of")]
    assert len(missing) == len(TARGETS)
    assert all(one.measured is None and one.ok is None for one in missing)
