"""A chart as SCXML goes through the same states as the law that raises its events."""

from typing import Any
from xml.etree import ElementTree

import pytest
from statemachine.io.scxml.processor import SCXMLProcessor

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.command.running import prepare
from chamfer.analysis.export.scxml import event, scxml, state_ids
from chamfer.analysis.scenario.experiment import quiet, select
from chamfer.systems.statechart.chart import ANY, Chart, State, Transition, TransitionRecord
from chamfer.systems.statechart.chart_law import ChartLaw


@pytest.mark.parametrize(
    ("experiment", "name"),
    [
        ("step-response", "trajectory compensator"),
        ("insertion", "insertion"),
        ("crucible-charging", "charging"),
        pytest.param("d-connector", "D connector", marks=pytest.mark.slow),
    ],
)
def test_an_engine_goes_through_the_states_of_a_run(
    experiment: str, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    update, steps = ChartLaw.update, list[tuple[Any, Any, Any]]()

    def told(law: Any, state: Any, *others: Any) -> Any:
        after = update(law, state, *others)
        if law.chart.name == name and (not steps or law is steps[0][0]):
            steps.append((law, state, after))
        return after

    monkeypatch.setattr(ChartLaw, "update", told)
    (entry,) = select(CATALOGUE.entries, [experiment])
    (job,) = prepare([entry], settings=entry.reduced)
    job.experiment.run(job.scenario, 0, quiet)
    chart: Chart[Any, Any] = steps[0][0].chart
    processor, ids = SCXMLProcessor(), state_ids(chart)
    processor.parse_scxml(chart.name, scxml(chart))
    engine = processor.start()
    for _, before, after in steps:
        if len(after.log) > len(before.log):
            engine.send(event(chart, after.log[-1]))
        assert [one.id for one in engine.configuration] == [ids[after.snapshot.state]]
    assert len(after.log) > 1
    if not engine.is_terminated:
        engine.send("abort")
        assert [one.id for one in engine.configuration] == [ids[chart.on_abort]]


def test_a_document_has_every_way_in_its_order_and_names_tell_them_apart() -> None:
    def way(source: str, target: str, label: str) -> Transition[Any, Any]:
        return Transition(source=source, target=target, label=label, guard=lambda _: False)

    chart: Chart[Any, Any] = Chart(
        "two words",
        states=[
            State(name="far away", timeout=2.0, on_timeout="gave up"),
            State(name="near.by"),
            State(name="gave up", outcome="failed"),
        ],
        transitions=[
            way("far away", "near.by", "force > 5 N"),
            way("near.by", "near.by", "force <= 5 N"),
            way(ANY, "gave up", "operator's halt"),
            way("near.by", "far away", "operator's halt"),
            way(ANY, "near.by", "Timed out"),
        ],
        memory=None,
    )
    far, near, gave_up = ElementTree.fromstring(scxml(chart))
    assert [f"{one.get('event')} {one.get('target')}" for one in (*far, *near)] == [
        "abort gave_up",
        "force-above-5-n near.by",
        "operators-halt gave_up",
        "timed-out-to-near-by near.by",
        "timed-out-to-gave-up gave_up",
        "abort gave_up",
        "force-at-most-5-n near.by",
        "operators-halt-to-gave-up gave_up",
        "operators-halt-to-far-away far_away",
    ]
    assert (gave_up.tag, len(gave_up)) == ("{http://www.w3.org/2005/07/scxml}final", 0)
    left = TransitionRecord(2.0, "far away", "gave up", "after 2 s", None, ())
    assert event(chart, left) == "timed-out-to-gave-up"


def test_no_document_of_the_catalogue_has_an_expression_or_an_ambiguous_event() -> None:
    jobs = prepare([entry for entry in CATALOGUE.entries if entry.charts])
    charts = [chart for job in jobs for chart in (job.experiment.charts or list)(job.scenario)]
    for document, chart in {scxml(chart): chart for chart in charts}.items():
        root = ElementTree.fromstring(document)
        assert len({state.get("id") for state in root}) == len(chart.states)
        for state in root:
            ways = {way.get("event") for way in state if set(way.attrib) == {"event", "target"}}
            assert len(ways) == len(state), (chart.name, state.get("id"))
