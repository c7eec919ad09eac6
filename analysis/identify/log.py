"""A log of a robot as arrays, in SI units, and the files that it may come from."""

import math
import warnings
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from chamfer.analysis.identify.log_columns import QUANTITIES, Chosen, choose, factor
from chamfer.analysis.scenario.errors import UserError

Array = NDArray[np.float64]
WrenchAxes = Literal["tool", "base"]

_FEWEST: Final = 200  # rows
_LONGEST: Final = 1.0  # s, between two rows: beyond it the unit is wrong
_GAP: Final = 0.1, 10.0  # s and periods, both: a longer one is a gap
_FULL_TURN: Final = 2 * math.pi + 0.1  # rad, of a rotation vector, at most
_FARTHEST: Final = {  # what a quantity may be at most; in which unit it is likely where it is more
    "position": (10.0, "mm"),  # m
    "reference_position": (10.0, "mm"),
    "velocity": (10.0, "mm/s"),
    "joint_position": (2 * _FULL_TURN, "deg"),
    "joint_velocity": (2 * _FULL_TURN, "deg/s"),
}
_CLIPPED: Final = 0.002  # share of the rows, and ten at least, in which a force is at its limit


@dataclass(frozen=True, kw_only=True)
class Log:
    """What was recorded, n rows; None: it was not.

    Forces are those of the surface on the tool, in the axes in which they were recorded: the
    sensor's (``wrench_axes="tool"``: they turn with the tool) or fixed ones (``"base"``).
    """

    time: Array  # (n,), s, ascending
    force: Array | None = None  # (n, 3), N
    moment: Array | None = None  # (n, 3), N m
    position: Array | None = None  # (n, 3), m, of the tip in the base's axes
    rotation: Array | None = None  # (n, 3), rad, rotation vector, of the tool in the base
    velocity: Array | None = None  # (n, 3), m/s, of the tip
    reference_position: Array | None = None  # (n, 3), m, the impedance's reference
    joint_position: Array | None = None  # (n, k), rad
    joint_velocity: Array | None = None  # (n, k), rad/s
    joint_torque: Array | None = None  # (n, k), N m, of the motors
    wrench_axes: WrenchAxes | None = None  # of force and moment; None: not known

    @property
    def period(self) -> float:
        """The median time between two rows, s."""
        return float(np.median(np.diff(self.time)))

    def quantities(self) -> Iterator[tuple[str, Array]]:
        """Yield what was recorded by name."""
        for name in QUANTITIES:
            if (values := getattr(self, name)) is not None:
                yield name, values


def read_log(path: Path, columns: Mapping[str, Chosen] | None = None) -> Log:
    """Return a log from CSV, Parquet, or an npz of arrays, its time from its first row on.

    Args:
        path: The file. Units are in its titles, ``force_x (N)``, or in Parquet in the fields'
            metadata, as in logs of this package; else they are SI units.
        columns: The columns of quantities whose titles are not as usual.

    Raises:
        UserError: If it can't be read, or what is in it can't be a log; it says where and why.
    """
    said = columns or {}
    reader = {".npz": _npz_columns, ".csv": _table_columns, ".parquet": _table_columns}
    if path.suffix not in reader:
        raise UserError(f"{path} can't be read as a log, allowed: a file .csv, .parquet or .npz")
    file = reader[path.suffix](path)
    found = choose([one.name for one in file], said, path)
    by_name = {one.name: one for one in file}
    arrays = {
        name: _array(name, [by_name[one] for one in names], said.get(name), path)
        for name, names in found.items()
    }
    _require_whole(arrays, path)
    start = 1 if arrays["time"][0] == arrays["time"][1] else 0
    # A controller of this package may step twice at its start.
    arrays = {name: values[start:] for name, values in arrays.items()}
    _require_times(arrays["time"], path)
    if arrays.get("rotation", np.empty((0, 3))).shape[1] == 4:
        arrays["rotation"] = _rotation_vectors(arrays["rotation"], path)
    _require_likely(arrays, path)
    return Log(**arrays)  # type: ignore[arg-type]  # arrays alone


class _Column(NamedTuple):
    """A column of a file."""

    name: str
    unit: str  # as its title or its metadata has it; empty: none
    values: Any  # of pyarrow or NumPy


def _table_columns(path: Path) -> list[_Column]:
    from chamfer.analysis.report.control_log import read_table, split_title

    table = read_table(path)
    found = []
    for field, values in zip(table.schema, table.columns, strict=True):
        name, unit = split_title(field.name)
        known = (field.metadata or {}).get(b"unit", b"").decode()
        found.append(_Column(name, known or unit, values))
    return found


def _npz_columns(path: Path) -> list[_Column]:
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
    except (OSError, ValueError, EOFError, zipfile.BadZipFile, AttributeError, TypeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise UserError(f"{path} can't be read as a log: {reason}") from error
    found = []
    for name, values in arrays.items():
        if values.ndim == 1:
            found.append(_Column(name, "", values))
        elif values.ndim == 2:
            found += [_Column(f"{name}[{i}]", "", one) for i, one in enumerate(values.T)]
    return found


def _array(quantity: str, columns: list[_Column], said: Chosen | None, path: Path) -> Array:
    """Return the values of a quantity, shape (n,) or (n, k), in its unit."""
    arrays = []
    for one in columns:
        try:
            numbers = np.asarray(one.values)
            if len(numbers) and numbers.dtype.kind not in "fiub":
                raise ValueError
            shift = numbers[0] if quantity == "time" and len(numbers) else 0
            values = (numbers - shift).astype(np.float64)
        except ValueError as error:
            raise UserError(f"{path}: {one.name} is no column of numbers") from error
        if not np.isfinite(values).all():
            row = int(np.argmin(np.isfinite(values)))
            raise UserError(f"{path}: {one.name} is no finite number in row {row + 1}")
        if len(columns) == 4 and quantity == "rotation":
            arrays.append(values)  # of a quaternion, without a unit
            continue
        told = said.unit if said is not None else ""
        if told and one.unit and factor(quantity, one.unit, path) != factor(quantity, told, path):
            warnings.warn(f"{one.name} says {one.unit}, it is taken to be {told}", stacklevel=2)
        arrays.append(values * factor(quantity, told or one.unit, path))
    rows = {len(one) for one in arrays}
    if len(rows) > 1:
        raise UserError(f"{path}: {quantity} has columns of {_sorted(rows)} rows")
    return arrays[0] if quantity == "time" else np.column_stack(arrays)


def _sorted(rows: set[int]) -> str:
    return " and ".join(map(str, sorted(rows)))


def _require_whole(arrays: Mapping[str, Array], path: Path) -> None:
    for name, values in arrays.items():
        if len(values) != len(arrays["time"]):
            raise UserError(
                f"{path}: {name} has {len(values)} rows, time has {len(arrays['time'])}"
            )
    if len(arrays["time"]) < _FEWEST:
        raise UserError(f"{path} has {len(arrays['time'])} rows, allowed: {_FEWEST} or more")


def _require_times(time: Array, path: Path) -> None:
    steps = np.diff(time)
    if steps.min() <= 0:
        row = int(np.argmax(steps <= 0))
        raise UserError(
            f"{path}: time does not ascend, {time[row]:.9g} s after its start comes "
            f"{time[row + 1]:.9g} s, in row {row + 2}"
        )
    period = float(np.median(steps))
    if period > _LONGEST:
        raise UserError(
            f"{path} has a row every {period:.3g} s, allowed: {_LONGEST:g} s; if its time is in "
            "ms, say --columns time=COLUMN:ms"
        )
    if (longest := steps.max()) > max(_GAP[0], _GAP[1] * period):
        at = float(time[int(np.argmax(steps))])
        raise UserError(
            f"{path} has a gap of {longest:.3g} s, {at:.6g} s after its start, where rows are "
            f"{period:.3g} s apart: cut it there"
        )


def _rotation_vectors(quaternions: Array, path: Path) -> Array:
    lengths = np.linalg.norm(quaternions, axis=1)
    if np.abs(lengths - 1).max() > 0.01:
        wrong = lengths[np.argmax(np.abs(lengths - 1))]
        raise UserError(f"{path}: rotation has a quaternion of length {wrong:.3g}, must be 1")
    return np.asarray(Rotation.from_quat(np.roll(quaternions, -1, axis=1)).as_rotvec())


def _require_likely(arrays: Mapping[str, Array], path: Path) -> None:
    """Refuse what can only be meant in another unit, and a sensor at its limit."""
    if "force" in arrays and not np.ptp(arrays["force"], axis=0).any():
        raise UserError(f"{path}: force never changes: nothing was measured")
    rotation = arrays.get("rotation")
    if rotation is not None and (most := np.linalg.norm(rotation, axis=1).max()) > _FULL_TURN:
        raise UserError(
            f"{path}: rotation is a vector of up to {most:.4g} rad, allowed: a turn; if it is in "
            "degrees, say --columns rotation=X,Y,Z:deg"
        )
    for name, (limit, unit) in _FARTHEST.items():
        if name in arrays and (most := np.abs(arrays[name]).max()) > limit:
            own = QUANTITIES[name].unit
            raise UserError(
                f"{path}: {name} is up to {most:.4g} {own}, allowed: {limit:.3g} {own}; if it is "
                f"in {unit}, say --columns {name}=COLUMNS:{unit}"
            )
    for name in ("force", "moment"):
        for axis, values in zip("xyz", arrays.get(name, np.empty((0, 3))).T, strict=True):
            for limit in (values.max(), values.min()) if len(values) else ():
                if rows := _rows_at_limit(values, limit):
                    beyond = "more" if limit > 0 else "less"
                    raise UserError(
                        f"{path}: {name} along {axis} is {limit:.5g} {QUANTITIES[name].unit} in "
                        f"{rows} rows and never {beyond}: the sensor is clipped there"
                    )


def _rows_at_limit(values: Array, limit: float) -> int:
    """Return in how many rows a channel is at its limit, 0 if it may well be none.

    What a channel reads at rest, or one of few levels, is no limit: it is reached in leaps of
    more than a few levels, and is half of the largest reading at least.
    """
    if abs(limit) < 0.5 * np.abs(values).max():
        return 0
    at = values == limit
    inside = np.flatnonzero(~at)
    at[: inside[0] if len(inside) else len(at)] = False
    at[inside[-1] if len(inside) else 0 :] = False
    steps = np.abs(np.diff(values))
    edges = steps[at[1:] != at[:-1]]
    if (
        at.sum() < max(10, _CLIPPED * len(values))
        or np.median(edges) <= 3 * steps[steps > 0].min()
    ):
        return 0
    return int(at.sum())
