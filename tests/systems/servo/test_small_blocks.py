import math
from typing import Any, get_args

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Linearize, LogVectorOutput, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial
from scipy.linalg import expm

from chamfer.models.plants.servo_plant import Form, SpringMassDamperParams
from chamfer.systems.servo.backlash import Backlash
from chamfer.systems.servo.desired_trajectory import Sinusoid, Step, make_desired_trajectory
from chamfer.systems.servo.measurement_selector import MeasurementSelector
from chamfer.systems.servo.pid import PidParams, make_pid
from chamfer.systems.servo.servo_plant import make_plant, make_spring_mass_damper


def test_it_follows_at_a_distance_and_keeps_its_place_on_the_way_back() -> None:
    path = PiecewisePolynomial.ZeroOrderHold(
        [0.0, 1.0, 2.0, 3.0, 9.0], [[0.0, 5.0, 4.0, 1.0, 1.0]]
    )
    builder = DiagramBuilder()
    source = builder.AddSystem(TrajectorySource(path))
    play = builder.AddSystem(Backlash(1.0, period=0.25))
    builder.Connect(source.get_output_port(), play.get_input_port())
    log = LogVectorOutput(play.get_output_port(), builder, 0.5)
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(4.0)
    found = log.FindLog(simulator.get_context()).data()[0]
    assert found.tolist() == [0, 0, 4, 4, 4, 4, 2, 2, 2]


@pytest.mark.parametrize(
    ("opened", "valid", "first", "counts"),
    [((1, 1), 1, 3.0, 1), ((0, 1), 1, 3.0, 0), ((1, 1), 0, 3.0, 0), ((1, 0), 1, 0.0, 1)],
    ids=["open", "shut", "not valid", "without the first axis"],
)
def test_a_selector_lets_through_what_is_open(
    opened: tuple[int, int], valid: int, first: float, counts: int
) -> None:
    block = MeasurementSelector(3)
    context = block.CreateDefaultContext()
    block.GetInputPort("error").FixValue(context, [3.0, -2.0, 1.0])
    block.GetInputPort("valid").FixValue(context, [float(valid)])
    block.GetInputPort("open").FixValue(context, [float(one) for one in opened])
    assert block.GetOutputPort("error").Eval(context).tolist() == [first, -2.0, 1.0]
    assert block.GetOutputPort("valid").Eval(context)[0] == counts


@pytest.mark.parametrize(
    ("trajectory", "later"),
    [(Step(amplitude=0.3), 0.3), (Sinusoid(amplitude=0.3, frequency=2.0), 0.3 * math.sin(1.4))],
)
def test_a_trajectory_goes_on_by_itself(trajectory: Step | Sinusoid, later: float) -> None:
    source = make_desired_trajectory(trajectory)
    start = source.CreateDefaultContext().get_continuous_state_vector().CopyToVector()
    assert source.C() @ expm(0.7 * source.A()) @ start == pytest.approx([later])


S = 3.0 + 7.0j  # 1/s


def transfer(system: Any) -> complex:
    """Return a block's transfer function at S."""
    context = system.CreateDefaultContext()
    system.get_input_port(0).FixValue(context, [0.0])
    found = Linearize(system, context)
    A, B, C, D = found.A(), found.B(), found.C(), found.D()
    return complex((C @ np.linalg.solve(S * np.eye(len(A)) - A, B) + D)[0, 0])


def test_pid_is_eq_2() -> None:
    params = PidParams(proportional=3.0, integral=5.0, derivative=0.7, filter=11.0)
    expected = 3.0 + 5.0 / S + 0.7 * 11.0 / (1 + 11.0 / S)
    assert transfer(make_pid(params)) == pytest.approx(expected)


@pytest.mark.parametrize("form", get_args(Form))
def test_the_inner_loop_and_its_one_block_are_the_spring_mass_damper(form: Form) -> None:
    params = SpringMassDamperParams(mass=2.0, damping=30.0, stiffness=400.0)
    over = {"velocity": S, "position": 400.0, "compliance": 1.0}[form]
    expected = over / (2.0 * S**2 + 30.0 * S + 400.0)
    for make in (make_plant, make_spring_mass_damper):
        assert transfer(make(params, form)) == pytest.approx(expected)
