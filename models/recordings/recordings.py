"""Measurements of real robots: slides of an arm, tosses of a cube, friction of joints.

All were published by others and may be redistributed; the licences lie beside the files.
"""

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.models.validation import ParameterError

Array = NDArray[np.float64]

_FOLDER: Final = Path(__file__).parent
_BY_STROKE_AI: Final = (
    "github.com/StrokeAIRobotics/DiffusionBasedImpedanceLearning at 8c9b4ef, Data/Parkour"
)
_CUBE: Final = "github.com/DAIRLab/dair_pll at 523d372, assets/contactnets_cube"
_PANDA: Final = "github.com/taraknezevic/franka-friction-identification-dataset at 13ca991"


class Source(NamedTuple):
    """Source of a recording, and its licence."""

    what: str
    source: str
    authors: str
    licence: str  # the text is in the file LICENSE-... beside the recordings
    changes: str = ""  # to the published recording


# Slides: a KUKA iiwa under impedance control slides a tool over a table, 200 Hz. Columns of the
# files: time, s; force, N, and moment, N m, of the surface on the tool, base axes, z up, the
# sensor's offset still in; position, m, of the tip; virtual_position, m, the impedance's
# reference; rotation, the tool's, rotation vector, rad. That forces were recorded in pounds and in
# axes turned by -90 degrees about the flange's z is inferred, and undone.
_CUT: Final = "cut; force and moment taken as pounds and turned into the base's axes"
SLIDES: Final[Mapping[str, Source]] = {
    "table_a": Source(
        "slide over a table, LinearTable 14-09-45, 42 s", _BY_STROKE_AI, "StrokeAIRobotics",
        "MIT", _CUT,
    ),
    "table_b": Source(
        "slide over a table, LinearTable 14-39-49, 41 s", _BY_STROKE_AI, "StrokeAIRobotics",
        "MIT", _CUT,
    ),
    "table_press": Source(
        "nearly straight press, Circle 2025-03-25 14-19-22, 19 s", _BY_STROKE_AI,
        "StrokeAIRobotics", "MIT", _CUT,
    ),
    "free": Source(
        "free motion, Free 17-57-18, 14 s", _BY_STROKE_AI, "StrokeAIRobotics", "MIT", _CUT
    ),
}  # fmt: skip
TOSSES: Final = Source(
    "200 tosses of a cube of 0.1048 m and 0.37 kg on a board, 148 Hz", _CUBE,
    "Pfrommer, Halm and Posa; Bianchini, Halm, Matni and Posa", "BSD-3-Clause", "one file of all",
)  # fmt: skip
PANDA: Final = Source(
    "identified friction of a Franka Panda's joints", _PANDA, "Tara Knežević and co-authors",
    "CC-BY-4.0", "one table of the identified coefficients",
)  # fmt: skip

CUBE_WIDTH: Final = 0.1048  # m
CUBE_MASS: Final = 0.37  # kg
CUBE_INERTIA: Final = 8.1e-4  # kg m^2, about each axis
CUBE_GROUND: Final = -1.9e-3  # m, height of the board in the recording's frame
CUBE_RATE: Final = 148.0  # Hz


def slide_path(name: str) -> Path:
    """Return the file of a slide."""
    if name not in SLIDES:
        raise ParameterError("recording", name, f"{', '.join(SLIDES)}, or a log's file")
    return _FOLDER / f"{name}.npz"


class Toss(NamedTuple):
    """A tracked toss, n rows at 148 Hz, in the board's frame, z up."""

    number: int  # of the source
    orientation: Array  # (n, 4), unit quaternion w, x, y, z, of the cube
    position: Array  # (n, 3), m, of its centre
    angular_velocity: Array  # (n, 3), rad/s, in the cube's axes
    velocity: Array  # (n, 3), m/s


def tosses() -> list[Toss]:
    """Return the tosses of the cube."""
    with np.load(_FOLDER / "cube-tosses.npz", allow_pickle=False) as file:
        rows, start, numbers = file["data"].astype(np.float64), file["start"], file["toss"]
    return [
        Toss(int(number), *np.split(rows[a:b], (4, 7, 10), axis=1))
        for number, a, b in zip(numbers, start[:-1], start[1:], strict=True)
    ]


class JointFriction(NamedTuple):
    """Friction of n joints, (n,) each: Coulomb's, N m, and viscous, N m s/rad."""

    viscous: Array  # of both directions together
    coulomb: Array
    viscous_plus: Array  # where the joint turns forward
    coulomb_plus: Array
    viscous_minus: Array  # and backward
    coulomb_minus: Array

    @property
    def mean(self) -> Array:
        """Mean Coulomb friction of both directions, N m, of the fit by direction."""
        return (self.coulomb_plus + self.coulomb_minus) / 2

    @property
    def asymmetry(self) -> Array:
        """Coulomb friction forward minus backward, over their sum."""
        return (self.coulomb_plus - self.coulomb_minus) / (2 * self.mean)

    @property
    def damping(self) -> Array:
        """Mean viscous friction of both directions, N m s/rad, of the same fit."""
        return (self.viscous_plus + self.viscous_minus) / 2


def panda_friction() -> JointFriction:
    """Return the identified friction of the Panda's seven joints."""
    with (_FOLDER / "panda_friction.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return JointFriction(*(np.array([float(r[k]) for r in rows]) for k in JointFriction._fields))
