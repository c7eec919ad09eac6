"""Skills as YAML, read and written without Drake: also next to a robot."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.plain_data import plain_data
from chamfer.analysis.scenario.scenario_yaml import block, read_mapping
from chamfer.analysis.skills.skill_expansion import Primitives, SkillReader
from chamfer.systems.primitives.primitive import Primitive
from chamfer.systems.primitives.skill import PRIMITIVES, Skill
from chamfer.systems.primitives.skill_law import make_skill_chart
from chamfer.systems.statechart.chart import ChartError


def read_skill(path: Path, primitives: Primitives = PRIMITIVES) -> Skill:
    """Return the checked skill of a YAML file; it may name the ``primitives``.

    Raises:
        UserError: If the file can't be read, or holds no skill that can be run.
    """
    try:
        return skill_of(read_mapping(path, "skill fields"), primitives)
    except UserError as error:
        text = str(error)
        raise UserError(text if text.startswith(str(path)) else f"{path}: {text}") from error


def skill_of(plain: Mapping[Any, Any], primitives: Primitives = PRIMITIVES) -> Skill:
    """Return the skill of plain data, checked as by :func:`read_skill`."""
    skill = SkillReader(primitives).skill(plain)
    try:
        make_skill_chart(skill)
    except ChartError as error:
        raise UserError(str(error)) from error
    return skill


def skill_text(skill: Skill, primitives: Primitives = PRIMITIVES) -> str:
    """Return the YAML that :func:`read_skill` reads as an equal skill."""
    return block(plain_data(skill, named={Primitive: primitives}, omit_defaults=True))
