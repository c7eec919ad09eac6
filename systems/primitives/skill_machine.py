"""The block that runs a skill."""

from typing import Final

from chamfer.systems.primitives.primitive import Observation, sensed_sizes
from chamfer.systems.primitives.skill import Skill
from chamfer.systems.primitives.skill_chart import SkillMemory, make_skill_chart
from chamfer.systems.primitives.skill_check import check_timing
from chamfer.systems.statechart.state_machine import MachineOutput, StateMachine

_SIZE: Final = 6


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
    each but the detections and ``holding``. ``velocity``, shape (6,), is V_cmd, rad/s above m/s;
    ``damping``, shape (6,), that of accommodation, 0 where it is its own; the others have size 1:
    ``closed`` says whether the gripper is told to be closed; ``looks`` triggers the cameras;
    ``tares`` is 1 while the force sensor takes its zero; ``retries`` is how often something was
    tried again; ``state`` the index of the chart's state.

    Args:
        skill: What to run.
        parts: What each camera looks for.
        period: s, between two ticks.

    Raises:
        ChartError: At construction if the skill can't be run.
        ParameterError: At construction if the period is not allowed; in a run, while the skill
            has not ended, if ``carriage``, ``motion``, ``wrench`` or ``perturbed`` is not finite.
    """

    def __init__(self, skill: Skill, *, parts: int, period: float) -> None:
        check_timing(skill, period)
        super().__init__(
            make_skill_chart(skill),
            inputs=Observation,
            sizes=sensed_sizes(parts),
            outputs={
                "velocity": MachineOutput(size=_SIZE, read=lambda memory: memory.velocity),
                "closed": MachineOutput(size=1, read=lambda memory: (float(memory.closed),)),
                "looks": MachineOutput(size=1, read=lambda memory: (float(memory.looks),)),
                "tares": MachineOutput(size=1, read=lambda memory: (float(memory.tares),)),
                "damping": MachineOutput(size=_SIZE, read=lambda memory: memory.damping),
                "retries": MachineOutput(
                    size=1,
                    read=lambda memory: (float(sum(count for _, count in memory.retries)),),
                ),
            },
            optional=("xz_detections", "yz_detections", "cross_section", "spread", "holding"),
            period=period,
        )
