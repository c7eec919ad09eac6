"""A skill as a law: what it senses, what it commands, once a period."""

from typing import Final

from chamfer.systems.force.accommodation_law import DAMPING, VELOCITY
from chamfer.systems.primitives.primitive import STILL, Observation, sensed_signals
from chamfer.systems.primitives.skill import Skill
from chamfer.systems.primitives.skill_chart import SkillMemory, check_timing, make_skill_chart
from chamfer.systems.statechart.chart_law import ChartLaw, MachineOutput, number

_SIZE: Final = len(STILL)


class SkillLaw(ChartLaw[Observation, SkillMemory]):
    """Runs a skill.

    ``parts`` is how many parts each camera looks for; the period, s, is between two steps. A step
    may be missing or come late, as what a skill waits for counts time.

    Raises:
        ChartError: If the skill can't be run.
        ParameterError: If the period is not allowed; in a step, while the skill has not ended, if
            ``carriage``, ``motion``, ``wrench`` or ``perturbed`` is not finite.
    """

    def __init__(self, skill: Skill, *, parts: int, period: float) -> None:
        check_timing(skill, period)
        super().__init__(
            make_skill_chart(skill),
            observation=Observation,
            inputs=sensed_signals(parts),
            outputs={
                "velocity": MachineOutput(
                    size=_SIZE, unit=VELOCITY, read=lambda memory: memory.velocity
                ),
                **{name: number(name) for name in ("closed", "looks", "tares")},
                "damping": MachineOutput(
                    size=_SIZE, unit=DAMPING, read=lambda memory: memory.damping
                ),
                "retries": MachineOutput(
                    read=lambda memory: (float(sum(count for _, count in memory.retries)),),
                ),
            },
            period=period,
        )
