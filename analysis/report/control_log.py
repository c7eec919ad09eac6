"""What a controller saw and answered, as a Parquet file whose columns have their units.

A row is a step of its law: ``time`` in s, ``observation.<input>[i]`` and ``command.<output>[i]``;
null where an optional input was missing. The unit of a column is in its field's metadata, what
the log is of in the table's.
"""

import io
import json
from collections.abc import Iterable, Mapping
from typing import Any, Final

import pyarrow as pa
import pyarrow.parquet as pq

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
