"""What the blocks of contact, and their parameters, are not."""

import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from chamfer.models.arms.arm import JointFrictionParams
from chamfer.models.arms.cartesian_manipulator import CartesianManipulatorParams
from chamfer.models.arms.planar_two_link import PLANAR_TWO_LINK
from chamfer.models.arms.puma_250 import PUMA_250
from chamfer.models.surfaces.graphs import Parabola
from chamfer.models.surfaces.planes import RippledPlane
from chamfer.models.surfaces.rounds import Circle
from chamfer.models.validation import ParameterError
from chamfer.systems.contact.arm_dynamics import ArmDynamics
from chamfer.systems.contact.arm_in_contact import (
    ArmInContact,
    ArmInContactParams,
    ContactParams,
    ContactPoint,
    Load,
    Scene,
)
from chamfer.systems.contact.cartesian_manipulator import make_cartesian_manipulator
from chamfer.systems.contact.sliding_contact import SlidingContact, SlidingContactParams
from chamfer.systems.contact.spring_constraint import SpringConstraint, SpringConstraintParams

TABLE = RippledPlane(point=(0.0, 0.0, -100.0))
Vector = tuple[float, float, float]
ORIGIN: Vector = (0.0, 0.0, 0.0)
INERTIA = 1e-5 * np.eye(3)
ROWS3 = ((100.0, 0.0, 0.0), (0.0, 100.0, 0.0), (0.0, 0.0, 100.0))


def arm(q: Any = (0.4, 0.6, -1.1), joints: int = 3, world: Any = TABLE, **changes: Any) -> Any:
    friction = JointFrictionParams(coulomb=(0.0,) * joints, viscous=(0.0,) * joints)
    params = ArmInContactParams(joint_friction=friction, **changes)
    return ArmInContact(PUMA_250, world, params, np.array(q))


def touches(offset: Vector = ORIGIN, surface: Any = TABLE) -> ContactPoint:
    return ContactPoint(offset, surface, ContactParams())


def manipulator(start: tuple[float, ...] = (0.0, 0.0), step: float = 0.001) -> Any:
    return make_cartesian_manipulator(CartesianManipulatorParams(), start=start, step=step)


def load(mass: float = 1.0, centre: Vector = ORIGIN, inertia: Any = INERTIA) -> Load:
    return Load(mass, centre, inertia)


def sliding(stiffness: Any) -> Any:
    return SlidingContact(Parabola(), SlidingContactParams(stiffness=stiffness))


def offset_arm(contact_offset: Vector) -> ArmDynamics:
    return ArmDynamics(PLANAR_TWO_LINK, contact_offset=contact_offset)


def constraint(**values: Any) -> SpringConstraint:
    return SpringConstraint(SpringConstraintParams(**values))


TWO_OR_THREE = "allowed: 2 rows of 2 numbers or 3 rows of 3"


@pytest.mark.parametrize(
    ("make", "values", "message"),
    [
        (arm, {"joints": 2}, "joint_friction.coulomb is (0.0, 0.0), allowed: 3 numbers"),
        (arm, {"q": [0.0, 1.0]}, "q is [0.0, 1.0], allowed: 3 finite numbers"),
        (arm, {"q": [0.0, math.nan, 0.0]}, "q is [0.0, nan, 0.0], allowed: 3 finite numbers"),
        (arm, {"world": ()}, "world is (), allowed: at least one scene"),
        (
            arm,
            {"world": [Scene((touches(),))], "contact_offset": (0, 0, 1.0)},
            "params.contact_offset is (0, 0, 1.0), allowed: (0.0, 0.0, 0.0), without effect where",
        ),
        (Scene, {"points": ()}, "points is (), allowed: at least one point"),
        (touches, {"offset": (0.0, math.nan, 0.0)}, "offset is (0.0, nan, 0.0), allowed"),
        (touches, {"surface": Circle(centre=(0.0, 0.0), radius=1.0)}, "surface is Circle("),
        (load, {"centre": (0.0, math.inf, 0.0)}, "centre is (0.0, inf, 0.0), allowed"),
        (load, {"inertia": -INERTIA}, "inertia is [["),
        (load, {"inertia": np.ones(3)}, "inertia is [1.0, 1.0, 1.0], allowed"),
        (offset_arm, {"contact_offset": (math.nan, 0, 0)}, "contact_offset is (nan, 0, 0), allow"),
        (manipulator, {"start": (0.0,)}, "start is (0.0,), allowed: 2 or 3 finite numbers"),
        (manipulator, {"start": (0.0, math.nan)}, "start is (0.0, nan), allowed: 2 or 3 finite"),
        (manipulator, {"step": 0.0}, "step is 0.0, allowed: a finite number > 0"),
        (sliding, {"stiffness": ROWS3}, f"stiffness is {ROWS3!r}, allowed: 2 rows, as the surfa"),
        (sliding, {"stiffness": ((100.0,),)}, f"stiffness is ((100.0,),), {TWO_OR_THREE}"),
        (sliding, {"stiffness": ((1.0, 1.0), (0.0, 1.0))}, "stiffness is ((1.0, 1.0), (0.0, 1.0)"),
        (sliding, {"stiffness": ((1.0, 0.0), (0.0, -1.0))}, "stiffness is ((1.0, 0.0), (0.0, -1."),
        (constraint, {"index": 6}, "index is 6, allowed: a whole number from 0 to 5"),
        (constraint, {"index": 3.5}, "index is 3.5, allowed: a whole number from 0 to 5"),
        (constraint, {}, "index is None, allowed: a whole number from 0 to 5"),
    ],
)
def test_is_named_in_a_line(
    make: Callable[..., Any], values: dict[str, Any], message: str
) -> None:
    with pytest.raises(ParameterError, match=f"^{re.escape(message)}") as caught:
        make(**values)
    assert "\n" not in str(caught.value)
