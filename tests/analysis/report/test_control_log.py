"""A log has every number that a law saw and answered, with its unit."""

import io
import json

import numpy as np
import pyarrow.parquet as pq
import pytest

from chamfer.analysis.report.control_log import log_bytes, log_table
from chamfer.systems.recording import Record
from chamfer.systems.servo.pid_law import PidGains, PidLaw, SampledPidParams


def test_a_log_has_every_number_and_what_was_missing() -> None:
    law = PidLaw(SampledPidParams(axes=(PidGains(proportional=1.0, integral=0.5),) * 2))
    saw = [
        {"error": [1.0, 2.0], "valid": [1.0]},
        {"error": np.array([3.0, 4.0]), "valid": None},
    ]
    gave = {"compensation": (0.5, 0.25)}
    records = [Record(i / 80, seen, gave) for i, seen in enumerate(saw)]
    table = pq.read_table(io.BytesIO(log_bytes(log_table(law, records, {"versions": {"a": "1"}}))))
    assert table.to_pydict() == {
        "time": [0.0, 1 / 80],
        "observation.error[0]": [1.0, 3.0],
        "observation.error[1]": [2.0, 4.0],
        "observation.valid[0]": [1.0, None],
        "command.compensation[0]": [0.5, 0.5],
        "command.compensation[1]": [0.25, 0.25],
    }
    assert table.field("time").metadata[b"unit"] == b"s"
    assert json.loads(table.schema.metadata[b"versions"]) == {"a": "1"}
    with pytest.raises(ValueError, match=r"observation.error is \[1.0\], must be 2 numbers"):
        log_table(law, [Record(0.0, {"error": [1.0]}, gave)])
