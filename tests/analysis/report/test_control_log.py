"""A log has every number that a law saw and answered, with its unit, a run after the other."""

import io
import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from chamfer.analysis.report.control_log import log_bytes, log_records, read_log
from chamfer.analysis.scenario.errors import UserError
from chamfer.systems.law_block import LawBlock, Updates
from chamfer.systems.recording import Recorder, recording
from chamfer.systems.servo.pid_law import PidGains, PidLaw, SampledPidParams


def pid() -> PidLaw:
    law = PidLaw(SampledPidParams(axes=(PidGains(proportional=0.5, integral=0.5),) * 2, period=1))
    law.in_units(error="N/(m s)", compensation=("m", "rad"))
    return law


@pytest.mark.parametrize(("updates", "at_start"), [("unrestricted", False), ("discrete", True)])
def test_each_simulation_of_a_block_is_a_run(updates: Updates, at_start: bool) -> None:
    builder = DiagramBuilder()
    block = builder.AddNamedSystem("pid", LawBlock(pid(), updates=updates, at_start=at_start))
    error = builder.AddSystem(ConstantVectorSource([2.0, 0.0]))
    builder.Connect(error.get_output_port(), block.GetInputPort("error"))
    diagram = builder.Build()
    with recording(recorder := Recorder()):
        for _ in range(2):
            Simulator(diagram).AdvanceTo(2.5)
    times = [0.0] * at_start + [0.0, 1.0, 2.0]
    runs = recorder.runs["pid"]
    assert len(runs) == 2
    for run in runs:
        table = pq.read_table(io.BytesIO(log_bytes(run, {"versions": {"a": "1"}})))
        assert table.to_pydict() == {
            "time": times,
            "observation.error[0]": [2.0] * len(times),
            "observation.error[1]": [0.0] * len(times),
            "observation.valid[0]": [None] * len(times),
            "command.compensation[0]": (1.0 + np.arange(1, len(times) + 1)).tolist(),
            "command.compensation[1]": [0.0] * len(times),
        }
        units = [table.field(name).metadata[b"unit"] for name in table.column_names]
        assert units == [b"s", b"N/(m s)", b"N/(m s)", b"", b"m", b"rad"]
        assert json.loads(table.schema.metadata[b"versions"]) == {"a": "1"}


ERROR = "observation.error[0] (N/(m s))"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda log: log[:0], "has no rows"),
        (lambda log: log.rename(columns={"time (s)": "time (ms)"}), "time is in ms, must be in s"),
        (
            lambda log: log.rename(columns={ERROR: "observation.error[0]"}),
            "is without a unit, must",
        ),
        (
            lambda log: log.drop(columns=ERROR),
            "has no columns observation.error[0], must",
        ),
        (lambda log: pd.concat([log, log], axis=1), "has 2 columns time, must have one, in s"),
        (lambda log: log[::-1], "time is 0.0 s in row 2, must ascend"),
        (
            lambda log: log.assign(**{ERROR: [None, 0.0]}),
            "error[0] is missing in row 1, must be",
        ),
        (lambda log: log.assign(**{"time (s)": [0.0, "nan"]}), "time is nan in row 2, must be a"),
        (
            lambda log: log.assign(**{"command.speed[0]": 1.0}),
            "column command.speed[0] is none",
        ),
        (lambda log: log.assign(**{"time (s)": "noon"}), "time is string, must be numbers"),
    ],
)
def test_what_does_not_fit_is_refused_in_a_line(
    tmp_path: Path, change: Callable[[pd.DataFrame], pd.DataFrame], said: str
) -> None:
    path = tmp_path / "robot.csv"
    log = pd.DataFrame({"time (s)": [0.0, 1.0], ERROR: 0.5, ERROR.replace("0", "1"): 0.5})
    change(log).to_csv(path, index=False)
    with pytest.raises(UserError, match=re.escape(said)) as error:
        log_records(pid(), read_log(path)[0], path)
    assert "\n" not in str(error.value)
