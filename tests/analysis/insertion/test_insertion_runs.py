"""Insertions of a sprung peg against the statics, and what of them depends on the solver."""

import math
from dataclasses import replace

import numpy as np
import pytest

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.drawing.figure_kit import metric_value as value
from chamfer.analysis.insertion.contact_convergence import (
    MEASURED,
    PARAMETERS,
    ConvergenceScenario,
    label,
    measure_variation,
    variations,
)
from chamfer.analysis.insertion.contact_convergence import resolve as resolve_convergence
from chamfer.analysis.insertion.insertion_runs import (
    Insertion,
    insert,
    insert_by_cenic,
    is_seated,
    measure,
    predict,
)
from chamfer.analysis.insertion.jamming_diagram import JammingScenario, load_ratios, loads, resolve
from chamfer.analysis.scenario.experiment import load, quiet, select
from chamfer.analysis.scenario.scenario_io import make_scenario
from chamfer.diagrams.insertion.peg_insertion import (
    FeedSupport,
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
        support=FeedSupport(lateral_stiffness=521.7, angular_stiffness=1.5, centre_distance=0.04),
        lateral=0.0,
        speed=0.03,
        depth=0.011,
        gap=0.002,
    )
)


def at(degrees: float, lateral: float = 0.0) -> PegInsertionScenario:
    return replace(SPRUNG, lateral=lateral, tilt=math.radians(degrees))


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
    ended = [value(metrics, name) for name in ("seated", "wedged", "jammed", "missed")]
    assert ended == [0.0, 1.0, 0.0, 0.0]
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
        SPRUNG, parts=replace(SPRUNG.parts, bore_depth=0.006), tilt=0.0, speed=0.1, force_cap=10.0
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
    ("pulled", "out", "wedged"), [(-3.0, 0.0, 1.0), (-0.1, 0.0, 0.0), (-3.0, 0.0002, 0.0)]
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


(ENTRY,) = select(CATALOGUE.entries, ["peg-insertion"])
PEG_INSERTION = load(ENTRY)


def test_traces_and_predictions_belong_together() -> None:
    scenario = PEG_INSERTION.resolve(make_scenario(PegInsertionScenario(), settings=ENTRY.reduced))
    outcome = PEG_INSERTION.run(scenario, 0, quiet)
    traces, predicted = outcome.traces, outcome.tables["predicted"]
    assert traces["tip"][0] == pytest.approx(scenario.lateral)
    assert traces["tilt"][0] == pytest.approx(scenario.tilt)
    assert traces["depth"][0] == pytest.approx(-scenario.gap)
    deep = traces["depth"] > 0.0065
    l_of = traces["depth"][deep] - scenario.parts.chamfer_height
    said = np.interp(l_of, predicted["depth"], predicted["axial"])
    np.testing.assert_allclose(np.median(traces["force_x"][deep] - said), 0.0, atol=0.05)


JAMMING_DIAGRAM = load(select(CATALOGUE.entries, ["jamming-diagram"])[0])

SCENARIO = resolve(JammingScenario())
FEED = replace(SCENARIO.insertion, speed=0.1, step=0.002, depth=0.025)
FAST = replace(SCENARIO, insertion=FEED, laterals=(0.0,), tilts=(0.03,)).starts()[0]


def test_loads_of_a_sliding_peg_are_on_the_sides() -> None:
    found = loads(replace(FAST, tilt=0.03))
    assert found["seated"]
    assert found["moving"].all()
    assert len(found["depth"]) > 10
    np.testing.assert_allclose(found["level"], 1.0, atol=0.08)


def test_loads_of_a_jammed_peg_are_outside() -> None:
    found, mirrored = (loads(replace(FAST, tilt=tilt)) for tilt in (0.06, -0.06))
    assert not found["seated"]
    stopped = ~found["moving"]
    assert stopped.any()
    assert found["level"][stopped].min() > 1.0
    assert found["level"][stopped][-1] > 1.15
    assert mirrored["level"][-1] == pytest.approx(found["level"][-1], rel=0.02)
    assert mirrored["moment_ratio"][-1] == pytest.approx(-found["moment_ratio"][-1], rel=0.02)


def test_the_load_is_what_the_springs_and_the_push_put_on_the_peg() -> None:
    scenario = replace(FAST, tilt=0.06)
    run = insert(scenario, withdraw=False)
    _, force_ratio, moment_ratio = load_ratios(scenario, run)
    support, parts = scenario.support, scenario.parts
    x, y, _, rz, _ = run.joints[-1, :5]
    arm = support.centre_distance - parts.peg_chamfer.height  # to the middle of the corners
    tip = np.array([x + arm * math.cos(rz), y + arm * math.sin(rz)])
    start = scenario.lateral + support.centre_distance * math.sin(scenario.tilt)
    across = support.lateral_stiffness * (start - y)
    turning = support.angular_stiffness * (-scenario.tilt - rz)
    down = run.push[-1]
    moment = turning + (x - tip[0]) * across - (y - tip[1]) * down
    assert force_ratio[-1] == pytest.approx(across / down, abs=5e-3)
    assert moment_ratio[-1] == pytest.approx(moment / (parts.peg_radius * down), rel=0.02)


def test_agreement_is_of_loads_off_the_sides() -> None:
    scenario = replace(SCENARIO, insertion=FEED, tilts=(0.03, 0.06), laterals=(0.0,))
    outcome = JAMMING_DIAGRAM.run(scenario, 0, quiet)
    assert outcome.metrics["agreement"].value == pytest.approx(100.0, abs=3.0)
    assert outcome.metrics["moving.on_sides"].value == pytest.approx(100.0, abs=5.0)
    assert outcome.metrics["stopped.outside"].value == 100.0
    assert outcome.metrics["seated"].value == 1.0


(CONVERGENCE,) = select(CATALOGUE.entries, ["contact-convergence"])
CONTACT_CONVERGENCE = load(CONVERGENCE)

VARIED = resolve_convergence(ConvergenceScenario())


def test_one_thing_is_varied_at_a_time_about_the_insertion() -> None:
    tasks = [one for one in variations(VARIED) if one.start == "sliding"]
    base = VARIED.insertion
    fields = {"stictions": "stiction", "approximations": "approximation"}
    fields |= dict.fromkeys(("stiffnesses", "facets"), "contact")
    for parameter in PARAMETERS:
        varied = [one for one in tasks if one.parameter == parameter]
        assert len(varied) == len(getattr(VARIED, parameter))
        name = fields.get(parameter, "step")
        assert all(replace(one.scenario, **{name: getattr(base, name)}) == base for one in varied)
    assert [one.accuracy for one in tasks[-2:]] == [1e-2, 1e-5]


def test_the_stuck_start_is_beyond_the_last_tilt_that_slides() -> None:
    stuck = next(one for one in variations(VARIED) if one.start == "stuck")
    assert stuck.scenario.tilt == VARIED.stuck_tilt
    leaning_left = replace(VARIED, insertion=replace(VARIED.insertion, tilt=-0.045))
    stuck = next(one for one in variations(leaning_left) if one.start == "stuck")
    assert stuck.scenario.tilt == -VARIED.stuck_tilt


def test_a_variation_is_measured() -> None:
    task = next(one for one in variations(VARIED) if one.value == 2e-3)
    found = measure_variation(task)
    assert set(found) == set(MEASURED)
    assert found["seated"] == 1.0
    assert found["force"] == pytest.approx(8.46, rel=0.02)  # the exact statics
    assert found["onset"] == pytest.approx(0.01101, abs=2e-4)
    assert found["balance"] == pytest.approx(100.0, abs=2.0)
    assert found["depth"] == pytest.approx(VARIED.insertion.depth, abs=2e-4)


@pytest.mark.parametrize(
    ("parameter", "value", "expected"),
    [("steps", 2.5e-4, "0_00025"), ("stiffnesses", 1e8, "1e08"), ("approximations", 2, "sap")],
)
def test_values_in_names(parameter: str, value: float, expected: str) -> None:
    assert label(VARIED, parameter, value) == expected


@pytest.mark.slow
def test_a_run_says_how_far_values_are_apart() -> None:
    settings = [*CONVERGENCE.reduced, "steps=[0.004, 0.002]"]
    settings = [one for one in settings if one != "steps=[0.002]"]
    scenario = resolve_convergence(make_scenario(ConvergenceScenario(), settings=settings))
    outcome = CONTACT_CONVERGENCE.run(scenario, 0, lambda fraction, doing="": None)
    traces = outcome.traces
    of = (traces["parameter"] == 0) & (traces["start"] == 0)
    coarse, fine = traces["force"][of]
    spread = outcome.metrics["sliding.steps.force.spread"].value
    assert spread == pytest.approx(100 * abs(coarse - fine) / fine)
    worst = outcome.metrics["energy.worst"].value
    assert worst is not None
    assert worst >= 0
    assert math.isnan(traces["balance"][traces["parameter"] == PARAMETERS.index("accuracies")][0])
    assert np.array_equal(
        traces["force"][(traces["parameter"] == 2) & (traces["start"] == 0)], [fine]
    )  # the same insertion is run once
