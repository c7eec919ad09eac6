"""What the dry friction of an arm's joints is at its tool."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class ToolFriction(NamedTuple):
    """Moments and forces along and about the axes, N m above N, shape (6,) each."""

    held: Array  # up to which no joint moves, if the tool is pushed so and not otherwise
    wound: Array  # that the joints take of a tool that moves so and not otherwise


def tool_friction(J_V_WT: Array, dry_friction: Array) -> ToolFriction:
    """Return what friction holds at rest, and what it takes of a motion.

    ``held`` is ``min_i tau_i / |J_i e|``. ``wound`` is the power that the joints lose over the
    speed, ``sum_i tau_i |(J^+ e)_i|``, with the joints' speeds of least norm: by so much springs
    are wound up once all joints slide. In between joint after joint gives way.

    Args:
        J_V_WT: The tool's Jacobian, rad/s above m/s, shape (6, n), in the axes that are asked for.
        dry_friction: Coulomb's, of each joint, N m, shape (n,).
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        alone = dry_friction / np.abs(J_V_WT)
    # A joint that the push does not turn holds it whatever its friction is.
    turned = np.abs(J_V_WT) > _SMALL * np.abs(J_V_WT).max()
    held = np.min(np.where(turned, alone, np.inf), axis=1)
    wound = dry_friction @ np.abs(np.linalg.pinv(J_V_WT))
    return ToolFriction(held, np.asarray(wound, np.float64))


_SMALL = 1e-6  # of the largest lever
