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
from numpy.typing import NDArray

from chamfer.analysis.scenario.errors import UserError
from chamfer.systems.law import Signal
from chamfer.systems.recording import AnyLaw, Record, Records, signals

TIME: Final = "time"
SECOND: Final = "s"


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
        about: What the log is of; the table's metadata.
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


def about_log(table: pa.Table) -> dict[str, Any]:
    """Return what a log says that it is of, nothing of a robot's."""
    metadata = {
        name.decode(): value.decode() for name, value in (table.schema.metadata or {}).items()
    }
    known = {
        name: metadata[name]
        for name in ("experiment", "controller", "scenario_sha256")
        if name in metadata
    }
    return known | {
        name: json.loads(metadata[name]) for name in ("run", "overrides") if name in metadata
    }


def log_records(law: AnyLaw, table: pa.Table, path: Path) -> Records:
    """Return the steps of a log as what a law reads and gives; commands may be missing.

    Raises:
        UserError: If it has no rows, lacks a column, has one that is none of the law's, in another
            unit or without one, a time that does not ascend, or a number that is missing or not
            finite where it has to be; it names the column.
    """
    expected = units(law)
    for name in table.column_names:
        if name.startswith(("observation.", "command.")) and name not in expected:
            raise UserError(f"{path}: column {name} is none of {', '.join(expected)}")
    if not len(table):
        raise UserError(f"{path} has no rows")
    times, _ = _column(table, TIME, SECOND, path)
    gaps = np.diff(times)
    # A controller may step twice before the time begins.
    wrong = ~(gaps > 0) & ~((gaps == 0) & (np.arange(len(gaps)) == 0))
    if not np.isfinite(times).all() or wrong.any():
        row = int(np.argmax(wrong)) + 1 if wrong.any() else int(np.argmin(np.isfinite(times)))
        raise UserError(f"{path}: time is {times[row]} s in row {row + 1}, must ascend")
    vectors = {
        name: _vectors(table, name, signal, times, path) for name, signal in signals(law).items()
    }
    sides = ("observation.", "command.")
    records = Records(law)
    for i, time in enumerate(times.tolist()):
        seen, given = (
            {
                name.removeprefix(side): None if missing[i] else values[i]
                for name, (values, missing) in vectors.items()
                if name.startswith(side)
            }
            for side in sides
        )
        records.append(Record(time, seen, given))
    return records


def _vectors(
    table: pa.Table, name: str, signal: Signal, times: NDArray[np.float64], path: Path
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return a signal's vectors, and where there is none."""
    names = [f"{name}[{i}]" for i in range(signal.size)]
    needed = name.startswith("observation.") and not signal.optional
    if not needed and not set(names) & set(table.column_names):
        return np.full((len(times), signal.size), np.nan), np.ones(len(times), dtype=np.bool_)
    columns = [_column(table, *one, path) for one in zip(names, signal.units, strict=True)]
    missing = columns[0][1]
    for one, (values, lacks) in zip(names, columns, strict=True):
        bad = lacks if needed else lacks != missing
        if signal.finite:
            bad = bad | ~(np.isfinite(values) | lacks)
        if bad.any():
            row = int(np.argmax(bad))
            found = "missing" if lacks[row] else values[row]
            raise UserError(f"{path}: {one} is {found} at {times[row]} s, must be a number")
    return np.column_stack([values for values, _ in columns]), missing


def _column(
    table: pa.Table, name: str, unit: str, path: Path
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return a column's numbers, and where they are missing."""
    if name not in table.column_names:
        raise UserError(f"{path} has no column {name}{f', in {unit}' if unit else ''}")
    found = (table.field(name).metadata or {}).get(b"unit", b"").decode()
    if found != unit:
        said = f"in {found!r}" if found else "without a unit"
        raise UserError(
            f"{path}: {name} is {said}, must be in {unit!r}"
            if unit
            else f"{path}: {name} is {said}, must be without a unit"
        )
    try:
        values = table[name].cast(pa.float64())
    except pa.ArrowException as error:
        raise UserError(f"{path}: {name} is {table.field(name).type}, must be numbers") from error
    return values.to_numpy(), values.is_null().to_numpy()
