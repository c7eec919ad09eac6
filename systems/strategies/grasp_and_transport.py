"""Grasp and transport with cameras, the first two phases of both strategies (section 4).

Source: Morrow, Nelson and Khosla: open, ``vis_xz`` to the grasp's set-point, close, and with
cameras to a point above the mate. The approach along y while ``vis_xz`` holds, and the lift, are
reconstructed, as are all numbers. So is the retry of fingers that close on nothing: they open and
close again all around.
"""

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from chamfer.models.validation import require_all_positive, require_not_negative, require_positive
from chamfer.systems.primitives.position_primitives import Held, Place
from chamfer.systems.primitives.primitive import Primitive
from chamfer.systems.primitives.skill import Retry, SkillState
from chamfer.systems.primitives.trajectory_primitives import AXES
from chamfer.systems.primitives.vision_primitives import VisTranslation
from chamfer.systems.primitives.visual_servoing import Servoing, StaticCameras
from chamfer.systems.strategies.face_and_search import STIFF, tare, up

PLUG: Final = 0  # places of the parts in the detections
SOCKET: Final = 1
GRIPPER: Final = 2
PLUG_TOP: Final = 3  # the plug again, seen from its other end
PARTS: Final = 4
GRASP: Final = "grasp"  # the state in which the gripper closes
TRANSPORT: Final = "transport"  # the last one
# Where the fingers close again, one after the other.
_AROUND: Final = ((0, 0, 1), (0, 0, -1), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0))


@dataclass(frozen=True, kw_only=True)
class GraspAndTransportParams:
    """Parameters of grasp and transport; all of them are assumed."""

    mark: float = 0.036  # m, of the mark on the gripper above the tip of the plug in it
    top: float | None = None
    # m, of the plug's upper end above its tip; None: derived, from its outline
    weight: float | None = None
    # N, of the plug in the gripper; less than half of it means lost; None: derived, and 0, not
    # weighed, for fingers that detect a part
    weighing_time: float = 2.0  # s, of the weighing, and of the tare before it
    closing_time: float = 0.3  # s, for the fingers to close
    around: float = 0.0035  # m, to all sides, of the places where they close again after a miss
    lift: float = 0.025  # m, up, of the grasped plug before the transport
    speed: float = 0.05  # m/s, at most, of every motion
    tolerance: float = 0.5  # pixels, small error in each image
    timeout: float = 15.0  # s, of every state

    def __post_init__(self) -> None:
        require_all_positive(self, "weight")
        require_positive(self, "top")
        require_not_negative(self, "weight")

    def resolved(self, *, top: float, weight: float) -> "ResolvedGraspAndTransportParams":
        """Return the parameters with these values in the fields that are open."""
        found = {"top": top, "weight": weight}
        given = {name: value for name, value in vars(self).items() if value is not None}
        return ResolvedGraspAndTransportParams(**found | given)


@dataclass(frozen=True, kw_only=True)
class ResolvedGraspAndTransportParams(GraspAndTransportParams):
    """Parameters of grasp and transport; nothing is open."""

    top: float
    weight: float


def make_grasp_and_transport(
    params: ResolvedGraspAndTransportParams,
    cameras: StaticCameras,
    servoing: Servoing,
    *,
    above: tuple[float, float, float],
    then: str,
) -> tuple[SkillState, ...]:
    """Return the states; ``above``, m, is the place of the plug's tip after the transport."""
    to_plug = VisTranslation(
        axes=("x", "z"),
        cameras=cameras,
        moved=GRIPPER,
        # The nearer the better: the way between them is as wrong as the cameras' focal lengths.
        target=PLUG_TOP,
        offset=(0.0, 0.0, params.mark - params.top),
        speed=params.speed,
        tolerance=params.tolerance,
        servoing=servoing,
    )
    watched = Held(time=math.inf)
    weight = params.weight

    def state(name: str, *run: Primitive, then: str, **fields: Any) -> SkillState:
        on = {"done": then} | fields.pop("on", {})
        return SkillState(
            name=name, run=run, on=on, timeout=params.timeout, damping=STIFF, **fields
        )

    close = replace(to_plug, axes=("y",)), replace(to_plug, servoing=replace(servoing, ends=False))
    lift = up(params.lift, params.lift / params.speed)
    weigh = Held(wait=params.closing_time, time=params.weighing_time, weight=weight)
    again: Retry | None = None  # one place after the other
    for i in range(len(_AROUND), 0, -1):
        again = Retry(f"around {i}", 1, then=again)
    to_socket = replace(to_plug, axes=AXES, moved=PLUG, target=SOCKET, offset=above)
    return (
        state("reach", to_plug, then="close in", looks=True, grip="open"),
        state("close in", *close, then="zero" if weight else GRASP, looks=True),
        *([tare("zero", params.weighing_time, GRASP)] if weight else []),
        state(
            GRASP, Held(wait=params.closing_time), then="lift", on={"lost": again}, grip="close"
        ),
        *(
            state(
                f"around {i + 1}",
                Place(offset=_scaled(np.subtract(place, before), params.around)),
                then=GRASP,
                grip="open",
            )
            for i, (before, place) in enumerate(pairwise(((0, 0, 0), *_AROUND)))
        ),
        state("lift", lift, watched, then="weigh" if weight else TRANSPORT),
        *([state("weigh", weigh, then=TRANSPORT)] if weight else []),
        state(TRANSPORT, to_socket, watched, then=then, looks=True),
    )


def _scaled(way: NDArray[np.int64], by: float) -> tuple[float, float, float]:
    x, y, z = (by * way).tolist()
    return x, y, z
