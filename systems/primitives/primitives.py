"""All primitives by name, as a skill in a file names them."""

from collections.abc import Mapping
from typing import Final

from chamfer.systems.primitives.force_primitives import (
    GuardedMove,
    Hold,
    Level,
    Obstructed,
    Stick,
)
from chamfer.systems.primitives.position_primitives import Centre, Held, Place, Way
from chamfer.systems.primitives.primitive import Primitive
from chamfer.systems.primitives.seating import Press, Seat
from chamfer.systems.primitives.spiral import Spiral
from chamfer.systems.primitives.trajectory_primitives import Dither, MoveDx
from chamfer.systems.primitives.vision_primitives import (
    FixedPointRotation,
    VisRotation,
    VisTranslation,
)
from chamfer.systems.primitives.visual_grasp import VisGrasp

PRIMITIVES: Final[Mapping[str, type[Primitive]]] = {
    one.__name__: one
    for one in (
        Centre,
        Dither,
        FixedPointRotation,
        GuardedMove,
        Held,
        Obstructed,
        Hold,
        Level,
        MoveDx,
        Place,
        Press,
        Seat,
        Spiral,
        Stick,
        VisGrasp,
        VisRotation,
        VisTranslation,
        Way,
    )
}
