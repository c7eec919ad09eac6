"""Insertions in Drake against exact statics, and what is measured of them."""

import math
from dataclasses import replace

import numpy as np
import pytest

from chamfer.analysis.insertion.insertion_runs import (
    Insertion,
    insert,
    insert_by_cenic,
    is_seated,
    measure,
    predict,
)
from chamfer.analysis.scenario.experiment import Metric
from chamfer.diagrams.insertion.peg_insertion import (
    CarriageSupport,
    PegInsertionScenario,
    resolve_peg_insertion,
)
from chamfer.models.peg.peg_and_hole import PegAndHole
from chamfer.systems.contact.peg_hole_contact_monitor import ContactState

# The reference's single peg on a spring.
SPRUNG = resolve_peg_insertion(
    PegInsertionScenario(
        parts=PegAndHole(
            hole_radius=0.0052,
            peg_radius=0.005,
            friction=0.3,
            chamfer_width=0.001,
            outer_radius=0.012,
        ),
        support=CarriageSupport(
            lateral_stiffness=521.7, angular_stiffness=1.5, centre_distance=0.04
        ),
        lateral=0.0,
        speed=0.03,
        depth=0.011,
        gap=0.002,
    )
)


def at(degrees: float, lateral: float = 0.0) -> PegInsertionScenario:
    return replace(SPRUNG, lateral=lateral, tilt=math.radians(degrees))


def value(metrics: dict[str, Metric], name: str) -> float:
    found = metrics[name].value
    assert found is not None, name
    return found


@pytest.mark.parametrize(("degrees", "lateral", "force"), [(5.0, 0.0, 8.3), (5.0, 0.001, 10.6)])
def test_peak_and_onset_are_those_of_exact_statics(
    degrees: float, lateral: float, force: float
) -> None:
    """The targets: onset within 0.1 mm of the closed form, peak within 6 % of the statics."""
    scenario = at(degrees, lateral)
    metrics = measure(scenario, insert(scenario))
    assert value(metrics, "seated") == value(metrics, "predicted.seated") == 1.0
    peak = value(metrics, "force.axial")
    assert peak == pytest.approx(value(metrics, "predicted.force.axial"), rel=0.03)
    assert peak == pytest.approx(force, rel=0.03)
    assert value(metrics, "force.lateral") == pytest.approx(
        value(metrics, "predicted.force.lateral"), rel=0.05
    )
    onset = value(metrics, "two_point.onset")
    assert onset == pytest.approx(value(metrics, "predicted.two_point.onset"), abs=1e-4)
    assert onset == pytest.approx(value(metrics, "predicted.simple.two_point.onset"), abs=1e-4)
    lost, work = value(metrics, "energy.dissipated"), value(metrics, "energy.work")
    assert lost == pytest.approx(work, rel=0.02)
    assert metrics["pull_out.force"].note == "it is in"


def test_a_peg_that_no_push_slides_is_held_at_the_cap_and_without_it() -> None:
    scenario = replace(at(9.0), speed=0.06, step=0.002)
    metrics = measure(scenario, insert(scenario))
    assert [value(metrics, name) for name in ("seated", "wedged", "jammed", "missed")] == [
        *(0.0, 1.0, 0.0, 0.0)
    ]
    assert value(metrics, "force.axial") == pytest.approx(scenario.force_cap, rel=0.01)
    assert 0.5 < value(metrics, "pull_out.force") < 10.0
    assert "40 N" in metrics["wedged"].note
    assert value(metrics, "predicted.seated") == 0.0
    assert metrics["predicted.force.axial"].value is None


@pytest.mark.parametrize("lateral", [0.003, 0.03])  # m, on the face, and beside the whole part
def test_a_peg_beside_the_mouth_misses(lateral: float) -> None:
    scenario = replace(at(0.0, lateral), speed=0.1, step=0.002, force_cap=10.0)
    metrics = measure(scenario, insert(scenario))
    assert (value(metrics, "missed"), value(metrics, "seated")) == (1.0, 0.0)
    assert value(metrics, "wedged") == value(metrics, "jammed") == 0.0
    assert value(metrics, "predicted.seated") == 0.0
    assert metrics["predicted.force.axial"].note == "it does not enter"


def test_on_the_bottom_it_is_seated() -> None:
    blind = replace(
        SPRUNG,
        parts=replace(SPRUNG.parts, bore_depth=0.006),
        tilt=0.0,
        speed=0.1,
        force_cap=10.0,
    )
    run = insert(blind)
    assert run.depth.max() == pytest.approx(0.006, abs=1e-4)
    assert is_seated(blind, run)
    metrics = measure(blind, run)
    assert value(metrics, "force.axial") < 1.0  # without the bottom's
    assert metrics["force.axial"].note.endswith(", before the bottom")


def test_cenic_agrees_in_depth_force_and_onset() -> None:
    run = insert_by_cenic(at(5.0), 1e-3)
    peak = value(predict(at(5.0)), "predicted.force.axial")
    assert run.axial.max() == pytest.approx(peak, rel=0.05)
    first = float(run.depth[np.flatnonzero(run.two_point)[0]]) - SPRUNG.parts.chamfer_height
    onset = value(predict(at(5.0)), "predicted.two_point.onset")
    assert first == pytest.approx(onset, abs=1e-4)


def synthetic(scenario: PegInsertionScenario, push: list[float], depth: list[float]) -> Insertion:
    """Return a run that stops, and then what is given while the push is taken away."""
    step = scenario.step
    fed = round(scenario.released / step) + 1
    n = fed + len(push)
    normal = np.zeros((n, 5))
    normal[:, :2] = 1.0
    sides = np.zeros((n, 3))
    sides[:, 1] = math.pi
    wrench = np.zeros((n, 6))
    return Insertion(
        time=step * np.arange(n),
        depth=np.concatenate([np.full(fed, 0.004), depth]),
        push=np.concatenate([np.full(fed, scenario.force_cap), push]),
        wrench=wrench,
        normal=normal,
        sides=sides,
        state=np.full(n, float(ContactState.TWO_POINT)),
        joints=np.zeros((n, 10)),
        power=np.zeros(n),
        loss=np.zeros(n),
    )


@pytest.mark.parametrize(
    ("pulled", "out", "wedged"),
    [(-3.0, 0.0, 1.0), (-0.1, 0.0, 0.0), (-3.0, 0.0002, 0.0)],
)
def test_what_is_held_without_the_push_is_wedged_and_else_jammed(
    pulled: float, out: float, wedged: float
) -> None:
    push = [20.0] * 20 + [pulled] * 20
    depth = [0.004] * 20 + [0.004 - out] * 20
    metrics = measure(SPRUNG, synthetic(SPRUNG, push, depth))
    assert value(metrics, "wedged") == wedged
    assert value(metrics, "jammed") == 1.0 - wedged
    assert value(metrics, "pull_out.force") == pytest.approx(-pulled)
