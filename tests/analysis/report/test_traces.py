from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from chamfer.analysis.report.traces import read_table, write_table


def table() -> dict[str, NDArray[Any]]:
    return {
        "time": np.array([np.nan, *np.linspace(0.0, 1.0, 49)]),  # NaN where a trial lacks it
        "trial": np.arange(50),
        "ok": np.arange(50) % 2 == 0,
        "state": np.array(["aligned", "moving"] * 25),
    }


def test_columns_come_back_in_order_with_their_types(tmp_path: Path) -> None:
    write_table(tmp_path / "a.parquet", table())
    read = read_table(tmp_path / "a.parquet")
    assert list(read) == ["time", "trial", "ok", "state"]
    for name, values in table().items():
        np.testing.assert_array_equal(read[name], values)
    assert [read[name].dtype.kind for name in ("time", "trial", "ok")] == ["f", "i", "b"]


def test_same_columns_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_table(tmp_path / f"{name}.parquet", table())
    assert (tmp_path / "a.parquet").read_bytes() == (tmp_path / "b.parquet").read_bytes()


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"a": np.zeros(3), "b": np.zeros(2)}, "column 'b' has 2 rows, the first one has 3"),
        ({"a": np.array([0.0, -np.inf])}, "column 'a' is infinite in row 1"),
        ({"a": np.zeros((2, 3))}, r"column 'a' has shape \(2, 3\), allowed: \(rows,\)"),
    ],
)
def test_bad_columns_are_named_and_the_old_table_stays(
    tmp_path: Path, columns: dict[str, NDArray[Any]], message: str
) -> None:
    path = tmp_path / "a.parquet"
    write_table(path, table())
    before = path.read_bytes()
    with pytest.raises(ValueError, match=f"^{message}$"):
        write_table(path, columns)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_a_table_without_rows_or_columns_can_be_read(tmp_path: Path) -> None:
    write_table(tmp_path / "a.parquet", {"x": np.array([])})
    assert read_table(tmp_path / "a.parquet")["x"].shape == (0,)
    write_table(tmp_path / "a.parquet", {})
    assert read_table(tmp_path / "a.parquet") == {}


def test_a_folder_whose_name_is_not_utf_8(tmp_path: Path) -> None:
    folder = tmp_path / "a\udcff"
    folder.mkdir()
    write_table(folder / "a.parquet", table())
    assert list(read_table(folder / "a.parquet")) == list(table())


def test_pandas_reads_them_in_a_line(tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas")
    write_table(tmp_path / "traces.parquet", {"time": np.arange(3.0), "way": np.array(["a"] * 3)})
    frame = pandas.read_parquet(tmp_path / "traces.parquet")
    assert list(frame.columns) == ["time", "way"]
    assert frame.time.tolist() == [0.0, 1.0, 2.0]
