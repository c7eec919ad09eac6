import pytest

from chamfer.analysis.published import (
    fsm_visual_servoing,
    hybrid_force_position,
    sensorimotor_primitives,
)
from chamfer.analysis.published.rows import at_least, at_most, between, near, of
from chamfer.analysis.report.checks import Published

PAPERS = (fsm_visual_servoing, hybrid_force_position, sensorimotor_primitives)


@pytest.mark.parametrize("paper", PAPERS, ids=lambda paper: paper.__name__)
def test_every_value_has_a_source_and_none_is_given_twice(paper: object) -> None:
    values: tuple[Published, ...] = paper.PUBLISHED  # type: ignore[attr-defined]
    assert all(value.source for value in values)
    keys = [(value.experiment, value.metric, value.source) for value in values]
    assert len(keys) == len(set(keys))


def test_rows_are_calibrated_and_not_reached_unless_they_say_so() -> None:
    first, second, third, fourth = of(
        "e",
        near("m", 1.0, 0.25, "s", "section 1"),
        at_most("m", 2.0, "", "section 2", "why", otherwise="does_not_hold"),
        at_least("m", 3.0, "", "section 3", kind="predicted"),
        between("m", 4.0, 5.0, "", "section 4"),
    )
    assert first.bounds() == (0.75, 1.25)
    assert second.bounds() == (float("-inf"), 2.0)
    assert third.bounds() == (3.0, float("inf"))
    assert fourth.bounds() == (4.0, 5.0)
    assert (first.experiment, first.unit, first.kind) == ("e", "s", "calibrated")
    assert (second.otherwise, second.note, third.kind) == ("does_not_hold", "why", "predicted")
    assert third.otherwise == "not_reached"
