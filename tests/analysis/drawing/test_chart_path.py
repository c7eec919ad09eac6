import re
from itertools import pairwise

import pytest

from chamfer.analysis.drawing.chart_graph import state_id
from chamfer.analysis.drawing.chart_path import Row, path_rows, plot_chart_path
from chamfer.analysis.scenario.experiment import Table
from chamfer.analysis.skills.skill_run import SkillStep, path_table
from chamfer.systems.statechart.chart import Chart, State, Transition

# An insertion: of each state what it leads to, and else it retracts.
_FIRST = ("reach", "close in", "grasp", "lift", "transport", "approach")
_BEFORE = {name: {"done": then} for name, then in pairwise(_FIRST)}
_WAYS = {
    "approach": {"contact": "level"},
    "level": {
        "done": "search",
        "lost, 6 times at most": "shift",
        "timed out, 6 times at most": "shift",
    },
    "shift": {"done": "approach"},
    "search": {"lost": "push", "done": "push"},
    "push": {
        "done": "verify",
        "jammed, 3 times at most": "back off",
        "jammed again, 3 times at most": "shift",
    },
    "back off": {"done": "push"},
    "verify": {"hindered": "done"},
}


def insertion(before: dict[str, dict[str, str]]) -> Chart[None, None]:
    ways = {name: one | {"otherwise": "retract"} for name, one in (before | _WAYS).items()}
    ways["retract"] = {"over": "failed"}
    return Chart(
        "D connector",
        states=[
            *(State(name=name) for name in ways),
            State(name="done", outcome="done"),
            State(name="failed", outcome="failed"),
        ],
        transitions=[
            Transition(source=source, target=target, label=label, guard=lambda _: True)
            for source, found in ways.items()
            for label, target in found.items()
        ],
        memory=None,
    )


WHOLE = insertion(_BEFORE)
SHORT = insertion({})


def path(*steps: tuple[str, str, str]) -> Table:
    return path_table(
        [
            SkillStep(0.5 * i, source, target, label.partition(",")[0], label)
            for i, (source, target, label) in enumerate(steps)
        ]
    )


TRIED = path(
    ("approach", "level", "contact"),
    ("level", "shift", "lost, 6 times at most"),
    ("shift", "approach", "done"),
    ("approach", "level", "contact"),
    ("level", "retract", "otherwise"),
    ("retract", "failed", "over"),
)


def routes(rows: list[Row]) -> dict[tuple[str, str, str], tuple[int, ...]]:
    found = {}
    for route in (route for row in rows for route in row.layout.routes):
        label, _, numbers = route.edge.label.partition("\n")
        steps = tuple(map(int, re.findall(r"\d+", numbers)))
        found[route.edge.source, route.edge.target, label] = steps
    return found


def test_every_step_is_numbered_once_along_its_transition() -> None:
    found = routes(path_rows(SHORT, TRIED))
    taken = {key: steps for key, steps in found.items() if steps}
    assert taken == {
        (state_id("approach"), state_id("level"), "contact"): (1, 4),
        (state_id("level"), state_id("shift"), "lost"): (2,),
        (state_id("shift"), state_id("approach"), "done"): (3,),
        (state_id("level"), state_id("retract"), "otherwise"): (5,),
        (state_id("retract"), state_id("failed"), "over"): (6,),
    }
    # The same way for another reason was not taken.
    assert found[state_id("level"), state_id("shift"), "timed out"] == ()


def test_failure_is_drawn_only_where_it_was_taken() -> None:
    rows = path_rows(SHORT, path(("approach", "level", "contact")))
    ends = {end for source, target, _ in routes(rows) for end in (source, target)}
    assert state_id("retract") not in ends
    assert state_id("failed") not in ends
    assert {state_id(name) for name in ("search", "push", "verify", "done")} <= ends
    otherwise = [key for key in routes(path_rows(SHORT, TRIED)) if key[2] == "otherwise"]
    assert otherwise == [(state_id("level"), state_id("retract"), "otherwise")]


def test_a_long_chart_is_cut_where_a_single_transition_leads_on() -> None:
    first, second = path_rows(WHOLE, path(("transport", "approach", "done")))
    assert len(path_rows(SHORT, TRIED)) == 1
    labels = [[box.node.label for box in row.layout.boxes] for row in (first, second)]
    assert labels[0][-1] == "approach"  # where it goes on
    assert "approach" in labels[1]
    assert "transport" not in labels[1]
    assert (1,) in routes([first]).values()
    assert (1,) not in routes([second]).values()
    assert max(row.layout.width for row in (first, second)) < 1600


def test_a_run_that_took_no_step_has_a_figure() -> None:
    figure = plot_chart_path(SHORT, path(), result="failed: approach: still running")
    texts = [text.get_text() for text in figure.axes[0].texts]
    assert "1" not in texts


def test_a_chart_with_a_loop_of_its_own_and_timeouts() -> None:
    chart: Chart[None, None] = Chart(
        "toy",
        states=[
            State(name="a", timeout=1.0, on_timeout="b"),
            State(name="b"),
            State(name="done", outcome="done"),
        ],
        transitions=[
            Transition(source="a", target="a", label="again", guard=lambda _: True),
            Transition(source="b", target="done", label="over", guard=lambda _: True),
        ],
        memory=None,
    )
    (row,) = path_rows(chart, path(("a", "a", "again"), ("b", "done", "over")))
    assert sorted(routes([row]).values()) == [(), (), (1,), (2,)]


def test_given_rows_end_where_they_lead_on() -> None:
    rows = [["approach", "level"], ["retract", "failed"], ["shift", "search", "push", "verify"]]
    found = path_rows(SHORT, TRIED, rows=[*rows, ["done"]], seldom=("push",))
    labels = [{box.node.label for box in row.layout.boxes} - {""} for row in found]
    assert labels[0] == {"approach", "level", "retract", "shift", "search"}
    assert labels[1] == {"retract", "failed"}
    assert "push" not in {one for row in labels for one in row}
    numbers = sorted(number for steps in routes(found).values() for number in steps)
    assert numbers == [1, 2, 3, 4, 5, 6]
    # Of a row that the run came to the arrow into it is taken, of another one not.
    assert [
        next(
            taken
            for route, taken in zip(row.layout.routes, row.taken, strict=True)
            if route.edge.source == "start"
        )
        for row in found
    ] == [True, True, True, False]


@pytest.mark.parametrize(("most", "shown"), [(None, "[1,3,5]"), (2, "[1...5]")])
def test_of_many_numbers_the_first_and_the_last_are_drawn(most: int | None, shown: str) -> None:
    steps = [("approach", "level", "contact"), ("level", "approach", "lost")] * 3
    (row,) = path_rows(SHORT, path(*steps), most=most)
    assert ("contact", shown) in [label.text.lines for label in row.layout.labels]
