"""The block against the pure function, and in time."""

import math
import re
from collections.abc import Callable

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import LogVectorOutput, VectorLogSink

from chamfer.models.surfaces.friction import SurfaceFriction
from chamfer.models.surfaces.graphs import Parabola, WavySheet
from chamfer.models.surfaces.surface import Surface
from chamfer.models.validation import ParameterError
from chamfer.systems.contact.sliding_contact import (
    FREE,
    SLIP,
    STICK,
    SlidingContact,
    SlidingContactParams,
    Touch,
    advance,
)

EVEN = ((100.0, 0.0, 0.0), (0.0, 100.0, 0.0), (0.0, 0.0, 100.0))
PORTS = ("contact_force", "contact_force_rate", "contact")


class Gripper(LeafSystem):
    """Gives a nominal motion as a function of time."""

    def __init__(self, motion: Callable[[float], np.ndarray]) -> None:
        super().__init__()

        def calc(context: Context, vector: BasicVector) -> None:
            vector.SetFromVector(motion(context.get_time()))

        self.DeclareVectorOutputPort("motion", len(motion(0.0)), calc, {self.time_ticket()})


def flat_motion(t: float) -> np.ndarray:
    """Land, slide to the right and back, and leave."""
    depth, rate = -0.1 * math.sin(t), -0.1 * math.cos(t)
    return np.array([0.4 * math.sin(2 * t), depth, 0.8 * math.cos(2 * t), rate])


def spatial_motion(t: float) -> np.ndarray:
    x, y = 0.3 * math.sin(t), 0.2 * math.sin(2 * t)
    return np.array([x, y, -0.1, 0.3 * math.cos(t), 0.4 * math.cos(2 * t), 0.0])


def run(
    surface: Surface,
    params: SlidingContactParams,
    motion: Callable[[float], np.ndarray],
    end: float,
    log_period: float,
) -> tuple[np.ndarray, dict[str, np.ndarray], SlidingContact]:
    builder = DiagramBuilder()
    gripper = builder.AddSystem(Gripper(motion))
    contact = builder.AddSystem(SlidingContact(surface, params))
    builder.Connect(gripper.GetOutputPort("motion"), contact.GetInputPort("nominal_motion"))
    sinks: dict[str, VectorLogSink] = {
        name: LogVectorOutput(contact.GetOutputPort(name), builder, log_period) for name in PORTS
    }
    diagram = builder.Build()
    simulator = Simulator(diagram)
    simulator.Initialize()
    simulator.AdvanceTo(end)
    logs = {name: sink.FindLog(simulator.get_context()) for name, sink in sinks.items()}
    times = logs["contact"].sample_times().copy()
    return times, {name: log.data().T.copy() for name, log in logs.items()}, contact


def row(touch: Touch) -> np.ndarray:
    return np.concatenate((touch.point, touch.velocity, touch.normal, [touch.mode]))


@pytest.mark.parametrize(
    ("surface", "stiffness", "motion"),
    [
        (Parabola(), ((100.0, 20.0), (20.0, 80.0)), flat_motion),
        (WavySheet(), EVEN, spatial_motion),
    ],
    ids=["plane", "space"],
)
def test_block_is_the_pure_function_step_by_step(
    surface: Surface,
    stiffness: tuple[tuple[float, ...], ...],
    motion: Callable[[float], np.ndarray],
) -> None:
    friction = SurfaceFriction(coefficient=0.4, ripple=0.1)
    step = 1 / 64
    params = SlidingContactParams(stiffness=stiffness, friction=friction, step=step)
    times, logs, _ = run(surface, params, motion, 5.0, step)
    d, previous, modes = surface.dimension, None, set()
    for i, time in enumerate(times):
        nominal = motion(time)
        previous = advance(
            surface, friction, np.array(stiffness), previous, nominal[:d], nominal[d:]
        )
        modes.add(previous.mode)
        np.testing.assert_allclose(logs["contact"][i], row(previous), atol=1e-8)
        np.testing.assert_allclose(logs["contact_force"][i], previous.force, atol=1e-9)
        np.testing.assert_allclose(logs["contact_force_rate"][i], previous.force_rate, atol=1e-6)
    assert len(times) == 321
    assert modes >= ({FREE, STICK, SLIP} if d == 2 else {STICK, SLIP})


@pytest.fixture
def contact_and_context() -> tuple[SlidingContact, Context]:
    contact = SlidingContact(Parabola(), SlidingContactParams())
    context = contact.CreateDefaultContext()
    return contact, context


def outputs(contact: SlidingContact, context: Context) -> list[np.ndarray]:
    return [contact.GetOutputPort(name).Eval(context).copy() for name in PORTS]


def set_motion(contact: SlidingContact, context: Context, values: list[float]) -> None:
    contact.GetInputPort("nominal_motion").FixValue(context, values)


def test_outputs_follow_the_input_and_the_state_only_the_update(
    contact_and_context: tuple[SlidingContact, Context],
) -> None:
    contact, context = contact_and_context
    set_motion(contact, context, [0.0, -0.1, 0.2, 0.0])
    force, rate, packed = outputs(contact, context)
    np.testing.assert_allclose(force, [0, 10], atol=1e-12)
    np.testing.assert_allclose(rate, [-20, 0], atol=1e-12)
    np.testing.assert_allclose(packed, [0, 0, 0, 0, 0, 1, STICK], atol=1e-15)
    # Not stored yet: elsewhere the contact is made anew, without tangential force.
    set_motion(contact, context, [0.05, -0.1, 0.2, 0.0])
    force, _, packed = outputs(contact, context)
    assert abs(force @ [packed[5], -packed[4]]) < 1e-12
    assert packed[0] > 0.049
    set_motion(contact, context, [0.0, -0.1, 0.2, 0.0])
    context.SetDiscreteState(contact.EvalUniquePeriodicDiscreteUpdate(context))
    set_motion(contact, context, [0.05, -0.1, 0.2, 0.0])
    force, _, packed = outputs(contact, context)
    np.testing.assert_allclose(force, [-5, 10], atol=1e-12)
    np.testing.assert_allclose(packed, [0, 0, 0, 0, 0, 1, STICK], atol=1e-15)


@pytest.mark.parametrize("bad", [math.nan, math.inf])
@pytest.mark.parametrize("index", [0, 3])
def test_nominal_motion_that_is_not_finite(
    contact_and_context: tuple[SlidingContact, Context], bad: float, index: int
) -> None:
    contact, context = contact_and_context
    motion = [0.0, -0.1, 0.2, 0.0]
    motion[index] = bad
    set_motion(contact, context, motion)
    message = re.escape(f"nominal_motion is {motion!r}, allowed: finite numbers")
    with pytest.raises(ParameterError, match=f"^{message}$"):
        outputs(contact, context)
