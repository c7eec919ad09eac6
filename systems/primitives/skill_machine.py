"""The block that runs a skill."""

from chamfer.systems.primitives.primitive import Observation
from chamfer.systems.primitives.skill import Skill
from chamfer.systems.primitives.skill_law import SkillLaw, SkillMemory
from chamfer.systems.statechart.state_machine import StateMachine


class SkillMachine(StateMachine[Observation, SkillMemory]):
    """Runs a skill.

    .. pydrake_system::

        name: SkillMachine
        input_ports:
        - carriage
        - motion
        - wrench
        - xz_detections (optional)
        - yz_detections (optional)
        - cross_section (optional)
        - perturbed
        - spread (optional)
        - holding (optional)
        output_ports:
        - velocity
        - closed
        - looks
        - tares
        - damping
        - retries
        - state

    The inputs are those of :class:`~chamfer.systems.primitives.primitive.Observation`, shape (6,)
    each but the detections and ``holding``. Outputs:

    - ``velocity``, shape (6,): V_cmd, rad/s above m/s.
    - ``damping``, shape (6,): that of accommodation; 0 keeps its own.
    - ``closed``, size 1: 1 for a closed gripper.
    - ``looks``, size 1: triggers the cameras.
    - ``tares``, size 1: 1 while the force sensor is tared.
    - ``retries``, size 1: number of retries.
    - ``state``, size 1: index of the chart's state.

    Errors are those of the law.
    """

    def __init__(self, skill: Skill, *, parts: int, period: float) -> None:
        super().__init__(SkillLaw(skill, parts=parts, period=period))
