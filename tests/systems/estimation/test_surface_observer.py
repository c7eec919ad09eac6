"""The observer as a block: it runs its filter, and lets nothing in or out that is not a number."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from chamfer.models.surfaces.graphs import Parabola, Paraboloid
from chamfer.models.validation import ParameterError
from chamfer.systems.estimation.contact_frame_filter import ContactFrameFilter
from chamfer.systems.estimation.normal_filter import (
    ConstrainedFilter,
    Sample,
    Status,
    tangential_deviation,
)
from chamfer.systems.estimation.surface_observer import (
    KINDS,
    Kind,
    SurfaceObserver,
    SurfaceObserverParams,
    make_filter,
)

Array = np.ndarray


class Watching:
    """An observer that is given one sample a tick."""

    def __init__(
        self,
        params: SurfaceObserverParams,
        normal: Any = None,
        block: SurfaceObserver | None = None,
    ) -> None:
        up = np.eye(len(params.sensing.stiffness))[-1] if normal is None else normal
        self.block = SurfaceObserver(params, up) if block is None else block
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
def make_params(slides: Any) -> Callable[..., SurfaceObserverParams]:
    def make(d: int, kind: Kind = "adaptive", **changes: Any) -> SurfaceObserverParams:
        fields = {**slides.told(d), "period": 0.0625, **changes}  # exact times
        if kind == "adaptive":
            fields = {"rate_lag": 0.0, **fields}
        return SurfaceObserverParams(kind=kind, **fields)

    return make


@pytest.fixture(scope="package")
def samples(slides: Any) -> Callable[[int], list[Sample]]:
    """Return a function that makes samples of a slide with a halt in the end."""

    def make(d: int) -> list[Sample]:
        ahead = np.eye(d)[0]
        motion = slides.legs([*np.zeros(d - 1), -0.1], [(2.5, 0.2 * ahead), (0.5, 0 * ahead)])
        slide = slides.make(Parabola() if d == 2 else Paraboloid(), motion, 3.0, period=0.0625)
        found: list[Sample] = slides.disturb(slide.samples, 5)
        return found

    return make


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("predicted", [False, True])
def test_block_does_what_its_filter_does(
    make_params: Any, samples: Any, d: int, kind: Kind, predicted: bool
) -> None:
    params = make_params(d, kind)
    watching, pure = Watching(params), make_filter(params)
    memory = pure.start(np.eye(d)[-1])
    statuses = set()
    for k, sample in enumerate(samples(d)):
        given = sample
        if predicted:
            angle = 0.01 * k
            normal = math.sin(angle) * np.eye(d)[0] + math.cos(angle) * np.eye(d)[-1]
            given = sample._replace(predicted_normal=normal)
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
        assert {Status.MEASURED, Status.HALTED} <= statuses


@pytest.mark.parametrize("kind", KINDS)
def test_kinds(make_params: Any, kind: Kind) -> None:
    found = make_filter(make_params(3, kind, smallest_radius=0.6, force_noise=0.7))
    params: Any = found._params
    assert (params.smallest_radius, params.force_noise, params.period) == (0.6, 0.7, 0.0625)
    assert len(params.sensing.stiffness) == 3
    if kind in ("thesis", "gated", "prior_weights"):
        assert isinstance(found, ConstrainedFilter)
        assert params.gated == (kind != "thesis")
        assert params.weights == ("prior" if kind == "prior_weights" else "sample")
    else:
        assert isinstance(found, ContactFrameFilter)
        assert (params.models == 1) == (kind != "adaptive")
        assert params.by_point == (kind == "adaptive")
        assert params.by_friction == (kind == "friction")


@pytest.mark.parametrize("d", [2, 3])
def test_ports_and_what_reaches_it(make_params: Any, d: int) -> None:
    block = SurfaceObserver(make_params(d), np.eye(d)[-1])
    inputs = [block.get_input_port(i) for i in range(block.num_input_ports())]
    outputs = [block.get_output_port(i) for i in range(block.num_output_ports())]
    # Sensors, what is commanded, and a camera's prediction: no truth.
    assert [(port.get_name(), port.size()) for port in inputs] == [
        ("measured_force", d),
        ("measured_force_rate", d),
        ("nominal_motion", 2 * d),
        ("predicted_normal", d),
    ]
    assert [(port.get_name(), port.size()) for port in outputs] == [
        ("normal", d),
        ("covariance", d * d),
        ("deviation", 1),
        ("status", 1),
    ]
    assert not block.HasAnyDirectFeedthrough()


def test_before_the_first_sample_it_is_the_initial_normal(make_params: Any) -> None:
    watching = Watching(make_params(3, initial_deviation=0.2), [0.0, 3.0, 4.0])
    np.testing.assert_allclose(watching.read("normal"), [0.0, 0.6, 0.8], rtol=0, atol=1e-15)
    P = watching.read("covariance").reshape(3, 3)
    np.testing.assert_allclose(P, 0.04 * np.eye(3), rtol=1e-15)
    assert watching.read("deviation")[0] == pytest.approx(0.2, rel=1e-12)
    assert watching.read("status")[0] == Status.NO_CONTACT


def test_outputs_are_held_over_the_period(make_params: Any, samples: Any) -> None:
    watching = Watching(make_params(2))
    given = samples(2)
    for sample in given[:20]:
        watching.tick(sample)
    before = watching.everything()
    watching.block.GetInputPort("measured_force").FixValue(watching.context, [5.0, -50.0])
    watching.simulator.AdvanceTo(19.9 * watching.period)
    assert watching.everything() == before
    watching.tick(given[20])
    assert watching.everything() != before


def test_sign_of_the_measured_force(make_params: Any) -> None:
    # The gripper pushes down and drags along; the surface's normal is up.
    params = make_params(2, "thesis", force_noise=0.0, force_rate_noise=0.0)
    watching = Watching(params, [0.3, 1.0])
    for inputs in ({"measured_force": [4.0, -10.0]}, {"measured_force_rate": [0.0, 3.0]}):
        watching.tick(
            Sample(np.zeros(2), np.zeros(2), np.zeros(2), np.array([0.2, 0.0])),
            **{"measured_force": [4.0, -10.0], **inputs},
        )
        if "measured_force" in inputs:
            np.testing.assert_allclose(watching.read("normal"), [0.0, 1.0], rtol=0, atol=1e-12)
    # A rate of the force on the gripper of -3 N/s along y is a velocity downwards by 0.03 m/s.
    n = np.array([0.03, 0.2]) / math.hypot(0.03, 0.2)
    np.testing.assert_allclose(watching.read("normal"), n, rtol=0, atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_state_is_in_the_context(make_params: Any, samples: Any, kind: Kind) -> None:
    # Two contexts of one block, one a few samples behind the other.
    given, params = samples(2), make_params(2, kind)
    alone = Watching(params)
    for sample in given:
        alone.tick(sample)
    ahead = Watching(params)
    behind = Watching(params, block=ahead.block)
    for k, sample in enumerate(given):
        ahead.tick(sample)
        if k >= 7:
            behind.tick(given[k - 7])
    assert ahead.everything() == alone.everything()
    for sample in given[-7:]:
        behind.tick(sample)
    assert behind.everything() == alone.everything()


def test_same_samples_same_bytes(make_params: Any, samples: Any) -> None:
    found = []
    for _ in range(2):
        watching = Watching(make_params(3))
        for sample in samples(3):
            watching.tick(sample)
        found.append(watching.everything())
    assert found[0] == found[1]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.filterwarnings("error")
def test_nothing_that_is_not_a_number_leaves(make_params: Any, d: int, kind: Kind) -> None:
    random = np.random.default_rng(1)
    watching = Watching(make_params(d, kind))
    ahead, zeros = 0.2 * np.eye(d)[0], np.zeros(d)
    odd = [
        Sample(zeros, zeros, zeros, zeros),
        Sample(zeros, zeros, zeros, ahead),
        Sample(20 * ahead, zeros, zeros, ahead),
        Sample(10 * np.eye(d)[-1], -100 * ahead, zeros, ahead),
        Sample(10 * np.eye(d)[-1], zeros, zeros, ahead),
        Sample(1e6 * np.eye(d)[-1], 1e3 * ahead, zeros, ahead),
        Sample(1e-9 * np.eye(d)[-1], zeros, zeros, 1e-9 * ahead),
    ]
    for _ in range(100):
        watching.tick(odd[random.integers(len(odd))])
        for name in ("normal", "covariance", "deviation", "status"):
            assert np.all(np.isfinite(watching.read(name)))
        assert abs(float(np.linalg.norm(watching.read("normal"))) - 1) < 1e-12


BAD = pytest.mark.filterwarnings("ignore:invalid value")


@BAD
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
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
def test_prediction_that_is_not_quite_of_unit_length(make_params: Any, kind: Kind) -> None:
    # What is turned along with it must not grow from sample to sample.
    watching = Watching(make_params(2, kind), [0.1, 1.0])
    halt = Sample(*(np.zeros(2) for _ in range(4)))
    for _ in range(1000):
        watching.tick(halt, predicted_normal=np.array([0.6, 0.8]) * (1 + 9e-7))
    np.testing.assert_allclose(
        watching.read("normal"), np.array([0.1, 1.0]) / math.hypot(0.1, 1), rtol=0, atol=1e-10
    )


def test_prediction_that_turns_around(make_params: Any, samples: Any) -> None:
    for kind in ("adaptive", "gated"):
        watching = Watching(make_params(2, kind))
        watching.tick(samples(2)[10], predicted_normal=[0.6, 0.8])
        with pytest.raises(ParameterError, match="less than a half turn"):
            watching.tick(samples(2)[11], predicted_normal=[-0.6, -0.8])


@pytest.mark.parametrize(
    "normal", [[0.0, 0.0], [1.0, 0.0, 0.0], [1.0], [math.nan, 1.0], [math.inf, 0.0], [[0.0, 1.0]]]
)
def test_initial_normal(make_params: Any, normal: Any) -> None:
    with pytest.raises(ParameterError) as caught:
        SurfaceObserver(make_params(2), normal)
    expected = f"initial_normal is {normal!r}, allowed: 2 finite numbers, not all zero"
    assert str(caught.value) == expected


@pytest.mark.parametrize("name", ["measured_force", "nominal_motion", "predicted_normal"])
def test_wrong_length(make_params: Any, name: str) -> None:
    # Refused where it is connected, before anything runs.
    builder = DiagramBuilder()
    block = builder.AddSystem(SurfaceObserver(make_params(2), np.array([0.0, 1.0])))
    source = builder.AddSystem(ConstantVectorSource(np.zeros(5)))
    with pytest.raises((RuntimeError, SystemExit), match=name):
        builder.Connect(source.get_output_port(), block.GetInputPort(name))
