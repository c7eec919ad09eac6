"""What is found in frames as a table, and as lines of comma-separated values."""

import math
from array import array
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from chamfer.analysis.scenario.experiment import Table
from chamfer.analysis.track.detection_overlay import REASONS
from chamfer.systems.vision.part_detection import Status

PARTS: Final = ("peg", "hole")

_FORMULA: Final = ("=", "+", "-", "@", "\t", "\r")  # with what spreadsheets begin one
_STATUS: Final = "_status"
_IN_PIXELS: Final = ("_u", "_v", "error_along", "error_across")  # ends of columns
_PIXELS, _SI = 4, 6  # decimals, of what is in pixels and of s, rad and m


@dataclass(frozen=True, kw_only=True)
class Track:
    """What was found in frames."""

    table: Table  # a row per frame
    size: tuple[int, int]  # pixels, width and height
    rate: float  # frames/s, or NaN
    interrupted: bool = False  # before the last frame
    fault: Exception | None = None  # why it ended before the last frame without being asked to
    missed: int = 0  # frames of a live camera that came while others were looked at

    @property
    def frames(self) -> int:
        """How many frames there are."""
        return len(self.table["frame"])

    @property
    def both_valid(self) -> int:
        """In how many frames tip and axis of both parts were found, by each camera."""
        return int(
            np.all([self._column(part) == Status.VALID for part in self.parts], axis=0).sum()
        )

    @property
    def parts(self) -> tuple[str, ...]:
        """What the table has a status of: peg and hole, and those of a right camera."""
        names = (name for name in self.table if name.endswith(_STATUS))
        return tuple(name.removesuffix(_STATUS) for name in names)

    def counts(self) -> dict[str, dict[str, int]]:
        """Return how many frames have each status that occurs, by part."""
        return {
            part: {
                status.name: number
                for status, number in sorted(Counter(self.statuses(part)).items())
            }
            for part in self.parts
        }

    def statuses(self, part: str) -> list[Status]:
        """Return a part's status in every frame."""
        return [Status(value) for value in self._column(part).tolist()]

    def _column(self, part: str) -> NDArray[np.int64]:
        return self.table[f"{part}{_STATUS}"]


class Rows:
    """A table that grows by a row a frame, and the lines of it for people.

    The lines have three kinds of column more than the table: ``file``, and behind every status,
    which is a name there, the reason in words. What was not found is empty. A file whose name a
    spreadsheet would take for a formula has an apostrophe in front of it.

    Args:
        columns: Names of what is found in a frame; those that end in ``_status`` are numbers of
            :class:`Status`.
    """

    def __init__(self, columns: Sequence[str]) -> None:
        self._columns = tuple(columns)
        self._times, self._values = array("d"), array("d")
        self._writers = [_writer(name) for name in ("time", *columns)]

    def __len__(self) -> int:
        """Return how many rows there are."""
        return len(self._times)

    def header(self) -> str:
        """Return the line of the columns' names."""
        names = (name for column in self._columns for name in _names(column))
        return f"{','.join(['frame', 'file', 'time', *names])}\n"

    def add(self, file: str, time: float, values: Sequence[float]) -> str:
        """Append a row and return its line.

        Args:
            file: What the frame is called.
            time: s, or NaN.
            values: Of the columns.
        """
        number = len(self._times)
        row = (time, *values)
        cells = (
            cell for write, value in zip(self._writers, row, strict=True) for cell in write(value)
        )
        line = f"{number},{_quoted(file)},{','.join(cells)}\n"
        self._times.append(time)
        self._values.extend(values)
        return line

    def table(self) -> Table:
        """Return the columns ``frame``, from 0, ``time``, s, and what was found."""
        values = np.array(self._values).reshape(-1, len(self._columns))
        columns = {
            name: column.astype(np.int64) if name.endswith(_STATUS) else column
            for name, column in zip(self._columns, values.T, strict=True)
        }
        return {"frame": np.arange(len(values)), "time": np.array(self._times), **columns}


def _names(column: str) -> Iterator[str]:
    yield column
    if column.endswith(_STATUS):
        yield f"{column.removesuffix(_STATUS)}_reason"


def _writer(column: str) -> Callable[[float], Iterable[str]]:
    if column.endswith(_STATUS):
        return _status_cells
    digits = _PIXELS if column.endswith(_IN_PIXELS) else _SI
    return lambda value: ("" if math.isnan(value) else f"{value:z.{digits}f}",)


def _status_cells(value: float) -> tuple[str, str]:
    status = Status(int(value))
    return status.name, "" if status == Status.VALID else _quoted(REASONS[status])


def _quoted(text: str) -> str:
    text = f"'{text}" if text.startswith(_FORMULA) else text
    return '"{}"'.format(text.replace('"', '""')) if set(text) & set(',"\r\n') else text
