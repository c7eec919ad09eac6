import re
from dataclasses import replace
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import pytest

from chamfer.analysis.design.assumptions import Assumption, assumptions
from chamfer.diagrams.cell.work_cell import (
    HOLE_ARM,
    PEG_ARM,
    CellArmSettings,
    WorkCellScenario,
    resolve_arms,
)
from chamfer.systems.force.arm_model import Placement
from chamfer.systems.force.impedance_law import ImpedanceControllerParams

FILE = Path(__file__).parents[2] / "models/arms/six_joints.urdf"
PEG = replace(PEG_ARM, model=str(FILE), base=Placement(position=(-0.75, 0.0, 0.0)))
FIXTURE = replace(HOLE_ARM, kind="fixture")
LIMITS = ImpedanceControllerParams(torque_limits=(100.0,) * 6)


def of(
    peg: CellArmSettings = PEG, impedance: ImpedanceControllerParams | None = None
) -> tuple[Assumption, ...]:
    cell = WorkCellScenario(
        peg=peg, hole=FIXTURE, impedance=impedance or ImpedanceControllerParams()
    )
    return assumptions(cell, resolve_arms(cell))


def test_what_a_file_brings_is_listed() -> None:
    assert [(one.field, one.says) for one in of()] == [
        ("peg.joint_friction", "dry friction: 0 to 0.2 N m, by the file"),
        ("peg.rotor_inertia", "inertia of rotors: 0 to 0.4 kg m^2, by the file"),
        ("impedance.torque_limits", "largest torques of six_joints: 30 to 130 N m, by the file"),
        ("peg.joint_damping", "damping of the joints: 0 to 0.1 N m s/rad, by the file"),
        ("peg.model", "limits of velocity: 3 to 4 rad/s, not used"),
        ("peg.model", "joints without an end, turn: taken to turn half a turn each way"),
    ]
    assert not any(one.suspicious for one in of())
    assert of()[0].value == (0.2, 0, 0.15, 0, 0, 0)


def test_what_is_set_is_no_assumption() -> None:
    said = replace(PEG, joint_friction=(0.1,) * 6, rotor_inertia=(0.0,) * 6)
    assert {one.field for one in of(said, LIMITS)} == {"peg.joint_damping", "peg.model"}
    said = replace(said, joint_damping=(0.1,) * 6)
    assert {one.field for one in of(said, LIMITS)} == {"peg.model"}


@pytest.mark.parametrize(
    ("old", "new", "field", "named"),
    [
        (
            'damping="0.1"',
            'damping="10"',
            "peg.joint_damping",
            "at 1 rad/s up to 8.33 % of a largest",
        ),
        (' friction="[^"]*"', "", "peg.joint_friction", "none said, taken as none; arms with"),
        ("(velocity=.*/>)", r'\1<dynamics friction="1"/>', "peg.joint_friction", "unlike motors"),
        ('inertia value="0.00004"', 'inertia value="0"', "peg.rotor_inertia", "arms with gears"),
        ('effort="[^"]*" v', 'effort="150" v', "impedance.torque_limits", "for all joints"),
        ('effort="(1..)" v', r'effort="\g<1>000" v', "impedance.torque_limits", "of them"),
        ('mass value="[^"]*"', 'mass value="1"', "peg.model", "mass of a link: 1 kg, by"),
        (
            'ixx="[^"]*" iyy="[^"]*" izz="[^"]*"',
            'ixx="1" iyy="1" izz="1"',
            "peg.model",
            "inertia of",
        ),
    ],
)
def test_what_is_suspicious_is_named(
    tmp_path: Path, old: str, new: str, field: str, named: str
) -> None:
    text, count = re.subn(old, new, FILE.read_text(encoding="utf-8"))
    assert count
    path = tmp_path / "arm.urdf"
    path.write_text(text, encoding="utf-8")
    (found,) = [one for one in of(replace(PEG, model=str(path))) if one.suspicious]
    assert found.field == field
    assert named in found.says


def test_two_equal_arms_have_one_line_where_one_field_says_it() -> None:
    cell = WorkCellScenario()
    found = assumptions(cell, resolve_arms(cell))
    assert [one.field for one in found] == [
        "peg.joint_friction",
        "impedance.torque_limits",
        "hole.joint_friction",
    ]


def test_a_maker_s_damping_is_named() -> None:
    try:
        package = distribution("example-robot-data")
    except PackageNotFoundError:
        pytest.skip("example-robot-data is not installed: pip install 'chamfer[robots]'")
    place = "cmeel.prefix/share/example-robot-data/robots/xarm_description/urdf/xarm7.urdf"
    base = Placement(position=(-0.6, 0.0, -0.2))
    found = of(replace(PEG_ARM, model=str(package.locate_file(place)), base=base))
    (damping,) = [one for one in found if one.says.startswith("damping")]
    assert damping.value == (10, 10, 5, 5, 5, 2, 2)
    assert "2 to 10 N m s/rad" in damping.says
    assert damping.suspicious
