from itertools import pairwise

from matplotlib.figure import Figure

from chamfer.analysis.drawing.chart_path import plot_chart_path
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


def texts(figure: Figure) -> list[str]:
    return [text.get_text().replace("\n", " ") for text in figure.axes[0].texts]


def test_visited_states_are_in_order_with_times_and_transitions() -> None:
    said = texts(plot_chart_path(SHORT, TRIED, result="failed"))
    states = ["approach", "level", "shift", "retract", "failed"]
    assert [one for one in said if one in states] == states
    assert "push" not in said
    assert "0.00 s, 2 visits" in said  # of approach
    assert "contact \N{MULTIPLICATION SIGN}2" in said
    assert any("shift to approach (done); level to retract (otherwise)" in one for one in said)
    assert "Untaken transitions are hidden." in said


def test_the_figure_fits_a_page() -> None:
    names = [f"s{i}" for i in range(30)]
    chain = [(a, b, "on") for a, b in pairwise(names)]
    chart: Chart[None, None] = Chart(
        "long",
        states=[*(State(name=name) for name in names[:-1]), State(name="s29", outcome="done")],
        transitions=[
            Transition(source=a, target=b, label=label, guard=lambda _: True)
            for a, b, label in chain
        ],
        memory=None,
    )
    figure = plot_chart_path(chart, path(*chain), result="done")
    assert figure.get_figwidth() == 8
    assert min(float(text.get_fontsize()) for text in figure.axes[0].texts) >= 8


def test_a_run_that_took_no_step_has_a_figure() -> None:
    figure = plot_chart_path(SHORT, path(), result="failed: approach: still running")
    assert texts(figure)[2:4] == ["approach", "0.00 s"]
