"""What the parameters of force control are not, each in one line."""

import math
import re
from typing import Any

import numpy as np
import pytest
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator

from chamfer.models.arms.planar_two_link import PLANAR_TWO_LINK
from chamfer.models.validation import ParameterError
from chamfer.systems.contact.arm_dynamics import ArmDynamics
from chamfer.systems.force.accommodation import AccommodationController
from chamfer.systems.force.accommodation_law import AccommodationParams
from chamfer.systems.force.arm_model import ArmModel, ToolParams
from chamfer.systems.force.contact_detection import ContactDetection
from chamfer.systems.force.contact_detection_law import ContactDetectionParams, make_contact_chart
from chamfer.systems.force.desired_pose import CompensatedPose, StoppableMotion
from chamfer.systems.force.friction_compensation import (
    FrictionCompensation,
    FrictionCompensationParams,
)
from chamfer.systems.force.hybrid_controller import AccelerationFeedforward, HybridController
from chamfer.systems.force.hybrid_law import HybridControllerParams
from chamfer.systems.force.impedance_controller import ImpedanceController, SpringForce
from chamfer.systems.force.impedance_law import ImpedanceControllerParams
from chamfer.systems.force.selection import Selection
from chamfer.systems.force.surface_motion import (
    GuardedMotionParams,
    SurfaceMotion,
    SurfaceMotionParams,
)

NAN, INF = math.nan, math.inf
VECTOR = "allowed: a finite vector other than zero"
SIX = (1e3,) * 5


def guarded(**changes: Any) -> Any:
    fine = {"start": (0.0, 0.0), "direction": (1.0, 0.0), "along": (0.0, 1.0), "speed": 1.0}
    return GuardedMotionParams(**{**fine, **changes})


def along(**changes: Any) -> Any:
    fine: dict[str, Any] = {"start": (0.0, 0.0), "period": 0.25}
    return SurfaceMotion(SurfaceMotionParams(), **{**fine, **changes})


def hybrid(**changes: Any) -> Any:
    gains: dict[str, Any] = {"stiffness": 1.0, "integral": 1.0, "damping": 1.0}
    fine = {**gains, "force_integral": 3.0, "feedforward_torque": ()}
    params = HybridControllerParams(**{**fine, **changes})
    model = ArmDynamics(PLANAR_TWO_LINK) if params.full_dynamics else None
    return HybridController(PLANAR_TWO_LINK, params, dynamics=model)


def tool(**changes: Any) -> Any:
    fine = {"mass": 0.4, "centre_of_mass": (0.0, 0.0, 0.0), "inertia": (1e-4, 3e-4, 3.5e-4)}
    return ToolParams(**{**fine, **changes})


def detection(direction: Any = (0.0, -1.0), **values: Any) -> Any:
    params = ContactDetectionParams(**{"detect": 2.0, "release": 0.5, "samples": 1, **values})
    return ContactDetection(params, np.array(direction), period=0.25)


def friction(**values: Any) -> Any:
    params = FrictionCompensationParams(**{"bandwidth": 20.0, **values})
    return FrictionCompensation(params, joints=2, period=0.005)


def motion(p_WT: Any = (0.0, 0.0, 0.0), duration: float = 2.0, period: float = 0.25) -> Any:
    return StoppableMotion(np.array(p_WT), RigidTransform(), duration, period)


def feedforward(period: float) -> Any:
    return AccelerationFeedforward(PLANAR_TWO_LINK, ArmDynamics(PLANAR_TWO_LINK), period=period)


def select(normal: Any) -> Any:
    return Selection(np.array(normal))


def open_chart() -> Any:
    return make_contact_chart(ContactDetectionParams(), np.array([1.0, 0.0]))


FULL = {"full_dynamics": True}
STEEP = {"damping": (399.0, *SIX), "stiffness": (1e4, *SIX), "period": 0.01}


@pytest.mark.parametrize(
    ("make", "values", "message"),
    [
        (guarded, {"direction": (1.0,)}, "direction is (1.0,), allowed: 2 numbers"),
        (guarded, {"along": (1.0, 0.0, 0.0)}, "along is (1.0, 0.0, 0.0), allowed: 2 numbers"),
        (guarded, {"direction": (0.0, 0.0)}, f"direction is [0.0, 0.0], {VECTOR}"),
        (guarded, {"along": (0.0, INF)}, f"along is [0.0, inf], {VECTOR}"),
        (along, {"start": (0.0,)}, "start is (0.0,), allowed: 2 or 3 finite numbers"),
        (along, {"axis": (0.0, 0.0, 0.0)}, f"axis is [0.0, 0.0, 0.0], {VECTOR}"),
        (along, {"axis": (0.1, 0.0, 1.0)}, "axis is (0.1, 0.0, 1.0), allowed: along z in two dim"),
        (hybrid, {"integral": (1.0,)}, "integral is (1.0,), allowed: 2 numbers, or one for all"),
        (hybrid, {"held_integrators": (0, 2)}, "held_integrators is (0, 2), allowed: indices bel"),
        (hybrid, {**FULL, "inertia": (1.0,)}, "inertia is (1.0,), allowed: 2 numbers"),
        (hybrid, {**FULL, "inertia": (1.0, 0.0)}, "inertia is (1.0, 0.0), allowed: finite numbe"),
        (hybrid, {"inertia": (1.0, 1.0)}, "inertia is (1.0, 1.0), allowed: None without full dyn"),
        (hybrid, FULL, "inertia is None, allowed: a value"),
        (hybrid, {**FULL, "law": "transpose"}, "law is 'transpose', allowed: inverse or projecte"),
        (hybrid, {"feedforward_torque": (1.0,)}, "feedforward_torque is (1.0,), allowed: 2 numbe"),
        (hybrid, {"feedforward_torque": (1.0, NAN)}, "feedforward_torque is (1.0, nan), allowed"),
        (hybrid, {"feedforward_torque": None}, "feedforward_torque is None, allowed: a value"),
        (feedforward, {"period": 0.0}, "period is 0.0, allowed: a finite number > 0"),
        (tool, {"inertia": (1.0, 1.0, 2.1)}, "inertia is (1.0, 1.0, 2.1), allowed: three numbers"),
        (tool, {"inertia": (1.0, 1.0, 0.0)}, "inertia is (1.0, 1.0, 0.0), allowed: three numbers"),
        (detection, {"release": 3.0}, "release is 3.0, allowed: less than detect, 2"),
        (detection, {"samples": 0}, "samples is 0, allowed: a whole number >= 1"),
        (detection, {"direction": (0.0, 0.0)}, f"direction is [0.0, 0.0], {VECTOR}"),
        (open_chart, {}, "detect is None, allowed: a value"),
        (friction, {"joints": (2,)}, "joints is (2,), allowed: different indices below 2"),
        (friction, {"joints": (1, 1)}, "joints is (1, 1), allowed: different indices below 2"),
        (motion, {"duration": 0.0}, "duration is 0.0, allowed: a finite number > 0"),
        (motion, {"period": NAN}, "period is nan, allowed: a finite number > 0"),
        (motion, {"p_WT": [0.0, NAN, 0.0]}, "p_WT is [0.0, nan, 0.0], allowed: three finite numb"),
        (CompensatedPose, {"share": NAN}, "share is nan, allowed: a finite number"),
        (SpringForce, {"stiffness": (1.0, 0.0, 1.0)}, "stiffness is (1.0, 0.0, 1.0), allowed: fi"),
        (select, {"normal": [0.0, 0.0]}, f"normal is [0.0, 0.0], {VECTOR}"),
        *(
            (ImpedanceControllerParams, values, message)
            for values, message in (
                ({"rotational_stiffness": (1.0, 1.0)}, "rotational_stiffness is (1.0, 1.0), allo"),
                ({"torque_limits": (1.0, 0.0)}, "torque_limits is (1.0, 0.0), allowed: 2 finite "),
            )
        ),
        *(
            (AccommodationParams, values, message)
            for values, message in (
                ({"damping": (1.0,) * 5}, "damping is (1.0, 1.0, 1.0, 1.0, 1.0), allowed: six nu"),
                ({"stiffness": (1.0,) * 7}, "stiffness is (1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0), a"),
                ({"centre": (0.0, 0.0)}, "centre is (0.0, 0.0), allowed: 3 finite numbers"),
                (STEEP, "damping of rx is 399.0, allowed: at least k T / 0.25 = 400 against a st"),
            )
        ),
    ],
)
def test_is_named_in_a_line(make: Any, values: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=f"^{re.escape(message)}") as caught:
        make(**values)
    assert "\n" not in str(caught.value)


def test_the_bounds_themselves_are_allowed() -> None:
    AccommodationParams(damping=(400.0, *SIX), stiffness=(1e4, *(0.0,) * 5), period=0.01)
    AccommodationParams(**STEEP, allow_unstable=True)  # type: ignore[arg-type]


def impedance() -> Any:
    model = ArmModel(RigidTransform(), tool())
    return ImpedanceController(
        model, np.array([0.2, 0.7, -0.3, 1.7, 0.2, -0.9, 0.4]), ImpedanceControllerParams()
    )


def accommodation() -> Any:
    # 0 times infinity
    return AccommodationController(AccommodationParams(damping=(INF,) * 6))


POSE = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
TICKED: dict[str, tuple[Any, dict[str, list[float]]]] = {
    "hybrid law": (
        hybrid,
        {
            "encoders": [0.5, 0.5, 0.0, 0.0],
            "desired_position": [1.0, 1.0],
            "desired_force": [0.0, 0.0],
            "measured_force": [0.0, 0.0],
            "selection": [1.0, 0.0, 0.0, 0.0],
            "mode": [1.0],
            "desired_velocity": [0.1, 0.0],
        },
    ),
    "impedance law": (
        impedance,
        {"encoders": [0.5] * 14, "desired_pose": POSE, "desired_velocity": [0.0] * 6},
    ),
    "accommodation": (accommodation, {"command": [0.0] * 6, "wrench": [0.0] * 6}),
    "surface motion": (along, {"endpoint_motion": [1.0, 2.0, 7.0, 7.0], "normal": [0.0, 1.0]}),
}


@pytest.mark.filterwarnings("ignore:invalid value")
@pytest.mark.parametrize("bad", [NAN, -INF])
@pytest.mark.parametrize(
    ("name", "port"), [(name, port) for name, (_, ports) in TICKED.items() for port in ports]
)
def test_an_input_that_is_not_finite_is_named(name: str, port: str, bad: float) -> None:
    make, inputs = TICKED[name]
    for index in range(len(inputs[port])):
        block = make()
        context = block.CreateDefaultContext()
        for one, value in inputs.items():
            given = list(value)
            if one == port:
                given[index] = bad
            block.GetInputPort(one).FixValue(context, given)
        simulator = Simulator(block, context)
        with pytest.raises(ParameterError, match=rf"^{port} is .*, allowed: finite numbers$"):
            simulator.AdvanceTo(1e-3)
