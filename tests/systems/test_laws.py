"""A law that is stepped by hand gives what its block gives in a diagram, to the bit."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.random import Generator
from pydrake.systems.analysis import Simulator

from chamfer.systems.estimation.normal_filter import ResolvedSurfaceObserverParams
from chamfer.systems.estimation.surface_observer import SurfaceObserver
from chamfer.systems.force.accommodation import AccommodationController
from chamfer.systems.force.accommodation_law import AccommodationParams
from chamfer.systems.force.contact_detection import ContactDetection
from chamfer.systems.force.contact_detection_law import ContactDetectionParams
from chamfer.systems.law import HeldLaw
from chamfer.systems.law_block import LawBlock
from chamfer.systems.sensing.force_sensor import Tare
from chamfer.systems.servo.divergence_law import DivergenceParams, Watched
from chamfer.systems.servo.divergence_watch import DivergenceWatch
from chamfer.systems.servo.measurement_selector import MeasurementSelector

WATCH = DivergenceParams(watched=(Watched((0, 1), 1.0), Watched((2,), 1.0)), size=3, factor=3.0)


def flags(*names: str) -> Callable[[Generator, str, int], Any]:
    """Return how inputs are drawn of which some are 0 or 1."""
    return lambda drawn, name, size: (
        drawn.integers(0, 2, size).astype(float) if name in names else drawn.normal(size=size)
    )


REMOTE = AccommodationParams(centre=(0.005, 0.0, 0.01), damping=(4.0, 4.0, 4.0, 1e3, 1e3, 1e3))
TOUCH = ContactDetectionParams(detect=0.5, release=0.1, samples=2)


def softer(drawn: Generator, name: str, size: int) -> Any:
    """Return inputs with a damping that now and then is another one's than the parameters'."""
    return drawn.integers(0, 3, size) * 4000.0 if name == "damping" else drawn.normal(size=size)


def sliding(drawn: Generator, name: str, size: int) -> Any:
    """Return inputs of a gripper that slides on a surface, and now and then starts anew."""
    if name == "restart":
        return drawn.random(1) > 0.9
    if name == "predicted_normal":
        angle = drawn.normal(1.5, 0.1)
        return np.array([np.cos(angle), np.sin(angle)])
    return drawn.normal(size=size) + (10.0 if name == "measured_force" else 0.0)


OBSERVER = ResolvedSurfaceObserverParams(
    stiffness=((900.0, 0.0), (0.0, 900.0)), force_noise=0.1, force_rate_noise=1.0, rate_lag=0.0
)
BLOCKS = {
    "accommodation": (AccommodationController(REMOTE), softer),
    "contact": (ContactDetection(TOUCH, np.array([1.0, 2.0]), period=0.1), flags()),
    "divergence": (DivergenceWatch(WATCH), flags("valid", "blind")),
    "tare": (Tare(period=0.5, size=6), flags("tare")),
    "observer": (SurfaceObserver(OBSERVER, np.array([0.0, 1.0])), sliding),
    "selector": (MeasurementSelector(3), flags("valid", "open")),
}


@pytest.mark.parametrize("name", BLOCKS)
def test_a_law_is_its_block(name: str) -> None:
    block: LawBlock[Any, Any, Any]
    block, draw = BLOCKS[name]
    law, simulator = block.law, Simulator(block)
    context, drawn = simulator.get_mutable_context(), np.random.default_rng(1)
    state = law.start()
    # A law keeps nothing of what it was given: a robot may write the next reading there.
    values = {one: np.zeros(signal.size) for one, signal in law.inputs.items()}
    for k in range(60):
        for one, value in values.items():
            value[:] = draw(drawn, one, len(value))
            block.GetInputPort(one).FixValue(context, value)
        if k == 0:
            simulator.Initialize()
        seen = law.observe(values)
        state, command = law.step(state, seen, k * law.period)
        simulator.AdvanceTo((k + 0.5) * law.period)
        if not isinstance(law, HeldLaw):  # what follows the inputs at once, after the step
            command = law.step(state, seen, context.get_time())[1]
        for one in law.outputs:
            found = block.GetOutputPort(one).Eval(context).tolist()
            assert found == np.asarray(getattr(command, one)).tolist(), (k, one)
