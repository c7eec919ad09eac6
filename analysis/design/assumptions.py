"""Lists the properties of an arm's model that no field of the scenario sets.

A value that the scenario sets is no assumption. A value is suspicious if it looks like a
placeholder. Geared arms have friction and rotors, viscous friction that leaves most of the torque
at full speed, and motors that are no stronger than needed.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final
from xml.etree import ElementTree

import numpy as np

from chamfer.analysis.design.design_words import percent
from chamfer.analysis.report.check_text import number
from chamfer.diagrams.cell.work_cell import ArmName, CellArmSettings, WorkCellScenario
from chamfer.models.arms.serial_arm import SerialArm
from chamfer.models.arms.urdf_arm import BUILT_IN, chosen_arm
from chamfer.models.recordings.recordings import PANDA

Values = tuple[float, ...]

_MOST_DAMPING: Final = 0.05  # s/rad, of a joint's largest torque; at 3 rad/s a seventh
_LEAST_HELD: Final = 0.02  # of a largest torque, that the weight of an arm takes of some joint
_GEARS: Final = "arms with gears have some, and do worse for it"


@dataclass(frozen=True)
class Assumption:
    """A property that the design assumes."""

    field: str  # path where it may be said; <arm>.model: in the file itself
    value: Values  # of each joint, or link
    unit: str
    says: str
    suspicious: bool


def assumptions(given: WorkCellScenario, resolved: WorkCellScenario) -> tuple[Assumption, ...]:
    """Return the assumptions about the arms of a scenario, as given and resolved."""
    found = (one for name in given.arms for one in _of_arm(name, given, resolved))
    return tuple(dict.fromkeys(found))


def _of_arm(
    name: ArmName, given: WorkCellScenario, resolved: WorkCellScenario
) -> Iterator[Assumption]:
    settings: CellArmSettings = getattr(given, name)
    there: CellArmSettings = getattr(resolved, name)
    arm, built_in = chosen_arm(settings.model, settings.tool_frame), settings.model in BUILT_IN
    whose = "assumed, not published" if built_in else "by the file"
    torque, friction, rotors = arm.torque_limits, arm.dry_friction, arm.rotor_inertia
    if settings.joint_friction == "panda":
        theirs = "measured of another one, mean of forward and backward"
        theirs = f"{theirs} ({PANDA.authors}, {PANDA.source}, {PANDA.licence})"
        rubs = there.arm.dry_friction
        yield _assumed(f"{name}.joint_friction", "dry friction of a Panda", rubs, "N m", theirs)
    elif settings.joint_friction is None and given.servo is None:
        doubt = _first(
            (not any(friction), _GEARS),
            (_alike(friction) and not _alike(torque), "the same for unlike motors, placeholders?"),
        )
        yield _assumed(f"{name}.joint_friction", "dry friction", friction, "N m", whose, doubt)
    if settings.rotor_inertia is None and not built_in and given.servo is None:
        field, doubt = f"{name}.rotor_inertia", _first((not any(rotors), _GEARS))
        yield _assumed(field, "inertia of rotors", rotors, "kg m^2", whose, doubt)
    if given.impedance.torque_limits is None:
        weight = np.abs(there.known_arm().evaluate(resolved.rest_posture(name)).gravity)
        held = float(np.max(weight / torque))
        doubt = _first(
            (held < _LEAST_HELD, f"the weight takes {percent(held)} of them, placeholders?"),
            (_alike(torque), "the same for all joints, placeholders?"),
        )
        what = f"largest torques of {arm.name}"
        yield _assumed("impedance.torque_limits", what, torque, "N m", whose, doubt)
    if not built_in:
        if there.joint_damping is None and given.servo is None:
            yield _damping(f"{name}.joint_damping", arm, whose)
        yield from _of_file(f"{name}.model", arm)


def _damping(field: str, arm: SerialArm, whose: str) -> Assumption:
    """Return the viscous friction of the joints in a URDF."""
    damping = tuple(_number(one.find("dynamics"), "damping") for one in _moving(arm))
    share = float(np.max(np.divide(damping, arm.torque_limits)))
    takes = f"at 1 rad/s up to {percent(share)} of a largest torque, a placeholder?"
    doubt = _first((share > _MOST_DAMPING, takes))
    return _assumed(field, "damping of the joints", damping, "N m s/rad", whose, doubt)


def _moving(arm: SerialArm) -> list[ElementTree.Element]:
    joints = {one.get("name"): one for one in ElementTree.fromstring(arm.urdf).findall("joint")}
    return [joints[name] for name in arm.joint_names]


def _of_file(field: str, arm: SerialArm) -> Iterator[Assumption]:
    """Yield properties of a URDF that no field of a scenario overrides."""
    root, whose = ElementTree.fromstring(arm.urdf), "by the file"
    moving = _moving(arm)
    speed = tuple(_number(one.find("limit"), "velocity") for one in moving)
    if any(speed):
        yield _assumed(field, "limits of velocity", speed, "rad/s", "not used")
    endless = [one.get("name", "") for one in moving if one.get("type") == "continuous"]
    if endless:
        says = f"joints without an end, {', '.join(endless)}: taken to turn half a turn each way"
        yield Assumption(field, (), "", says, suspicious=False)
    for tag, attribute, unit in (("mass", "value", "kg"), ("inertia", "ixx", "kg m^2")):
        found = (_number(one, attribute) for one in root.iterfind(f"link/inertial/{tag}"))
        of = tuple(value for value in found if value)
        if _alike(of):
            doubt = "the same for all links, placeholders?"
            yield _assumed(field, f"{tag} of a link", of, unit, whose, doubt)


def _number(element: ElementTree.Element | None, attribute: str) -> float:
    return 0.0 if element is None else float(element.get(attribute, 0))


def _alike(values: Values) -> bool:
    return len(values) > 1 and values[0] > 0 and min(values) == max(values)


def _first(*doubts: tuple[bool, str]) -> str:
    return next((text for holds, text in doubts if holds), "")


def _assumed(
    field: str, what: str, value: Values, unit: str, whose: str, doubt: str = ""
) -> Assumption:
    ends = " to ".join(map(number, sorted({min(value), max(value)})))
    said = f"{ends} {unit}, {whose}" if any(value) else "none said, taken as none"
    says = f"{what}: {said}{'; ' if doubt else ''}{doubt}"
    return Assumption(field, value, unit, says, bool(doubt))
