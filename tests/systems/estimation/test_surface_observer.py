"""The observer as a block: it runs its filter, and lets nothing in that is not a number."""

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from chamfer.models.surfaces.graphs import Parabola
from chamfer.models.validation import ParameterError
from chamfer.systems.estimation.model_error import ModelErrorParams
from chamfer.systems.estimation.normal_filter import (
    KINDS,
    NormalStatus,
    ObserverKind,
    ResolvedSurfaceObserverParams,
    Sample,
    SurfaceObserverParams,
    tangential_deviation,
)
from chamfer.systems.estimation.surface_observer import SettledForce, SurfaceObserver
from chamfer.systems.estimation.surface_observer_law import make_filter
from chamfer.systems.force.contact_detection_law import APPROACH, CONTACT, LOST

Array = np.ndarray


class Watching:
    """An observer that is given one sample a tick."""

    def __init__(self, params: ResolvedSurfaceObserverParams, normal: Any = None) -> None:
        up = np.eye(len(params.stiffness))[-1] if normal is None else normal
        self.block = SurfaceObserver(params, up)
        self.simulator = Simulator(self.block)
        self.context: Any = self.simulator.get_mutable_context()
        self.period, self.ticks = params.period, 0

    def tick(self, sample: Sample, **inputs: Any) -> None:
        given = {
            # The sensor measures the gripper's force on the surface.
            "measured_force": -sample.force,
            "measured_force_rate": -sample.force_rate,
            "nominal_motion": np.concatenate([sample.nominal_position, sample.nominal_velocity]),
            **inputs,
        }
        if sample.predicted_normal is not None:
            given["predicted_normal"] = sample.predicted_normal
        for name, value in given.items():
            self.block.GetInputPort(name).FixValue(self.context, value)
        self.simulator.AdvanceTo(self.ticks * self.period)
        self.simulator.AdvancePendingEvents()
        self.ticks += 1

    def read(self, name: str) -> Array:
        found: Array = self.block.GetOutputPort(name).Eval(self.context).copy()
        return found

    def everything(self) -> bytes:
        return b"".join(
            self.read(name).tobytes() for name in ("normal", "covariance", "deviation", "status")
        )


@pytest.fixture(scope="package")
def make_params(slides: Any) -> Callable[..., ResolvedSurfaceObserverParams]:
    return partial(slides.told, period=0.0625)  # exact times


@pytest.fixture(scope="package")
def samples(slides: Any) -> Callable[[int], list[Sample]]:
    """Return a function that makes samples of a slide with a halt in the end."""

    def make(d: int) -> list[Sample]:
        ahead = np.eye(d)[0]
        motion = slides.legs([*np.zeros(d - 1), -0.1], [(2.5, 0.2 * ahead), (0.5, 0 * ahead)])
        surface = Parabola(coefficients=(0.05,) * (d - 1))
        slide = slides.make(surface, motion, 3.0, period=0.0625)
        found: list[Sample] = slides.disturb(slide.samples, 5)
        return found

    return make


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("kind", KINDS)
def test_block_does_what_its_filter_does(
    make_params: Any, samples: Any, d: int, kind: ObserverKind
) -> None:
    params = make_params(d, kind=kind)
    watching, pure = Watching(params), make_filter(params)
    memory = pure.start(np.eye(d)[-1])
    statuses = set()
    for k, sample in enumerate(samples(d)):
        angle = 0.01 * k
        normal = math.sin(angle) * np.eye(d)[0] + math.cos(angle) * np.eye(d)[-1]
        given = sample._replace(predicted_normal=normal) if k > 20 else sample
        watching.tick(given)
        expected = pure.update(memory, given)
        memory = expected.memory
        n, P = watching.read("normal"), watching.read("covariance").reshape(d, d)
        # A predicted normal is made one of unit length once more.
        np.testing.assert_allclose(n, expected.normal, rtol=0, atol=1e-12)
        np.testing.assert_allclose(P, expected.covariance, rtol=0, atol=1e-12)
        assert watching.read("deviation")[0] == tangential_deviation(n, P)
        assert watching.read("status")[0] == expected.status
        statuses.add(expected.status)
    if kind != "thesis":
        assert {NormalStatus.MEASURED, NormalStatus.HALTED} <= statuses


def test_restarted_it_knows_what_it_knew_at_first(make_params: Any, samples: Any) -> None:
    slide = samples(3)
    watching, anew = Watching(make_params(3)), Watching(make_params(3))
    first = watching.everything()
    for sample in slide[:20]:
        watching.tick(sample, restart=0.0)
    assert watching.everything() != first
    watching.tick(slide[20], restart=1.0)
    assert watching.everything() == first
    for sample in slide[21:30]:
        watching.tick(sample, restart=0.0)
        anew.tick(sample)
        assert watching.everything() == anew.everything()


def test_sign_of_the_measured_force(make_params: Any) -> None:
    # The gripper pushes down and drags along; the surface's normal is up.
    params = make_params(2, kind="thesis", force_noise=0.0, force_rate_noise=0.0)
    watching = Watching(params, [0.3, 1.0])
    zeros, ahead = np.zeros(2), np.array([0.2, 0.0])
    watching.tick(Sample(np.array([-4.0, 10.0]), zeros, zeros, ahead))
    np.testing.assert_allclose(watching.read("normal"), [0.0, 1.0], rtol=0, atol=1e-12)
    # A rate of the force on the gripper of -3 N/s along y is a velocity downwards by 0.03 m/s.
    watching.tick(Sample(np.array([-4.0, 10.0]), np.array([0.0, -3.0]), zeros, ahead))
    n = np.array([0.03, 0.2]) / math.hypot(0.03, 0.2)
    np.testing.assert_allclose(watching.read("normal"), n, rtol=0, atol=1e-12)
    assert not watching.block.HasAnyDirectFeedthrough()


@pytest.mark.filterwarnings("ignore:invalid value")
@pytest.mark.parametrize("bad", [math.nan, -math.inf])
@pytest.mark.parametrize(
    "name", ["measured_force", "measured_force_rate", "nominal_motion", "predicted_normal"]
)
def test_inputs_that_are_not_finite(make_params: Any, samples: Any, name: str, bad: float) -> None:
    watching = Watching(make_params(2))
    sample = samples(2)[10]
    watching.tick(sample)
    before = watching.everything()
    value = np.zeros(watching.block.GetInputPort(name).size())
    value[1] = bad
    with pytest.raises(ParameterError) as caught:
        watching.tick(sample, **{name: value})
    assert str(caught.value) == f"{name} is {value.tolist()!r}, allowed: finite numbers"
    assert watching.everything() == before


@pytest.mark.parametrize("normal", [[0.0, 0.0], [0.0, 1.1], [0.6, 0.8 + 1e-5]])
def test_prediction_that_is_not_a_direction(make_params: Any, samples: Any, normal: Any) -> None:
    with pytest.raises(ParameterError, match=r"^predicted_normal is .*: a vector of length 1$"):
        Watching(make_params(2)).tick(samples(2)[10], predicted_normal=normal)


@pytest.mark.parametrize("kind", ["adaptive", "gated"])
def test_prediction_that_is_not_quite_of_unit_length(make_params: Any, kind: ObserverKind) -> None:
    # What is turned along with it must not grow from sample to sample.
    watching = Watching(make_params(2, kind=kind), [0.1, 1.0])
    halt = Sample(*(np.zeros(2) for _ in range(4)))
    for _ in range(1000):
        watching.tick(halt, predicted_normal=np.array([0.6, 0.8]) * (1 + 9e-7))
    np.testing.assert_allclose(
        watching.read("normal"), np.array([0.1, 1.0]) / math.hypot(0.1, 1), rtol=0, atol=1e-10
    )


PERIOD = 0.25  # binary, so that the ticks' times are exact


def test_hidden_at_the_begin_of_each_contact() -> None:
    block = SettledForce(2 * PERIOD, dimension=2, period=PERIOD)
    simulator = Simulator(block)
    context = simulator.get_mutable_context()
    block.GetInputPort("measured_force").FixValue(context, [1.0, 2.0])
    block.GetInputPort("measured_force_rate").FixValue(context, [3.0, 4.0])
    modes = [APPROACH, CONTACT, CONTACT, CONTACT, LOST, CONTACT, CONTACT, CONTACT, CONTACT]
    shown = []
    for k, mode in enumerate(modes):
        block.GetInputPort("mode").FixValue(context, float(mode))
        simulator.AdvanceTo(k * PERIOD) if k else None
        force = block.GetOutputPort("settled_force").Eval(context)
        rate = block.GetOutputPort("settled_force_rate").Eval(context)
        assert list(rate) in ([3.0, 4.0], [0.0, 0.0])
        assert bool(np.any(force)) == bool(np.any(rate))
        shown.append(bool(np.any(force)))
        simulator.AdvancePendingEvents()
    assert shown == [True, False, False, True, True, False, False, True, True]


def test_softest_direction_decides_the_velocity_noise(slides: Any) -> None:
    told = slides.told(2, stiffness=((150.0, 40.0), (40.0, 80.0)), force_rate_noise=3.0)
    assert told.velocity_noise == pytest.approx(3 / (115 - math.hypot(35, 40)), rel=1e-12)
    np.testing.assert_allclose(told.compliance @ told.stiffness, np.eye(2), atol=1e-15)


NOT_SQUARE = "2 x 2 or 3 x 3 finite numbers"
NOT_DEFINITE = "symmetric and positive definite"


@pytest.mark.parametrize(
    ("kind", "changes", "allowed"),
    [
        *(
            (SurfaceObserverParams, {"stiffness": rows}, NOT_SQUARE)
            for rows in (
                (),
                ((100.0, 0.0),),
                ((100.0, 0.0), (0.0, 100.0, 0.0)),
                tuple(map(tuple, np.eye(4).tolist())),
                ((math.nan, 0.0), (0.0, 100.0)),
            )
        ),
        *(
            (SurfaceObserverParams, {"stiffness": rows}, NOT_DEFINITE)
            for rows in (
                ((100.0, 1.0), (0.0, 100.0)),
                ((100.0, 0.0), (0.0, 0.0)),
                ((1.0, 2.0), (2.0, 1.0)),
                ((1.0, 0.0, 0.0), (0.0, 1.0, 2.0), (0.0, 2.0, 1.0)),
            )
        ),
        (
            SurfaceObserverParams,
            {"rate_lag": 0.1, "kind": "thesis"},
            "null unless kind=adaptive",
        ),
        (
            SurfaceObserverParams,
            {"model_error": ModelErrorParams(bias=1.0), "kind": "gated"},
            "none unless kind=adaptive",
        ),
        (ModelErrorParams, {"tare": 1.0}, "0, if there is no bias to be found"),
        (ModelErrorParams, {"press": 1.0}, "0, if there is no stiffness to be found"),
        (partial(SettledForce, dimension=2, period=0.1), {"wait": -1.0}, "a finite number >= 0"),
    ],
)
def test_what_is_refused(kind: Any, changes: dict[str, Any], allowed: str) -> None:
    name, value = next(iter(changes.items()))
    with pytest.raises(ParameterError) as caught:
        kind(**changes)
    assert str(caught.value) == str(ParameterError(name, value, allowed))


@pytest.mark.parametrize("normal", [[0.0, 0.0], [0.0, math.nan], [0.0, 0.0, 1.0]])
def test_initial_normal_is_refused(make_params: Any, normal: list[float]) -> None:
    with pytest.raises(ParameterError, match=r"^initial_normal is .* allowed: 2 finite numbers"):
        SurfaceObserver(make_params(2), normal)  # type: ignore[arg-type]
