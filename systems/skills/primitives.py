"""All primitives by name, as a skill in a file names them."""

from collections.abc import Mapping
from typing import Final

from systems.skills.force_primitives import (
    GuardedMove,
    Hindered,
    Hold,
    Level,
    Stick,
)
from systems.skills.position_primitives import Centre, Held, Place, Way
from systems.skills.primitive import Primitive
from systems.skills.seating import Press, Seat
from systems.skills.spiral import Spiral
from systems.skills.trajectory_primitives import Dither, MoveDx
from systems.skills.vision_primitives import FixedPointRotation, VisRotation, VisTranslation
from systems.skills.visual_grasp import VisGrasp

PRIMITIVES: Final[Mapping[str, type[Primitive]]] = {
    one.__name__: one
    for one in (
        Centre,
        Dither,
        FixedPointRotation,
        GuardedMove,
        Held,
        Hindered,
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
