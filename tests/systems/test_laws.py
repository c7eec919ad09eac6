"""A law that is stepped by hand gives what its block gives in a diagram, to the bit."""

import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.random import Generator
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator

from chamfer.models.arms.planar_two_link import PLANAR_TWO_LINK
from chamfer.systems.estimation.normal_filter import ResolvedSurfaceObserverParams
from chamfer.systems.estimation.surface_observer import SurfaceObserver
from chamfer.systems.force.accommodation import AccommodationController
from chamfer.systems.force.accommodation_law import AccommodationParams
from chamfer.systems.force.admittance import AdmittanceController
from chamfer.systems.force.admittance_law import AdmittanceParams
from chamfer.systems.force.arm_model import ArmModel, ToolParams
from chamfer.systems.force.contact_detection import ContactDetection
from chamfer.systems.force.contact_detection_law import ContactDetectionParams
from chamfer.systems.force.hybrid_controller import HybridController
from chamfer.systems.force.hybrid_law import HybridControllerParams
from chamfer.systems.force.impedance_controller import ImpedanceController
from chamfer.systems.force.impedance_law import ImpedanceControllerParams
from chamfer.systems.law import HeldLaw
from chamfer.systems.law_block import LawBlock
from chamfer.systems.sensing.force_sensor import Tare
from chamfer.systems.servo.compensator import TrajectoryCompensator
from chamfer.systems.servo.compensator_law import AxisParams, CompensatorParams
from chamfer.systems.servo.divergence_law import DivergenceParams, Watched
from chamfer.systems.servo.divergence_watch import DivergenceWatch
from chamfer.systems.servo.measurement_selector import MeasurementSelector
from chamfer.systems.servo.pid_law import PidGains, SampledPidParams
from chamfer.systems.servo.sampled_pid import SampledPid

BENT = np.array([0.2, 0.7, -0.3, 1.7, 0.2, -0.9, 0.4])  # rad
Q = np.array([-1.2, -0.7])  # rad, of the planar arm
TOOL = ToolParams(mass=0.3, centre_of_mass=(0.0, 0.0, 0.0), inertia=(1e-4, 1e-4, 1e-4))
WATCH = DivergenceParams(watched=(Watched((0, 1), 1.0), Watched((2,), 1.0)), size=3, factor=3.0)
REMOTE = AccommodationParams(centre=(0.005, 0.0, 0.01), damping=(4.0, 4.0, 4.0, 1e3, 1e3, 1e3))
MASSIVE = AdmittanceParams(
    damping=(4.0,) * 3 + (1e3,) * 3, inertia=(0.001,) * 3 + (0.5,) * 3, spring=(10.0,) * 6
)
TOUCH = ContactDetectionParams(detect=0.5, release=0.1, samples=2)
FSM = CompensatorParams(axes=(AxisParams(dead_zone=0.1, large_error=1.0, increment=0.02),) * 2)
PID = SampledPidParams(axes=(PidGains(proportional=1.0, integral=2.0, derivative=0.1),) * 2)
HYBRID = HybridControllerParams(
    stiffness=40.0, integral=20.0, damping=6.0, force_integral=3.0, feedforward_torque=()
)
OBSERVER = ResolvedSurfaceObserverParams(
    stiffness=((900.0, 0.0), (0.0, 900.0)), force_noise=0.1, force_rate_noise=1.0, rate_lag=0.0
)
Draw = Callable[[Generator, str, int], Any]


def mostly(**others: Callable[[Generator], Any]) -> Draw:
    """Return how inputs are drawn: standard normal, but for some."""

    def draw(drawn: Generator, name: str, size: int) -> Any:
        return others[name](drawn) if name in others else drawn.normal(size=size)

    return draw


def flag(drawn: Generator) -> Any:
    return drawn.integers(0, 2)


def unit(drawn: Generator) -> Any:
    angle = drawn.normal(1.5, 0.1)
    return np.cos(angle), np.sin(angle)


def about(q: np.ndarray) -> Callable[[Generator], Any]:
    """Return how joint positions and velocities are drawn."""
    return lambda drawn: np.append(q, 0 * q) + drawn.normal(0.0, 0.1, 2 * len(q))


BLOCKS: dict[str, tuple[LawBlock[Any], Draw]] = {
    "accommodation": (
        AccommodationController(REMOTE),
        mostly(damping=lambda drawn: drawn.integers(0, 3, 6) * 4000.0),
    ),
    "admittance": (
        AdmittanceController(MASSIVE),
        mostly(damping=lambda drawn: drawn.integers(0, 3, 6) * 4000.0),
    ),
    "compensator": (TrajectoryCompensator(FSM), mostly(valid=flag)),
    "contact": (ContactDetection(TOUCH, np.array([1.0, 2.0]), period=0.1), mostly()),
    "divergence": (DivergenceWatch(WATCH), mostly(valid=flag, blind=flag)),
    "hybrid": (
        HybridController(PLANAR_TWO_LINK, HYBRID),
        mostly(
            encoders=about(Q),
            selection=lambda drawn: [1.0, 0.0, 0.0, 0.0],
            mode=lambda drawn: drawn.integers(0, 3),
        ),
    ),
    "impedance": (
        ImpedanceController(ArmModel(RigidTransform(), TOOL), BENT, ImpedanceControllerParams()),
        mostly(encoders=about(BENT)),
    ),
    "observer": (
        SurfaceObserver(OBSERVER, np.array([0.0, 1.0])),
        mostly(
            restart=lambda drawn: drawn.random() > 0.9,
            predicted_normal=unit,
            measured_force=lambda drawn: drawn.normal(10.0, 1.0, 2),
        ),
    ),
    "pid": (SampledPid(PID), mostly(valid=flag)),
    "selector": (MeasurementSelector(3), mostly(valid=flag, open=flag)),
    "tare": (Tare(period=0.5, size=6), mostly(tare=flag)),
}


@pytest.mark.parametrize("name", BLOCKS)
def test_a_law_is_its_block(name: str) -> None:
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
        seen = law.observe(values)
        if k == 0:
            simulator.Initialize()
            if isinstance(block, ImpedanceController):  # it steps before the time begins too
                state, _ = law.step(state, seen, 0.0)
        state, command = law.step(state, seen, k * law.period)
        simulator.AdvanceTo((k + 0.5) * law.period)
        if not isinstance(law, HeldLaw):  # what follows the inputs at once, after the step
            command = law.step(state, seen, context.get_time())[1]
        for one in law.outputs:
            found = block.GetOutputPort(one).Eval(context).tolist()
            assert found == np.asarray(getattr(command, one)).tolist(), (k, one)


def test_laws_are_there_at_once() -> None:
    settings = tomllib.loads(Path(__file__).parents[2].joinpath("pyproject.toml").read_text())
    contracts = settings["tool"]["importlinter"]["contracts"]
    (laws,) = (one for one in contracts if one["name"] == "laws know no Drake")
    heavy = {"pydrake", "scipy", "cv2", "numba", "matplotlib"}
    code = f"import sys, {', '.join(laws['source_modules'])}; print({heavy} & set(sys.modules))"
    found = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert found.stdout == "set()\n"
