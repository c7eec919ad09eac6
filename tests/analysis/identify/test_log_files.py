"""A log is the same from any file, with columns of any name and in any known unit."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scipy.spatial.transform import Rotation

from chamfer.analysis.identify.log import Log, read_log
from chamfer.analysis.identify.log_columns import UNITS, parse_columns
from chamfer.analysis.scenario.errors import UserError
from chamfer.models.recordings.recordings import slide_path

POUND = 0.45359237 * 9.80665  # N, by their definitions
INCH = 0.0254  # m


@pytest.fixture(scope="module")
def log() -> Log:
    return read_log(slide_path("table_press"))


def table(log: Log, titles: dict[str, str], **per_unit: float) -> pd.DataFrame:
    """Return a log as a table: titles of quantities' columns, and what a unit of them is."""
    columns = {}
    for name, text in titles.items():
        values = np.atleast_2d(getattr(log, name).T) / per_unit.get(name, 1.0)
        columns |= dict(zip(text.split(";"), values, strict=True))
    return pd.DataFrame(columns)


def require_same(found: Log, log: Log, *names: str) -> None:
    for name in names:
        np.testing.assert_allclose(getattr(found, name), getattr(log, name), atol=1e-9)


@pytest.mark.parametrize(
    ("titles", "columns"),
    [
        (("Time", "FX;FY;FZ", "x;y;z"), ()),
        (("t", "force_x;force_y;force_z", "position_x;position_y;position_z"), ()),
        (("time", "force[0];force[1];force[2]", "p.x;p.y;p.z"), ()),
        (("stamp", "a;b;c", "w[0];w[1];w[2]"), ("time=stamp", "force=a,b,c", "position=w")),
    ],
)
def test_columns_are_found_by_themselves_or_named(
    log: Log, tmp_path: Path, titles: Sequence[str], columns: Sequence[str]
) -> None:
    path = tmp_path / "log.csv"
    names = ("time", "force", "position")
    made = table(log, dict(zip(names, titles, strict=True))).assign(remark="by hand")
    made.to_csv(path, index=False)
    require_same(read_log(path, parse_columns(columns)), log, *names)


def test_units_are_in_titles_in_metadata_or_said(log: Log, tmp_path: Path) -> None:
    names = {
        "time": "time (ms)",
        "force": "fx (lbf);fy [lbf];fz (lbf)",
        "moment": "tx (lbf*in);ty (lbf in);tz (lbf in)",
        "position": "x;y;z",
        "rotation": "rx;ry;rz",
    }
    units = {"force": POUND, "moment": POUND * INCH, "time": 1e-3}
    units |= {"position": 1e-3, "rotation": np.pi / 180}
    made = table(log, names, **units)
    made.to_csv(tmp_path / "log.csv", index=False)
    said = parse_columns(["position=x,y,z:mm", "rotation=rx,ry,rz:deg"])
    require_same(read_log(tmp_path / "log.csv", said), log, *names)
    fields = [
        pa.field(f"load[{i}]", pa.float64(), metadata={"unit": unit})
        for i, unit in enumerate(("lbf", "N", "kgf"))
    ]
    each = np.array([POUND, 1.0, 9.80665])
    arrays = [pa.array(values) for values in (log.force / each).T]  # type: ignore[operator]
    parquet = pa.Table.from_arrays(
        [pa.array((1e9 * log.time).round().astype(np.int64)), *arrays],
        schema=pa.schema([pa.field("time", pa.int64(), metadata={"unit": "ns"}), *fields]),
    )
    pq.write_table(parquet, tmp_path / "log.parquet")
    found = read_log(tmp_path / "log.parquet", parse_columns(["force=load"]))
    require_same(found, log, "time", "force")


def test_quaternions_are_rotations_and_unlike_ones_are_refused(log: Log, tmp_path: Path) -> None:
    quaternions = np.roll(Rotation.from_rotvec(log.rotation).as_quat(), 1, axis=1)
    path = tmp_path / "log.npz"
    np.savez(path, time=log.time, force=log.force, rotation=quaternions)  # type: ignore[arg-type]
    found = read_log(path).rotation
    turned = Rotation.from_rotvec(log.rotation).inv() * Rotation.from_rotvec(found)
    assert turned.magnitude().max() < 1e-6
    np.savez(path, time=log.time, force=log.force, rotation=2 * quaternions)  # type: ignore[arg-type]
    with pytest.raises(UserError, match="quaternions whose length is off 1 by 1"):
        read_log(path)


def test_a_unit_that_contradicts_a_title_is_told(log: Log, tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    table(log, {"time": "time", "force": "fx (N);fy;fz"}).to_csv(path, index=False)
    with pytest.warns(UserWarning, match="fx says N, it is taken to be lbf"):
        found = read_log(path, parse_columns(["force=fx,fy,fz:lbf"]))
    np.testing.assert_allclose(found.force, POUND * log.force)  # type: ignore[operator]
    units = {"force": POUND, "moment": POUND * INCH}
    titles = {"time": "t", "force": "fx;fy;fz", "moment": "tx;ty;tz"}
    table(log, titles, **units).to_csv(path, index=False)
    with pytest.warns(UserWarning, match="a lever of 0.53 m: lbf and lbf in, or N and N mm?"):
        read_log(path)


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        ("force", "is 'force', allowed: such as force=Fx,Fy,Fz"),
        ("force=Fx,,Fz", "allowed: such as force=Fx,Fy,Fz"),
        ("forces=Fx,Fy,Fz", "unknown quantity 'forces', did you mean 'force'"),
        ("force=Fx,Fy,Fz:dyn", "force is in 'dyn', allowed: N, kN, lbf, kgf"),
        ("force=Fx,Fy", "has 2 of force, allowed: 3"),
        ("force=Fx,Fy,FZ", "has no column FZ, but t, Fx, Fy, Fz, torque_x"),
        ("velocity=Fx,Fy,twice", "has 2 columns twice, must have one"),
    ],
)
def test_wrong_columns_are_told(log: Log, tmp_path: Path, columns: str, said: str) -> None:
    path = tmp_path / "log.csv"
    made = table(log, {"time": "t", "force": "Fx;Fy;Fz"})
    made = made.assign(torque_x=0.0, one=0.0, two=0.0)
    made.columns = [*made.columns[:-2], "twice", "twice"]
    made.to_csv(path, index=False)
    with pytest.raises(UserError, match=said.replace("(", r"\(")):
        read_log(path, parse_columns([columns]))


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("log.csv", None, "can't be read as a log: No such file"),
        ("log.npz", None, "can't be read as a log: No such file"),
        ("log.mat", b"", "allowed: a file .csv, .parquet or .npz"),
        ("log.csv", b"", "can't be read as a log: Empty CSV file"),
        ("log.csv", b"time,fx,fy,fz\n1,2\n", "can't be read as a log: CSV parse error"),
        ("log.csv", b"time,fx,fy,fz\n1,2,3,a\n", "fz is no column of numbers"),
        ("log.csv", b"time (min),fx,fy,fz\n1,2,3,4\n", "time is in 'min', allowed: s, ms, us, ns"),
        ("log.csv", b"time,fx,fy,fz\n", "has 0 rows, allowed: 200 or more"),
        ("log.parquet", b"no parquet", "can't be read as a log: "),
        ("log.npz", b"no archive", "can't be read as a log: "),
    ],
)
def test_files_that_are_no_logs_are_told(
    tmp_path: Path, name: str, content: bytes | None, said: str
) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(UserError) as error:
        read_log(tmp_path / name)
    assert said in str(error.value)


def test_every_unit_is_known_by_its_quantity() -> None:
    assert UNITS["N"]["lbf"] == pytest.approx(POUND)
    assert UNITS["N m"]["lbf in"] == pytest.approx(POUND * INCH)
    assert UNITS["N m"]["lbf ft"] == pytest.approx(POUND * 12 * INCH)
    assert all(units[own] == 1 for own, units in UNITS.items())
