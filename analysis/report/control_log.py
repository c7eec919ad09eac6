"""Logs of a controller's inputs and outputs, as Parquet files with units in the columns.

A row is a step of its law: ``time`` in s, ``observation.<input>[i]`` and ``command.<output>[i]``;
null where an optional input was missing. The unit of a column is in its field's metadata, what
the log is of in the table's.
"""

import csv
import io
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq

from chamfer.analysis.scenario.errors import UserError
from chamfer.systems.law import Signal
from chamfer.systems.recording import AnyLaw, Record, Records

_SIDES: Final = ("observation", "command")


def _signals(law: AnyLaw) -> list[tuple[str, str, Signal]]:
    """Return the side, the name and what it is of each vector that a law reads and gives."""
    sides = zip(_SIDES, (law.inputs, law.outputs), strict=True)
    return [(side, *one) for side, signals in sides for one in signals.items()]


def log_bytes(records: Records, about: Mapping[str, Any]) -> bytes:
    """Return what a law saw and answered, as a file; the same steps give the same bytes.

    Args:
        records: Its steps.
        about: What the log is of; the table's metadata, texts or else JSON.
    """
    steps = list(records)
    units: dict[str, str] = {"time": "s"}
    columns: list[list[float | None]] = [[one.time for one in steps]]
    for side, name, signal in _signals(records.law):
        vectors = [getattr(one, side)[name] for one in steps]
        for i, unit in enumerate(signal.units):
            units[f"{side}.{name}[{i}]"] = unit
            columns.append([None if vector is None else vector[i] for vector in vectors])
    fields = [
        pa.field(name, pa.float64(), metadata={"unit": unit}) for name, unit in units.items()
    ]
    metadata = {
        name: value if isinstance(value, str) else json.dumps(value)
        for name, value in about.items()
    }
    table = pa.Table.from_arrays(
        [pa.array(one, pa.float64()) for one in columns],
        schema=pa.schema(fields, metadata=metadata),
    )
    file = io.BytesIO()
    pq.write_table(table, file, compression="zstd")
    return file.getvalue()


def read_log(path: Path) -> tuple[pa.Table, dict[str, Any]]:
    """Return a log, from Parquet, or CSV with units as ``observation.error[0] (m)``.

    Returns:
        Its table, and the experiment, controller, run, runs and overrides that it says it is of.

    Raises:
        UserError: If it can't be read.
    """
    table = read_table(path)
    try:
        told = {
            name.decode(): text.decode() for name, text in (table.schema.metadata or {}).items()
        }
        about: dict[str, Any] = {name: told.get(name) for name in ("experiment", "controller")}
        about |= {name: int(told.get(name, 1)) for name in ("run", "runs")}
        return table, about | {"overrides": json.loads(told.get("overrides", "[]"))}
    except ValueError as error:
        raise UserError(f"{path} can't be read as a log: {error}") from error


def read_table(path: Path) -> pa.Table:
    """Return a table from Parquet, or CSV with units as ``force_x (N)``; or raise a UserError."""
    try:
        if path.suffix == ".csv":
            return _read_csv(path)
        with path.open("rb") as file:
            return pq.read_table(file)
    except (OSError, ValueError, csv.Error, pa.ArrowException) as error:
        reason = getattr(error, "strerror", None) or error
        raise UserError(f"{path} can't be read as a log: {reason}") from error


def split_title(title: str) -> tuple[str, str]:
    """Return the name and the unit of a column's title, ``force_x (N)`` or ``force_x [N]``."""
    name, *units = re.findall(r"^(.*?)\s*(?:\((.*)\)|\[(\D.*)\])?\s*$", title)[0]
    return name, "".join(units).strip()


def _read_csv(path: Path) -> pa.Table:
    with path.open(encoding="utf-8-sig", newline="") as file:
        header = next(csv.reader(file), [])
    options = pyarrow.csv.ConvertOptions(null_values=[""])
    columns = pyarrow.csv.read_csv(path, convert_options=options).columns
    fields = [
        pa.field(name, column.type, metadata={"unit": unit})
        for (name, unit), column in zip(map(split_title, header), columns, strict=True)
    ]
    return pa.Table.from_arrays(columns, schema=pa.schema(fields))


def log_records(law: AnyLaw, table: pa.Table, path: Path) -> list[Record]:
    """Return the steps of a log as a law sees them.

    Commands and optional inputs may be missing. A controller may step twice at its first time.

    Raises:
        UserError: If it has no rows, lacks a column or has it twice, has one that is none of the
            law's, in another unit or without one, a time that does not ascend, or a number that
            is missing or not finite where it has to be; it names the column.
    """
    if not len(table):
        raise UserError(f"{path} has no rows")
    times = _column(table, "time", "s", Signal(finite=True), path)
    back = np.diff(times) < 0
    back[1:] |= np.diff(times)[1:] == 0
    if back.any():
        row = int(np.argmax(back)) + 1
        raise UserError(f"{path}: time is {times[row]} s in row {row + 1}, must ascend")
    known, sides = ["time"], {side: dict[str, list[Any]]() for side in _SIDES}
    for side, name, signal in _signals(law):
        names = [f"{side}.{name}[{i}]" for i in range(signal.size)]
        units = zip(names, signal.units, strict=True)
        vectors = np.ma.column_stack([_column(table, *one, signal, path) for one in units])
        lacks = np.any(np.ma.getmaskarray(vectors), axis=1)
        sides[side][name] = [None if lacks[i] else vectors.data[i] for i in range(len(times))]
        known += names
    for name in table.column_names:
        if name.partition(".")[0] in _SIDES and name not in known:
            raise UserError(f"{path}: column {name} is none of {', '.join(known)}")
    return [
        Record(time, *({name: one[i] for name, one in side.items()} for side in sides.values()))
        for i, time in enumerate(times.tolist())
    ]


def _column(table: pa.Table, name: str, unit: str, signal: Signal, path: Path) -> Any:
    """Return a column as a masked array."""
    required = not (signal.optional or name.startswith("command."))
    there = table.column_names.count(name)
    if not there and not required:
        return np.ma.array(np.zeros(len(table)), mask=True)
    if there != 1:
        must = f"must have one{f', in {unit}' if unit else ''}"
        raise UserError(f"{path} has {there or 'no'} columns {name}, {must}")
    own = (table.field(name).metadata or {}).get(b"unit", b"").decode()
    if own != unit:
        found, allowed = (f"in {one}" if one else "without a unit" for one in (own, unit))
        raise UserError(f"{path}: {name} is {found}, must be {allowed}")
    try:
        values = table[name].cast(pa.float64())
    except pa.ArrowException as error:
        raise UserError(f"{path}: {name} is {table.field(name).type}, must be numbers") from error
    missing, numbers = values.is_null().to_numpy(), values.to_numpy()
    wrong = (required & missing) | (signal.finite & ~missing & ~np.isfinite(numbers))
    if wrong.any():
        row = int(np.argmax(wrong))
        value = "missing" if missing[row] else numbers[row]
        raise UserError(f"{path}: {name} is {value} in row {row + 1}, must be a number")
    return np.ma.array(numbers, mask=missing)
