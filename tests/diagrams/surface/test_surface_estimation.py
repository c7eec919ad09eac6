"""The open loop of Fig. 5-1: its wiring, its contact in closed form, and what observers make."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pydrake.systems.framework import Diagram, LeafSystem

from chamfer.analysis.linear.simulate import simulate
from chamfer.diagrams.surface.surface_estimation import (
    NOISE_FREE,
    EstimationScenario,
    LeadSettings,
    make_estimation_diagram,
    resolve_estimation,
)
from chamfer.diagrams.surface.surface_scenario import (
    THESIS,
    ObserverSettings,
    SurfaceSettings,
    SurfaceShape,
)
from chamfer.models.validation import ParameterError
from chamfer.systems.estimation.normal_filter import Sample
from chamfer.systems.estimation.surface_observer import ObserverKind, make_filter
from chamfer.systems.sensing.force_rate import ForceRateParams, ForceRateSensorParams

Array = NDArray[np.float64]
Wire = tuple[str, str, str, str]

CONTACT, SENSOR, OBSERVER, NOISE = (
    "contact model",
    "force sensor",
    "surface estimator",
    "sensor noise",
)
PREDICTION, PATH = "predicted surface", "nominal trajectory"
SEEN = replace(THESIS, prediction=SurfaceSettings(coefficients=(0.04,)))
QUIET = NOISE_FREE


def wires(diagram: Diagram) -> set[Wire]:
    return {
        (
            source.get_name(),
            source.get_output_port(output).get_name(),
            target.get_name(),
            target.get_input_port(entrance).get_name(),
        )
        for (target, entrance), (source, output) in diagram.connection_map().items()
    }


MEASURED = {
    (CONTACT, "contact_force", SENSOR, "contact_force"),
    (CONTACT, "contact_force_rate", SENSOR, "contact_force_rate"),
    (SENSOR, "measured_force", OBSERVER, "measured_force"),
    (SENSOR, "measured_force_rate", OBSERVER, "measured_force_rate"),
}
LED = {(PATH, "y0", one, "nominal_motion") for one in (CONTACT, OBSERVER)}
NOISY = {(NOISE, "output", SENSOR, "noise")}
PREDICTED = {
    (PATH, "y0", PREDICTION, "nominal_motion"),
    (PREDICTION, "predicted_normal", OBSERVER, "predicted_normal"),
}


@pytest.mark.parametrize("shape", ["parabola", "sphere"])
def test_what_is_true_comes_to_the_observer_through_the_force_sensor_only(
    shape: SurfaceShape,
) -> None:
    surface = SurfaceSettings(shape=shape)
    scenario = EstimationScenario(surface=surface)
    assert wires(make_estimation_diagram(resolve_estimation(scenario))) == MEASURED | LED | NOISY
    silent = replace(scenario, sensor=QUIET.sensor)
    assert wires(make_estimation_diagram(resolve_estimation(silent))) == MEASURED | LED
    seen = replace(scenario, observer=replace(THESIS, prediction=surface))
    assert (
        wires(make_estimation_diagram(resolve_estimation(seen)))
        == MEASURED | LED | NOISY | PREDICTED
    )


def test_the_predicted_surface_is_the_observers_own() -> None:
    diagram = make_estimation_diagram(resolve_estimation(EstimationScenario(observer=SEEN)))
    block = diagram.GetSubsystemByName(PREDICTION)
    context = block.CreateDefaultContext()
    block.get_input_port().FixValue(context, [1.0, -0.1, 0.0, 0.0])
    found = block.get_output_port().Eval(context)
    np.testing.assert_allclose(found, np.array([-0.08, 1.0]) / math.hypot(0.08, 1.0))


def outputs(scenario: EstimationScenario, duration: float, step: float) -> dict[str, Array]:
    diagram = make_estimation_diagram(resolve_estimation(scenario))
    run = simulate(diagram, duration=duration, step=step)
    return {"time": run.time, **run.outputs}


@pytest.mark.parametrize("shape", ["parabola", "paraboloid"])
@pytest.mark.parametrize("speed", [0.2, -0.3])
def test_the_gripper_is_led_and_halts(shape: SurfaceShape, speed: float) -> None:
    sideways = 0.3 if shape == "paraboloid" else 0.0
    lead = LeadSettings(depth=0.15, speed=speed, halt=0.5, sideways=sideways)
    scenario = replace(QUIET, surface=SurfaceSettings(shape=shape), lead=lead)
    found = outputs(scenario, 1.5, 0.05)
    time, motion = found["time"], found["nominal_motion"]
    middle = [[sideways] * len(time)] if sideways else []
    expected = [speed * np.minimum(time, 0.5), *middle, [-0.15] * len(time)]
    np.testing.assert_allclose(motion[:, : len(expected)], np.transpose(expected), atol=1e-12)
    moving = np.where(time < 0.5 - 1e-9, speed, 0.0)
    np.testing.assert_allclose(motion[:, len(expected)], moving, atol=1e-12)
    np.testing.assert_array_equal(motion[:, len(expected) + 1 :], 0)


# The contact on y = a x^2 in closed form.


def test_the_end_of_the_slide_is_where_the_reference_has_it() -> None:
    found = outputs(QUIET, 15.0, 0.05)
    x, y, _, _, n_x, n_y, mode = found["contact"][-1]
    assert (x, y) == (pytest.approx(2.378, abs=1e-3), pytest.approx(0.283, abs=1e-3))
    assert math.degrees(math.atan2(n_y, n_x)) == pytest.approx(103.38, abs=0.01)
    np.testing.assert_allclose(found["contact_force"][-1], [-62.2, 38.3], atol=0.05)
    assert mode == 1  # at rest


# The sensor's noise.


def test_noise_is_of_its_length_and_fresh_with_every_sample() -> None:
    sensor = ForceRateSensorParams(force_noise=2.0, force_rate_noise=7.0)
    loud = EstimationScenario(sensor=sensor)
    found = outputs(loud, 20.0, 0.05)
    quiet = outputs(replace(loud, sensor=QUIET.sensor), 20.0, 0.05)
    for name, length in (("measured_force", 2.0), ("measured_force_rate", 7.0)):
        noise = found[name] - quiet[name]
        np.testing.assert_allclose(noise.std(axis=0), length / math.sqrt(3), rtol=0.1)
        for i in range(2):
            assert abs(np.corrcoef(noise[1:, i], noise[:-1, i])[0, 1]) < 0.2
    force, rate = (found[n] - quiet[n] for n in ("measured_force", "measured_force_rate"))
    across = np.corrcoef(np.hstack([force, rate]).T) - np.eye(4)
    assert np.abs(across).max() < 0.2
    np.testing.assert_array_equal(found["contact"], quiet["contact"])


# The observer in the loop.


@pytest.mark.parametrize(("kind", "shape"), [("thesis", "parabola"), ("adaptive", "paraboloid")])
def test_the_loop_gives_the_filter_each_sample_once_and_in_its_order(
    kind: ObserverKind, shape: SurfaceShape
) -> None:
    scenario = resolve_estimation(
        EstimationScenario(
            surface=SurfaceSettings(shape=shape),
            observer=ObserverSettings(kind=kind, prediction=SurfaceSettings(shape=shape)),
        )
    )
    d = scenario.dimension
    diagram = make_estimation_diagram(scenario)
    found = simulate(diagram, duration=2.0, step=0.05, seed=5).outputs
    surface = scenario.surface.make()
    observer = make_filter(scenario.observer)
    memory = observer.start(scenario.up)
    rows = (
        np.ascontiguousarray(found[name])
        for name in ("measured_force", "measured_force_rate", "nominal_motion")
    )
    for k, (force, rate, motion) in enumerate(zip(*rows, strict=True)):
        if k == 40:
            break
        gradient = surface.gradient(motion[:d])
        predicted = gradient / np.linalg.norm(gradient)
        sample = Sample(-force, -rate, motion[:d], motion[d:], predicted)
        estimate = observer.update(memory, sample)
        memory = estimate.memory
        np.testing.assert_allclose(found["normal"][k + 1], estimate.normal, atol=1e-12)
        np.testing.assert_allclose(
            found["covariance"][k + 1], estimate.covariance.ravel(), atol=1e-12
        )
        assert found["status"][k + 1] == estimate.status


def test_gripper_may_hover_and_be_pressed_before() -> None:
    lead = LeadSettings(depth=0.1, speed=0.2, halt=2.0, hover=1.0, press=2.0)
    path = lead.path(3)
    for t, expected in (
        (0.0, [0, 0, 0.1]),
        (1.0, [0, 0, 0.1]),
        (2.5, [0, 0, -0.2]),
        (3.0, [0, 0, -0.1]),
        (4.0, [0.2, 0, -0.1]),
        (5.5, [0.4, 0, -0.1]),
    ):
        np.testing.assert_allclose(path.value(t).ravel(), expected, rtol=0, atol=1e-12)
    assert lead.begins == 3.0
    with pytest.raises(ParameterError, match=r"^press is 0.0, allowed: more than 0 with a hover"):
        LeadSettings(hover=1.0)


def test_force_may_be_biased_and_late_and_its_rate_differenced() -> None:
    scenario = EstimationScenario(
        sensor=ForceRateSensorParams(force_noise=0.0, bias=(1.0, -2.0)),
        force_delay=0.1,
        force_rate=ForceRateParams(time_constant=0.2),
        observer=ObserverSettings(),
        duration=2.0,
    )
    told = resolve_estimation(scenario).observer
    assert (told.rate_lag, told.force_rate_noise) == (0.2, 0.0)
    run = simulate(make_estimation_diagram(resolve_estimation(scenario)), duration=2.0, step=0.05)
    true, shown = run.outputs["contact_force"], run.outputs["measured_force"]
    np.testing.assert_allclose(shown[3:], [1.0, -2.0] - true[1:-2], rtol=0, atol=1e-12)
    share, filtered = 1 - math.exp(-0.25), np.zeros(2)
    for force, rate in zip(shown, run.outputs["measured_force_rate"], strict=True):
        np.testing.assert_allclose(rate, share * (force - filtered) / 0.05, rtol=0, atol=1e-9)
        filtered = filtered + share * (force - filtered)


class Silent(LeafSystem):
    """A user's own observer: whatever it is given, the normal is the first one."""

    def __init__(
        self, d: int, *, normal: int | None = None, force: str = "measured_force"
    ) -> None:
        super().__init__()
        sizes = {force: d, "measured_force_rate": d, "nominal_motion": 2 * d}
        for name, size in sizes.items():
            self.DeclareVectorInputPort(name, size)
        up = np.eye(d)[-1]
        for name, value in (
            ("normal", up if normal is None else np.zeros(normal)),
            ("covariance", np.zeros(d * d)),
            ("deviation", np.zeros(1)),
            ("status", np.zeros(1)),
        ):
            self.DeclareVectorOutputPort(
                name, len(value), lambda _, vector, value=value: vector.SetFromVector(value)
            )


def test_a_users_own_observer_takes_the_observers_place() -> None:
    scenario = resolve_estimation(EstimationScenario())
    diagram = make_estimation_diagram(scenario, observer=Silent(2))
    assert wires(diagram) == wires(make_estimation_diagram(scenario))
    found = simulate(diagram, duration=1.0, step=0.05).outputs
    np.testing.assert_array_equal(found["normal"], np.tile([0.0, 1.0], (21, 1)))


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"force": "force"}, "input port measured_force of size 2; .* are: force \\(2\\), meas"),
        ({"normal": 3}, "output port normal of size 2; .* are: normal \\(3\\), covariance"),
    ],
)
def test_an_observer_without_a_port_is_refused(wrong: Any, message: str) -> None:
    scenario = resolve_estimation(EstimationScenario())
    with pytest.raises(ParameterError, match=f"^observer is 'Silent', .*{message}"):
        make_estimation_diagram(scenario, observer=Silent(2, **wrong))
