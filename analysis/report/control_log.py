"""What a controller saw and answered, as a Parquet file whose columns have their units.

A row is a step of its law: ``time`` in s, ``observation.<input>[i]`` and ``command.<output>[i]``;
null where an optional input was missing. The unit of a column is in its field's metadata, what
the log is of in the table's.
"""

import csv
import io
import json
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq

from chamfer.analysis.scenario.errors import UserError
from chamfer.systems.recording import AnyLaw, Record, Records, signals

TIME: Final = "time"
SECOND: Final = "s"
_SIDES: Final = ("observation.", "command.")


def units(law: AnyLaw) -> dict[str, str]:
    """Return the unit of each column of a law's log by its name, in order."""
    return {TIME: SECOND} | {
        f"{name}[{i}]": unit
        for name, signal in signals(law).items()
        for i, unit in enumerate(signal.units)
    }


def log_table(
    law: AnyLaw, records: Records | Iterable[Record], about: Mapping[str, Any] | None = None
) -> pa.Table:
    """Return what a law saw and answered, as a table.

    Args:
        law: Whose inputs and outputs are the columns.
        records: Its steps in order.
        about: What the log is of; the table's metadata, texts or else JSON.
    """
    kept = records if isinstance(records, Records) else Records(law, records)
    columns = [pa.array(kept.times)]
    for _, vectors, missing in kept.vectors():
        columns += [pa.array(column, mask=missing) for column in vectors.T]
    fields = [
        pa.field(name, pa.float64(), metadata={"unit": unit}) for name, unit in units(law).items()
    ]
    metadata = {
        name: value if isinstance(value, str) else json.dumps(value)
        for name, value in (about or {}).items()
    }
    return pa.Table.from_arrays(columns, schema=pa.schema(fields, metadata=metadata))


def log_bytes(table: pa.Table) -> bytes:
    """Return the table as a file; the same table gives the same bytes."""
    file = io.BytesIO()
    pq.write_table(table, file, compression="zstd")
    return file.getvalue()


def read_log(path: Path) -> pa.Table:
    """Return the table of a log, from Parquet, or CSV with units as ``observation.error[0] (m)``.

    Raises:
        UserError: If it can't be read, or a column is there twice.
    """
    try:
        if path.suffix != ".csv":
            with path.open("rb") as file:
                table = pq.read_table(file)
        else:
            table = _read_csv(path)
    except (OSError, ValueError, pa.ArrowException) as error:
        reason = getattr(error, "strerror", None) or error
        raise UserError(f"{path} can't be read as a log: {reason}") from error
    for name in table.column_names:
        if table.column_names.count(name) > 1:
            raise UserError(f"{path}: column {name} is there twice")
    return table


def _read_csv(path: Path) -> pa.Table:
    with path.open(encoding="utf-8-sig", newline="") as file:
        header = next(csv.reader(file), [])
    options = pyarrow.csv.ConvertOptions(
        column_types=dict.fromkeys(header, pa.float64()), null_values=[""]
    )
    table = pyarrow.csv.read_csv(path, convert_options=options)
    fields = []
    for title in header:
        found = re.fullmatch(r"(.*?)\s*(?:\((.*)\))?\s*", title)
        assert found is not None
        unit = {} if found[2] is None else {"unit": found[2].strip()}
        fields.append(pa.field(found[1], pa.float64(), metadata=unit))
    return pa.Table.from_arrays(table.columns, schema=pa.schema(fields))


def about_log(table: pa.Table, path: Path) -> dict[str, Any]:
    """Return the experiment, controller, run, runs and overrides that a log says it is of.

    Raises:
        UserError: If they can't be.
    """
    metadata = {
        name.decode(): text.decode() for name, text in (table.schema.metadata or {}).items()
    }
    about: dict[str, Any] = {name: metadata.get(name) for name in ("experiment", "controller")}
    try:
        about |= {name: int(metadata.get(name, 1)) for name in ("run", "runs")}
        made = json.loads(metadata.get("overrides", "[]"))
        return about | {"overrides": [str(one) for one in made]}
    except (ValueError, TypeError) as error:
        raise UserError(f"{path} has no run or overrides in its metadata: {error}") from error


def log_records(law: AnyLaw, table: pa.Table, path: Path) -> Records:
    """Return the steps of a log as a law sees them.

    Commands and optional inputs may be missing. A controller may step twice at its first time.

    Raises:
        UserError: If it has no rows, lacks a column, has one that is none of the law's, in another
            unit or without one, a time that does not ascend, or a number that is missing or not
            finite where it has to be; it names the column.
    """
    known = units(law)
    for name in table.column_names:
        if name.startswith(_SIDES) and name not in known:
            raise UserError(f"{path}: column {name} is none of {', '.join(known)}")
    if not len(table):
        raise UserError(f"{path} has no rows")
    times = _column(table, TIME, SECOND, path, required=True, finite=True)
    gaps = np.diff(times.data)
    back = np.flatnonzero(np.append(gaps[:1] < 0, gaps[1:] <= 0))
    if len(back):
        row = int(back[0]) + 1
        raise UserError(f"{path}: time is {times[row]} s in row {row + 1}, must ascend")
    vectors = {}
    for name, signal in signals(law).items():
        required = name.startswith(_SIDES[0]) and not signal.optional
        columns = [
            _column(table, f"{name}[{i}]", unit, path, required=required, finite=signal.finite)
            for i, unit in enumerate(signal.units)
        ]
        lacks = np.logical_or.reduce([np.ma.getmaskarray(one) for one in columns])
        rows = np.column_stack([one.data for one in columns])
        vectors[name] = [None if none else row for none, row in zip(lacks, rows, strict=True)]
    records = Records(law)
    for i, time in enumerate(times.tolist()):
        seen, given = (
            {name.removeprefix(side): one[i] for name, one in vectors.items() if side in name}
            for side in _SIDES
        )
        records.append(Record(time, seen, given))
    return records


def _column(
    table: pa.Table, name: str, unit: str, path: Path, *, required: bool, finite: bool
) -> Any:
    """Return a column as a masked array."""
    if name not in table.column_names:
        if required:
            raise UserError(f"{path} has no column {name}{f', in {unit}' if unit else ''}")
        return np.ma.array(np.zeros(len(table)), mask=True)
    own = (table.field(name).metadata or {}).get(b"unit", b"").decode()
    if own != unit:
        found, allowed = (f"in {one}" if one else "without a unit" for one in (own, unit))
        raise UserError(f"{path}: {name} is {found}, must be {allowed}")
    try:
        values = table[name].cast(pa.float64())
    except pa.ArrowException as error:
        raise UserError(f"{path}: {name} is {table.field(name).type}, must be numbers") from error
    missing, numbers = values.is_null().to_numpy(), values.to_numpy()
    wrong = np.asarray((required & missing) | (finite & ~missing & ~np.isfinite(numbers)))
    if wrong.any():
        row = int(np.argmax(wrong))
        value = "missing" if missing[row] else numbers[row]
        raise UserError(f"{path}: {name} is {value} in row {row + 1}, must be a number")
    return np.ma.array(numbers, mask=missing)
