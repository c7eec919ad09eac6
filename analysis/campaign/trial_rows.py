"""A trial's result, a flat row, as bytes and back; decoding never executes code."""

import io
import json
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

# Numbers, booleans, texts, None and arrays by name. What is decoded has Python's own numbers.
Row = Mapping[str, Any]

_TABLE: Final = "table."  # in front of columns


def encode(row: Row) -> bytes:
    """Return a row as bytes: a line of JSON, and then each array as NumPy saves it.

    Raises:
        TypeError: If a value has a type that a row can't hold; the message names it.
    """
    plain: dict[str, object] = {}
    arrays: dict[str, np.ndarray] = {}
    for name, value in row.items():
        if isinstance(value, np.ndarray):
            if value.dtype.hasobject:
                raise TypeError(f"{name} is an array of objects, allowed: of numbers or texts")
            arrays[name] = value
            plain[name] = None
        else:
            plain[name] = _plain(name, value)
    buffer = io.BytesIO()
    buffer.write(json.dumps([plain, list(arrays)]).encode() + b"\n")
    for array in arrays.values():
        np.lib.format.write_array(buffer, array, allow_pickle=False)
    return buffer.getvalue()


def decode(data: bytes) -> dict[str, Any]:
    """Return the row of the bytes of :func:`encode`."""
    buffer = io.BytesIO(data)
    row: dict[str, Any]
    row, arrays = json.loads(buffer.readline())
    for name in arrays:
        row[name] = np.lib.format.read_array(buffer, allow_pickle=False)
    return row


def with_table(row: Row, table: Mapping[str, np.ndarray]) -> Row:
    """Return a row with a table's columns added."""
    return {**row, **{f"{_TABLE}{name}": values for name, values in table.items()}}


def table_of(row: Row) -> dict[str, Any]:
    """Return the table of a row, without columns if it has none."""
    return {
        name.removeprefix(_TABLE): values
        for name, values in row.items()
        if name.startswith(_TABLE)
    }


def _plain(name: str, value: object) -> object:
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | int | float | str):
        return value
    raise TypeError(
        f"{name} is of type {type(value).__name__}, "
        "allowed: a number, a text, true, false, None or an array"
    )
