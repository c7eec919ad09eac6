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
from chamfer.analysis.identify.log_columns import parse_columns
from chamfer.analysis.scenario.errors import UserError
from chamfer.models.recordings.recordings import slide_path

POUND = 0.45359237 * 9.80665  # N, by their definitions
INCH = 0.0254  # m
HEADER = b"time,fx,fy,fz,tx,twice,twice\n"


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
        (("time", "force[0];force[1];force[2]", "p.x;p.y;p.z"), ()),
        (("stamp", "a;b;c", "w[0];w[1];w[2]"), ("time=stamp", "force=a,b,c", "position=w[0..2]")),
    ],
)
def test_columns_are_found_by_themselves_or_named(
    log: Log, tmp_path: Path, titles: Sequence[str], columns: Sequence[str]
) -> None:
    names = ("time", "force", "position")
    made = table(log, dict(zip(names, titles, strict=True))).assign(remark="by hand")
    made.to_csv(tmp_path / "log.csv", index=False)
    require_same(read_log(tmp_path / "log.csv", parse_columns(columns)), log, *names)


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
    table(log, names, **units).to_csv(tmp_path / "log.csv", index=False)
    said = parse_columns(["position=x,y,z:mm", "rotation=rx,ry,rz:deg"])
    require_same(read_log(tmp_path / "log.csv", said), log, *names)
    made = table(log, {"time": "time", "force": "load[0];load[1];load[2]"}, force=POUND)
    columns = pa.Table.from_pandas(made, preserve_index=False)
    fields = [one.with_metadata({"unit": "lbf"}) for one in list(columns.schema)[1:]]
    columns = columns.cast(pa.schema([columns.schema[0], *fields]))
    columns = pa.concat_tables([columns[:1], columns])  # as controllers step twice at their start
    pq.write_table(columns, tmp_path / "log.parquet")
    found = read_log(tmp_path / "log.parquet", parse_columns(["force=load"]))
    require_same(found, log, "time", "force")


def test_quaternions_are_rotations_if_their_length_is_1(log: Log, tmp_path: Path) -> None:
    quaternions = np.roll(Rotation.from_rotvec(log.rotation).as_quat(), 1, axis=1)
    path = tmp_path / "log.npz"
    np.savez(path, time=log.time, force=log.force, rotation=quaternions)  # type: ignore[arg-type]
    turned = Rotation.from_rotvec(log.rotation).inv() * Rotation.from_rotvec(
        read_log(path).rotation
    )
    assert turned.magnitude().max() < 1e-6
    np.savez(path, time=log.time, force=log.force, rotation=2 * quaternions)  # type: ignore[arg-type]
    with pytest.raises(UserError, match="quaternions whose length differs from 1 by 1"):
        read_log(path)


def test_doubts_about_units_are_told(log: Log, tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    table(log, {"time": "time", "force": "fx (N);fy;fz"}).to_csv(path, index=False)
    with pytest.warns(UserWarning, match="fx has the unit N in its title; lbf is used"):
        found = read_log(path, parse_columns(["force=fx,fy,fz:lbf"]))
    np.testing.assert_allclose(found.force, POUND * log.force)  # type: ignore[operator]
    titles = {"time": "t", "force": "fx;fy;fz", "moment": "tx;ty;tz"}
    table(log, titles, force=POUND, moment=POUND * INCH).to_csv(path, index=False)
    with pytest.warns(UserWarning, match="a lever of 0.53 m: lbf and lbf in, or N and N mm?"):
        read_log(path)


@pytest.mark.parametrize(
    ("name", "content", "columns", "said"),
    [
        ("csv", None, "", "can't be read as a log: No such file"),
        ("npz", None, "", "can't be read as a log: No such file"),
        ("mat", b"", "", "allowed: a file .csv, .parquet or .npz"),
        ("csv", b"", "", "can't be read as a log: Empty CSV file"),
        ("csv", b"time,fx,fy,fz\n1,2\n", "", "can't be read as a log: CSV parse error"),
        ("csv", b"time,fx,fy,fz\n1,2,3,a\n", "", "fz is no column of numbers"),
        ("csv", b"time (min),fx,fy,fz\n1,2,3,4\n", "", "time is in 'min', allowed: s, ms, us, ns"),
        ("csv", HEADER, "", "has 0 rows, allowed: 200 or more"),
        ("parquet", b"no parquet", "", "can't be read as a log: "),
        ("npz", b"no archive", "", "can't be read as a log: "),
        ("csv", HEADER, "force", "is 'force', allowed: such as force=Fx,Fy,Fz"),
        ("csv", HEADER, "forces=fx,fy,fz", "unknown quantity 'forces', did you mean 'force'"),
        ("csv", HEADER, "force=fx,fy,fz:dyn", "force is in 'dyn', allowed: N, kN, lbf, kgf"),
        ("csv", HEADER, "force=fx,fy", "has 2 of force, allowed: 3"),
        ("csv", HEADER, "force=fx,fy,FZ", "has no column FZ, but time, fx, fy, fz, tx"),
        ("csv", HEADER, "velocity=fx,fy,twice", "has 2 columns twice, must have one"),
    ],
)
def test_what_is_no_log_or_no_column_is_told(
    tmp_path: Path, name: str, content: bytes | None, columns: str, said: str
) -> None:
    path = tmp_path / f"log.{name}"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(UserError) as error:
        read_log(path, parse_columns([columns] if columns else []))
    assert said in str(error.value)
