"""How the stability of a loop is told in a result."""

from chamfer.analysis.contact.contact_metrics import stability_metrics
from chamfer.diagrams.contact.hybrid_loop_stability import Stability


def test_a_stable_loop_has_no_growth_and_the_modes_with_least_margins() -> None:
    found = stability_metrics(Stability(1e-3, -2.0, 1.5, 0.004, "contact", "lost contact"))
    assert {name: metric.value for name, metric in found.items()} == {
        "loop.growth": 0.0,
        "loop.growth_contact": 0.0,
        "loop.gain_margin": 1.5,
        "loop.delay_margin": 0.004,
    }
    assert found["loop.growth"].note == ""
    assert found["loop.gain_margin"].note.endswith("contact")
    assert found["loop.delay_margin"].note.endswith("lost contact")


def test_growth_of_an_unstable_loop_is_told_with_where_it_is() -> None:
    found = stability_metrics(Stability(None, 4.9, None, None, "", ""))
    assert "loop.growth" not in found
    assert found["loop.growth_contact"].value == 4.9
    assert found["loop.growth_contact"].note.startswith("unstable in contact")
    assert found["loop.gain_margin"].value is None
    assert found["loop.delay_margin"].note == "none up to 10 periods"
