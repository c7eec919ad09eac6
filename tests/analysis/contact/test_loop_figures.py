"""What is said of a loop's stability, in metrics and below its figure."""

from chamfer.analysis.contact.contact_figures import note_stability
from chamfer.analysis.contact.contact_metrics import stability_metrics
from chamfer.analysis.drawing.figure_style import new_figure
from chamfer.analysis.scenario.experiment import Outcome
from chamfer.diagrams.contact.hybrid_loop_stability import Stability

FOUND = Stability(
    growth=1e-9,
    growth_contact=0.0,
    gain_margin=1.25,
    delay_margin=0.0031,
    least_gain="contact",
    least_delay="the approach's end",
)


def noted(found: Stability) -> str:
    figure = new_figure()
    note_stability(
        figure, Outcome(metrics=stability_metrics(found), traces={}, simulated_seconds=0.0)
    )
    return figure.get_supxlabel()


def test_a_stable_loop() -> None:
    metrics = stability_metrics(FOUND)
    assert {name: metric.value for name, metric in metrics.items()} == {
        "loop.growth": 0.0,
        "loop.growth_contact": 0.0,
        "loop.gain_margin": 1.25,
        "loop.delay_margin": 0.0031,
    }
    assert metrics["loop.delay_margin"].unit == "s"
    assert noted(FOUND) == (
        "linear loop: stable, gain margin 1.25, delay margin 3.1 ms (the approach's end)"
    )


def test_an_unstable_loop_is_said_to_be() -> None:
    grows = FOUND._replace(growth_contact=4.93, gain_margin=0.36, delay_margin=0.0)
    assert noted(grows).startswith("linear loop: unstable, grows at 4.93 1/s, gain margin 0.36")
    assert stability_metrics(grows)["loop.growth_contact"].note.startswith("unstable in contact")


def test_margins_that_are_not_found_and_a_loop_that_is_always_in_contact() -> None:
    found = FOUND._replace(growth=None, delay_margin=None, least_delay="")
    assert "loop.growth" not in stability_metrics(found)
    assert stability_metrics(found)["loop.delay_margin"].note == "none up to 10 periods"
    assert noted(found).endswith("no delay margin (none up to 10 periods)")


def test_without_metrics_nothing_is_noted() -> None:
    figure = new_figure()
    note_stability(figure, Outcome(metrics={}, traces={}, simulated_seconds=0.0))
    assert figure.get_supxlabel() == ""
