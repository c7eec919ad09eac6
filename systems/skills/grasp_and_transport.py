"""Grasp and transport by sight, the first two phases of both strategies (section 4).

Source: Morrow, Nelson and Khosla: open, ``vis_xz`` to the grasp's set-point, close, and by sight
to a point above the mate. The approach along y while ``vis_xz`` holds, and the lift, are
reconstructed, as are all numbers.
"""

import math
from dataclasses import dataclass, replace
from typing import Final

from models.validation import ParameterError, require_positive
from systems.skills.skill import SkillState
from systems.skills.trajectory_primitives import MoveDx
from systems.skills.vision_primitives import VisTranslation
from systems.skills.visual_servoing import Servoing, StaticCameras

PLUG: Final = 0  # places of the parts in the detections
SOCKET: Final = 1
GRIPPER: Final = 2
PARTS: Final = 3
GRASP: Final = "grasp"  # the state in which the gripper closes


@dataclass(frozen=True, kw_only=True)
class GraspAndTransportParams:
    """Parameters of grasp and transport; all of them are assumed."""

    mark: float = 0.036  # m, of the mark on the gripper above the tip of the plug in it
    closing_time: float = 0.3  # s, that the fingers get to close
    lift: float = 0.025  # m, up, of the grasped plug before the transport
    speed: float = 0.05  # m/s, at most, of every motion
    tolerance: float = 0.5  # pixels, error in each image that is small
    timeout: float = 15.0  # s, of every state

    def __post_init__(self) -> None:
        require_positive(self, "mark", "closing_time", "lift", "speed", "tolerance", "timeout")


def make_grasp_and_transport(
    params: GraspAndTransportParams,
    cameras: StaticCameras,
    servoing: Servoing,
    *,
    above: tuple[float, float, float],
    then: str,
) -> tuple[SkillState, ...]:
    """Return the states.

    Args:
        params: Speeds and tolerances.
        cameras: As they are believed to be.
        servoing: How fast, and when it ends.
        above: Where the plug's tip is to be over the socket's face after the transport, m.
        then: The state that follows.

    Raises:
        ParameterError: If ``above`` is not three finite numbers.
    """
    if len(above) != 3 or not all(map(math.isfinite, above)):
        raise ParameterError("above", above, "three finite numbers")
    to_plug = VisTranslation(
        axes=("x", "z"),
        cameras=cameras,
        moved=GRIPPER,
        target=PLUG,
        offset=(0.0, 0.0, params.mark),
        speed=params.speed,
        tolerance=params.tolerance,
        servoing=servoing,
    )
    lift = MoveDx(
        displacement=(0.0, 0.0, 0.0, 0.0, 0.0, params.lift), duration=params.lift / params.speed
    )
    return (
        SkillState(
            name="reach",
            run=[to_plug],
            on={"done": "close in"},
            timeout=params.timeout,
            looks=True,
            grip="open",
        ),
        SkillState(
            name="close in",
            run=[
                replace(to_plug, axes=("y",)),
                replace(to_plug, servoing=replace(servoing, ends=False)),
            ],
            on={"done": GRASP},
            timeout=params.timeout,
            looks=True,
        ),
        SkillState(
            name=GRASP,
            run=[MoveDx(duration=params.closing_time)],
            on={"done": "lift"},
            timeout=params.timeout,
            grip="close",
        ),
        SkillState(name="lift", run=[lift], on={"done": "transport"}, timeout=params.timeout),
        SkillState(
            name="transport",
            run=[replace(to_plug, axes=("x", "y", "z"), moved=PLUG, target=SOCKET, offset=above)],
            on={"done": then},
            timeout=params.timeout,
            looks=True,
        ),
    )
