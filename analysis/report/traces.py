"""Tables of numbers on disk, as Parquet."""

import io
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from chamfer.analysis.report.atomic_write import replacing
from chamfer.analysis.scenario.experiment import Table


def write_table(path: Path, table: Table) -> None:
    """Write a table as :func:`table_bytes` returns it."""
    with replacing(path) as temporary:
        temporary.write_bytes(table_bytes(table))


def table_bytes(table: Table, *, infinite: bool = False) -> bytes:
    """Return the columns as a file; the same columns give the same bytes.

    NaN stands for a value that a trial doesn't have; infinity is refused unless allowed.

    Raises:
        ValueError: If a column is not one-dimensional, has another length than the first one or
            holds an infinite number; the message names it.
    """
    columns = {name: np.asarray(values) for name, values in table.items()}
    rows = None
    for name, values in columns.items():
        if values.ndim != 1:
            raise ValueError(f"column {name!r} has shape {values.shape}, allowed: (rows,)")
        rows = len(values) if rows is None else rows
        if len(values) != rows:
            raise ValueError(f"column {name!r} has {len(values)} rows, the first one has {rows}")
        if not infinite and values.dtype.kind == "f" and np.isinf(values).any():
            raise ValueError(f"column {name!r} is infinite in row {np.argmax(np.isinf(values))}")
    file = io.BytesIO()
    arrays = [_arrow(values) for values in columns.values()]
    pq.write_table(pa.table(arrays, names=list(columns)), file, compression="zstd")
    return file.getvalue()


def _arrow(values: NDArray[Any]) -> pa.Array:
    """Return numbers as they lie in memory; Arrow's own way begins with an import of pandas."""
    if values.dtype.kind not in "fiu":
        return pa.array(values)
    kind, memory = pa.from_numpy_dtype(values.dtype), pa.py_buffer(np.ascontiguousarray(values))
    return pa.Array.from_buffers(kind, len(values), [None, memory])


def read_table(path: Path) -> dict[str, NDArray[Any]]:
    """Return the columns of a table by name, in order."""
    with path.open("rb") as file:
        table = pq.read_table(file)
    return {name: table[name].to_numpy() for name in table.column_names}
