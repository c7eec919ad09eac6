"""A log of a robot as arrays, in SI units, and the reader of its files."""

import math
import warnings
import zipfile
from collections.abc import Mapping
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
_FULL_TURN: Final = 2 * math.pi + 0.1  # rad
_NO_UNIT: Final = 0.01  # of a quaternion's length off 1
_FARTHEST: Final = {  # what a quantity may be at most, and the likely unit of one that is more
    "rotation": (_FULL_TURN, "deg"),
    "position": (10.0, "mm"),
    "reference_position": (10.0, "mm"),
    "velocity": (10.0, "mm/s"),
    "joint_position": (2 * _FULL_TURN, "deg"),
    "joint_velocity": (2 * _FULL_TURN, "deg/s"),
}
_LEVER: Final = 0.4  # m, of forces about the sensor, at most; recordings have 0.01 to 0.05 m
_CLIPPED: Final = 0.002  # share of the rows, and ten at least, in which a force is at its limit


@dataclass(frozen=True, kw_only=True)
class Log:
    """Recorded quantities, n rows; None: not recorded.

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

    def quantities(self) -> dict[str, Array]:
        """Return the recorded quantities by name."""
        return {name: of for name in QUANTITIES if (of := getattr(self, name)) is not None}


def read_log(path: Path, columns: Mapping[str, Chosen] | None = None) -> Log:
    """Return a log from CSV, Parquet, or an npz of arrays, its time from its first row on.

    Units are in its titles, ``force_x (N)``, or in Parquet in the fields' metadata, as in logs of
    this package; else they are SI units. ``columns`` are those whose titles are not as usual.

    Raises:
        UserError: If it can't be read, or what is in it can't be a log; it says where and why.
    """
    if path.suffix not in (".csv", ".parquet", ".npz"):
        raise UserError(f"{path} can't be read as a log, allowed: a file .csv, .parquet or .npz")
    file = _npz_columns(path) if path.suffix == ".npz" else _table_columns(path)
    said = columns or {}
    by_name = {one.name: one for one in file}
    arrays = {
        name: _array(name, [by_name[one] for one in names], said.get(name, Chosen(())), path)
        for name, names in choose([one.name for one in file], said, path).items()
    }
    rows = len(arrays["time"])
    for name, values in arrays.items():
        if len(values) != rows:
            raise UserError(f"{path}: {name} has {len(values)} rows, time has {rows}")
    if rows < _FEWEST:
        raise UserError(f"{path} has {rows} rows, allowed: {_FEWEST} or more")
    # A controller of this package may step twice at its start.
    start = 1 if arrays["time"][0] == arrays["time"][1] else 0
    arrays = {name: values[start:] for name, values in arrays.items()}
    _require_times(arrays["time"], path)
    _require_likely(arrays, path)
    return Log(**arrays)  # type: ignore[arg-type]  # arrays alone


class _Column(NamedTuple):
    """A column of a file."""

    name: str
    unit: str  # as its title or its metadata has it; empty: none
    values: Any  # of pyarrow or NumPy


def _table_columns(path: Path) -> list[_Column]:
    from chamfer.analysis.report.control_log import read_table, split_title

    table, found = read_table(path), []
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
    single = {name: of for name, of in arrays.items() if of.ndim and of.size == len(of)}
    found = [_Column(name, "", values.ravel()) for name, values in single.items()]
    tables = {name: values.T for name, values in arrays.items() if values.ndim == 2}
    return found + [
        _Column(f"{name}[{i}]", "", one) for name, of in tables.items() for i, one in enumerate(of)
    ]


def _array(quantity: str, columns: list[_Column], said: Chosen, path: Path) -> Array:
    """Return the values of a quantity, shape (n,) or (n, k), in its unit."""
    arrays = []
    for one in columns:
        numbers = np.asarray(one.values)
        if len(numbers) and numbers.dtype.kind not in "fiub":
            raise UserError(f"{path}: {one.name} is no column of numbers")
        shift = numbers[0] if quantity == "time" and len(numbers) else 0
        values = (numbers - shift).astype(np.float64)
        if not np.isfinite(values).all():
            row = int(np.argmin(np.isfinite(values)))
            raise UserError(f"{path}: {one.name} is no finite number in row {row + 1}")
        scale = 1.0  # of a quaternion
        if len(columns) != 4 or quantity != "rotation":
            scale = factor(quantity, said.unit or one.unit, path)
            if one.unit and scale != factor(quantity, one.unit, path):
                told = f"{one.name} has the unit {one.unit} in its title; {said.unit} is used"
                warnings.warn(told, stacklevel=2)
        arrays.append(scale * values)
    if len(rows := {len(one) for one in arrays}) > 1:
        raise UserError(f"{path}: {quantity} has columns of {min(rows)} to {max(rows)} rows")
    found = arrays[0] if quantity == "time" else np.column_stack(arrays)
    if quantity != "rotation" or len(columns) != 4:
        return found
    if (off := np.abs(np.linalg.norm(found, axis=1) - 1).max(initial=0.0)) > _NO_UNIT:
        raise UserError(
            f"{path}: rotation has quaternions whose length differs from 1 by {off:.3g}"
        )
    return np.asarray(Rotation.from_quat(np.roll(found, -1, axis=1)).as_rotvec())


def _require_times(time: Array, path: Path) -> None:
    steps = np.diff(time)
    if steps.min() <= 0:
        row = int(np.argmax(steps <= 0))
        raise UserError(
            f"{path}: time does not ascend, {time[row]:.9g} s after its start comes "
            f"{time[row + 1]:.9g} s, in row {row + 2}"
        )
    period, longest = float(np.median(steps)), float(steps.max())
    if period > _LONGEST:
        raise UserError(
            f"{path} has a row every {period:.3g} s, allowed: {_LONGEST:g} s; if its time is in "
            "ms, say --columns time=COLUMN:ms"
        )
    if longest > max(_GAP[0], _GAP[1] * period):
        raise UserError(
            f"{path} has a gap of {longest:.3g} s, {time[np.argmax(steps)]:.6g} s after its "
            f"start, where rows are {period:.3g} s apart: cut it there"
        )


def _require_likely(arrays: Mapping[str, Array], path: Path) -> None:
    """Refuse values that must be in another unit, and a sensor at its limit."""
    for name, (limit, unit) in _FARTHEST.items():
        values = arrays.get(name, np.zeros((1, 1)))
        most = np.abs(np.linalg.norm(values, axis=1) if name == "rotation" else values).max()
        if most > limit:
            own = QUANTITIES[name].unit
            raise UserError(
                f"{path}: {name} is up to {most:.4g} {own}, allowed: {limit:.3g} {own}; if it is "
                f"in {unit}, say --columns {name}=COLUMNS:{unit}"
            )
    force = arrays.get("force")
    if force is not None and not np.ptp(force, axis=0).any():
        raise UserError(f"{path}: force never changes: nothing was measured")
    if force is not None and "moment" in arrays:
        sizes = [np.linalg.norm(arrays[name].std(axis=0)) for name in ("moment", "force")]
        if (lever := sizes[0] / sizes[1]) > _LEVER:
            units = "lbf and lbf in, or N and N mm? Then say so with --columns"
            warnings.warn(f"moments are forces at a lever of {lever:.2g} m: {units}", stacklevel=2)
    for name in sorted(arrays.keys() & {"force", "moment"}):
        for axis, values in zip("xyz", arrays[name].T, strict=True):
            for limit, beyond in ((values.max(), "more"), (values.min(), "less")):
                if rows := _rows_at_limit(values, limit):
                    raise UserError(
                        f"{path}: {name} along {axis} is {limit:.5g} {QUANTITIES[name].unit} in "
                        f"{rows} rows and never {beyond}: the sensor is clipped there"
                    )


def _rows_at_limit(values: Array, limit: float) -> int:
    """Return the number of rows with a channel at its limit, 0 if that may be no limit.

    The reading of a channel at rest, or of one with few levels, is no limit. A limit is reached in
    steps of more than a few levels, and is at least half of the largest reading.
    """
    at, steps = values == limit, np.abs(np.diff(values))
    inside = np.flatnonzero(~at)
    if not len(inside) or abs(limit) < 0.5 * np.abs(values).max():
        return 0
    at[: inside[0]] = at[inside[-1] :] = False  # it begins or ends so
    if at.sum() < max(10, _CLIPPED * len(values)):
        return 0
    edges = np.quantile(steps[at[1:] != at[:-1]], 0.25, method="lower")
    return int(at.sum()) if edges > 3 * steps[steps > 0].min() else 0
