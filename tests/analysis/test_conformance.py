"""What holds for every experiment, asked of a run at its reduced size."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree

import numpy as np
import pytest
from docs._ext.svg_text import LEAST, PAGE
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.command.controllers import LOG, controllers, log_files
from chamfer.analysis.command.running import Job, draw, prepare
from chamfer.analysis.replay.replay import replay_logs
from chamfer.analysis.report.checks import check, load_paper
from chamfer.analysis.report.results import defined_metrics
from chamfer.analysis.report.traces import write_table
from chamfer.analysis.scenario.experiment import Entry, Experiment, Metric, Outcome, Table
from chamfer.analysis.scenario.scenario_io import make_scenario, scenario_text, unstructure
from chamfer.systems.recording import Recorder, recording

# friction-remedies: so it is with the full dynamics, as in the thesis.
pytestmark = pytest.mark.filterwarnings(
    "ignore:the loop is unstable in contact, sliding ahead", "ignore:task.force is"
)
ENTRIES: Final = CATALOGUE.entries
# What figures show that has no unit.
PURE_NUMBERS: Final = {
    *("C", "CENIC's accuracy", "N, cycles until the pattern repeats", "approximation"),
    *(
        "damping ratio",
        "element",
        "facets",
        "friction",
        "imaginary part",
        "impact",
        "level",
        "real part",
    ),
    *("joints", "pixels", "points of contact", "retries", "runs", "trials"),
}
UNITS: Final = {
    *("", "%", "1/(kg m^2)", "1/m", "1/s", "J", "N", "N m", "N s/m", "N/m", "deg", "kg", "m"),
    *("m/(pixel s)", "m/pixel", "m/rad", "m/s", "pixels", "px"),
    *("rad", "rad/m", "rad/pixel", "rad/s", "s", "s/m", "us"),
}
# Modes, remedies, ways and recordings that the reduced runs leave out.
LEFT_OUT: Final = {
    *("table_a", "table_b", "free"),
    *("crown", "bulk", "decoupling", "compensation", "soft_gripper", "all"),
    *("wait", "frozen_wait", "no_observer", "compliance"),
}
# Their loops have laws whose parameters are drawn for each trial, or none.
NOT_LOGGED: Final = {
    *("jamming-diagram", "peg-insertion", "wedging-diagram", "insertion-map", "lissajous"),
    "compliance-centre",
    *("plant-identification", "camera-accuracy", "detection-conditions", "repeatability"),
    "hand-camera",
    *("design-accuracy", "insertion-repeatability", "calibration-accuracy", "hybrid-stability"),
    *("contact-convergence", "contact-stability", "friction-remedies", "search-capture"),
    *("observer-model-error", "charging-campaign", "observer-comparison", "scaling"),
    *("measured-slide", "measured-toss", "sensing-sensitivity", "vision-primitives"),
    *("peg-skill-success", "d-connector-success", "bnc-connector-success"),
    *("rj45-connector-success", "d-connector-ablation", "bnc-connector-ablation"),
}
# Of the others two runs take seconds, or they run with other values what one of these does.
QUICK: Final = {
    "adept-unknown-wall",
    "calibration-accuracy",
    "charging-campaign",
    "compliance-centre",
    "correlation",
    "jamming-diagram",
    "lissajous",
    "peg-insertion",
    "planar-hold",
    "planar-slide",
    "plant-identification",
    "servo-comparison",
    "skill",
    "step-response",
    "surface-estimation",
    "unknown-surface-control",
    "unknown-surface-control-adaptive",
}


@dataclass(frozen=True, kw_only=True)
class Ran:
    """An experiment's reduced run."""

    job: Job
    outcome: Outcome
    recorder: Recorder
    progress: list[tuple[float, str]]
    figures: Mapping[str, Figure]

    @property
    def experiment(self) -> Experiment[Any]:
        return self.job.experiment


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(entry, id=entry.name, marks=[] if entry.name in QUICK else [pytest.mark.slow])
        for entry in ENTRIES
    ],
)
def ran(request: pytest.FixtureRequest) -> Ran:
    entry: Entry = request.param
    (job,) = prepare([entry], settings=entry.reduced)
    told: list[tuple[float, str]] = []
    with recording(recorder := Recorder()):
        outcome = job.experiment.run(
            job.scenario, 0, lambda fraction, doing="": told.append((fraction, doing))
        )
    figures = job.experiment.plot(job.scenario, outcome)
    for figure in figures.values():
        figure.draw_without_rendering()
    return Ran(job=job, outcome=outcome, recorder=recorder, progress=told, figures=figures)


def test_the_catalogue_says_what_it_is(ran: Ran) -> None:
    entry = ran.job.entry
    assert re.fullmatch(r"\S.{10,90}[^\s.]", entry.summary)
    assert re.fullmatch(r"(Figs?\. |eq\. |section )\S.*|", entry.figure)
    assert ran.job.paper.title != entry.paper  # it has a module of its published values


def test_a_resolved_scenario_comes_back_from_disk(ran: Ran, tmp_path: Path) -> None:
    default, scenario = ran.experiment.default, ran.job.scenario
    given = make_scenario(default, given=unstructure(scenario))
    assert ran.experiment.resolve(given) == scenario
    path = tmp_path / "scenario.yaml"
    path.write_text(scenario_text(scenario), encoding="utf-8")
    (job,) = prepare([ran.job.entry], file=path)
    assert job.scenario == scenario
    assert job.overrides == ran.job.overrides


def test_every_published_value_is_measured(ran: Ran) -> None:
    metrics = defined_metrics(ran.outcome.metrics)
    published = ran.job.published
    checks = check(published, metrics)
    for one in checks:
        assert one.published.unit == metrics[one.published.metric].unit, one.published.metric
    asked = {one.metric for one in published} - {one.published.metric for one in checks}
    assert {name.partition(".")[0] for name in asked} <= LEFT_OUT


@pytest.mark.parametrize("paper", sorted({entry.paper for entry in ENTRIES}))
def test_every_published_value_belongs_to_an_experiment(paper: str) -> None:
    known = {entry.name for entry in ENTRIES if entry.paper == paper}
    asked = [
        (one.experiment, one.metric, one.relation)
        for one in load_paper(paper, CATALOGUE).published
    ]
    assert {experiment for experiment, *_ in asked} <= known
    assert len(set(asked)) == len(asked)


def test_metrics_are_finite_or_say_why_not(ran: Ran) -> None:
    assert ran.outcome.metrics
    for name, metric in ran.outcome.metrics.items():
        assert re.fullmatch(r"[a-z0-9_-]+(\.[a-z0-9_-]+)*", name), name
        assert metric.unit in UNITS, name
        assert metric.note or _finite(metric), name
    assert any(map(_finite, ran.outcome.metrics.values()))
    assert 0 <= ran.outcome.simulated_seconds < np.inf


def test_tables_can_be_written(ran: Ran, tmp_path: Path) -> None:
    for name, table in _tables(ran.outcome).items():
        write_table(tmp_path / name, table)  # columns of equal length without infinities
        assert all(len(values) for values in table.values()), name
    time = ran.outcome.traces.get("time")
    if time is not None and next(iter(ran.outcome.traces)) == "time":
        assert np.all(np.diff(time) > 0)


def test_progress_goes_on_to_the_end(ran: Ran) -> None:
    fractions = [fraction for fraction, _ in ran.progress]
    assert fractions
    assert fractions == sorted(fractions)
    assert fractions[0] >= 0
    assert fractions[-1] <= 1
    assert all(len(doing) < 40 for _, doing in ran.progress)


def test_the_same_seed_gives_the_same_bytes_recorded_or_not(ran: Ran) -> None:
    def run() -> Outcome:
        return ran.experiment.run(ran.job.scenario, 0, lambda fraction, doing="": None)

    first, again = ran.outcome, run()
    if ran.job.entry.name.startswith("unknown-surface-control"):
        # Recorded laws run in the diagram, where Drake rounds the manipulator's matrices its own
        # way; without noise nees is rounding over rounding.
        for key, values in first.traces.items():
            if key != "nees":
                np.testing.assert_allclose(
                    again.traces[key], values, rtol=1e-9, atol=1e-9, err_msg=key
                )
        for name, metric in _lasting(first).items():
            if name != "nees":
                assert _lasting(again)[name].value == pytest.approx(metric.value, abs=1e-9)
        first = run()
    tables, others = _tables(first), _tables(again)
    assert list(tables) == list(others)
    for name, table in tables.items():
        assert {key: np.asarray(values).tobytes() for key, values in table.items()} == {
            key: np.asarray(values).tobytes() for key, values in others[name].items()
        }
    assert _lasting(first) == _lasting(again)


def test_controllers_would_do_the_same_again(ran: Ran, tmp_path: Path) -> None:
    known = controllers(ran.experiment, ran.job.scenario)
    runs = {path: each for path, each in ran.recorder.runs.items() if path in known}
    assert bool(runs) != (ran.job.entry.name in NOT_LOGGED)
    (tmp_path / LOG).mkdir()
    about = {"experiment": ran.job.entry.name, "overrides": list(ran.job.overrides)}
    for name, content in log_files(runs, about).items():
        (tmp_path / name).write_bytes(content)
    if runs:
        document, found = replay_logs(ran.job.entry, tmp_path / LOG)
        assert len(found) == sum(map(len, runs.values()))
        assert [one for one in document["controllers"] if one["mismatches"] != 0] == []


def test_drawings_are_drawn(ran: Ran) -> None:
    drawings = draw(ran.job)
    assert ("diagram.svg" in drawings) == (ran.experiment.diagram is not None)
    assert any(name.startswith("chart-") for name in drawings) == (
        ran.experiment.charts is not None
    )
    for name, text in drawings.items():
        assert text
        if name.endswith(".svg"):
            assert ElementTree.fromstring(text).tag.endswith("svg")


def test_every_axis_says_what_it_shows_and_in_which_unit(ran: Ran) -> None:
    assert ran.figures
    others = {entry.name for entry in ENTRIES} - {ran.job.entry.name}
    assert not others & set(ran.figures)
    for name, figure in ran.figures.items():
        assert re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)*", name)
        for axes in filter(lambda axes: axes.axison, figure.axes):
            for which in ("x", "y"):
                label = _label(axes, which)
                assert label or _in_words(axes, which), (name, which, _title(axes))
                shown = label in PURE_NUMBERS or re.search(r"\S( / |\n)\S", label)
                assert not label or shown, (name, label)


def test_several_curves_are_told_apart_by_a_legend(ran: Ran) -> None:
    for name, figure in ran.figures.items():
        told = [text.get_text() for legend in _legends(figure) for text in legend.get_texts()]
        for axes in figure.axes:
            curves = axes.get_legend_handles_labels()[1]
            # A legend may say more than the label; one curve without is what the title says.
            untold = {one for one in curves if not any(text.startswith(one) for text in told)}
            assert len(untold) < 2, (name, _title(axes))


def test_titles_lie_side_by_side_in_the_figure(ran: Ran) -> None:
    for name, figure in ran.figures.items():
        boxes = [axes._left_title.get_window_extent() for axes in figure.axes if _title(axes)]
        for i, box in enumerate(boxes):
            assert box.x1 <= figure.bbox.width + 1, name
            assert box.y1 <= figure.bbox.height + 1, name
            assert not any(box.overlaps(other) for other in boxes[:i]), name


def test_figures_fit_a_page_and_have_captions(ran: Ran) -> None:
    for name, figure in ran.figures.items():
        width = 96 * figure.get_figwidth()
        assert width <= 96 * 8, name
        texts = [one for one in figure.findobj(Text) if one.get_visible() and one.get_text()]
        least = min(texts, key=lambda text: text.get_fontsize())
        size = least.get_fontsize() / 72 * 96 * min(1.0, PAGE / width)
        assert size >= LEAST, (name, least)
        caption, *titles = str(figure.get_label()), *map(_title, figure.axes)
        assert re.fullmatch(r"[A-Z0-9].{20,300}[.]", caption), name
        assert not re.search(r"\bnan\b|\binf\b|None ", " ".join([caption, *titles])), name


def _finite(metric: Metric) -> bool:
    return metric.value is not None and bool(np.isfinite(metric.value))


def _tables(outcome: Outcome) -> dict[str, Table]:
    return {"traces": outcome.traces, **outcome.tables}


def _lasting(outcome: Outcome) -> dict[str, Metric]:
    """Return the metrics that don't depend on the machine."""
    clocks = ("real_time_factor", "cost", "cost_slope")
    return {
        name: metric
        for name, metric in outcome.metrics.items()
        if name.rpartition(".")[2] not in clocks
    }


def _title(axes: Axes) -> str:
    return axes.get_title(loc="left")


def _legends(figure: Figure) -> Iterator[Any]:
    yield from figure.legends
    for part in figure.subfigs:
        yield from part.legends
    yield from filter(None, (axes.get_legend() for axes in figure.axes))


def _label(axes: Axes, which: str) -> str:
    """Return an axis' label, or that of the axes in the same column or row if it has none."""
    there = axes.get_subplotspec()
    label: str = getattr(axes, f"get_{which}label")()
    if label or there is None:
        return label
    span = "colspan" if which == "x" else "rowspan"
    for other in axes.get_figure().axes:
        place = other.get_subplotspec()
        if place is not None and place.get_gridspec() is there.get_gridspec():
            beside = getattr(place, span) == getattr(there, span)
            label = getattr(other, f"get_{which}label")()
            if beside and label:
                return label
    return ""


def _in_words(axes: Axes, which: str) -> bool:
    """Return whether an axis has names for ticks, or is but the scale of a bar of colours."""
    ticks = [text.get_text() for text in getattr(axes, f"get_{which}ticklabels")()]
    return not any(re.fullmatch(r"\W?[\d.]+", text) for text in ticks)
