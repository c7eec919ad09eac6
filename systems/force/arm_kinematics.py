"""The kinematics of the arms of chapters 2 and 3 in machine code."""

from typing import Final

from chamfer.models.arms import adept_one, planar_two_link, puma_250
from chamfer.models.arms.arm import Kinematics
from chamfer.systems.compiled import compiled
from chamfer.systems.law import Array

_MODULES: Final = (planar_two_link, puma_250, adept_one)

_planar_endpoint = compiled(planar_two_link.endpoint)
_planar_jacobian = compiled(planar_two_link.jacobian)
_puma_endpoint = compiled(puma_250.endpoint)
_puma_jacobian = compiled(puma_250.jacobian)
_adept_endpoint = compiled(adept_one.endpoint)
_adept_jacobian = compiled(adept_one.jacobian)


def arm_index(arm: Kinematics) -> int | None:
    """Return the index of an arm for :func:`kinematics`, None of one that is not compiled."""
    for index, module in enumerate(_MODULES):
        if arm.endpoint is module.endpoint and arm.jacobian is module.jacobian:
            return index
    return None


@compiled
def kinematics(arm: int, q: Array) -> tuple[Array, Array]:
    """Return an arm's endpoint and Jacobian at joint positions q, shape (n,)."""
    if arm == 0:
        return _planar_endpoint(q), _planar_jacobian(q)
    if arm == 1:
        return _puma_endpoint(q), _puma_jacobian(q)
    return _adept_endpoint(q), _adept_jacobian(q)
