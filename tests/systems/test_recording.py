"""What laws saw and answered is kept, a run after the other."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from chamfer.systems.law_block import LawBlock, Updates
from chamfer.systems.recording import recorded
from chamfer.systems.servo.pid_law import PidGains, PidLaw, SampledPidParams


@pytest.mark.parametrize(("updates", "at_start"), [("unrestricted", False), ("discrete", True)])
def test_each_simulation_of_a_block_is_a_run(updates: Updates, at_start: bool) -> None:
    builder = DiagramBuilder()
    law = PidLaw(SampledPidParams(axes=(PidGains(proportional=1.0, integral=0.5),), period=0.1))
    block = builder.AddNamedSystem("pid", LawBlock(law, updates=updates, at_start=at_start))
    error = builder.AddSystem(ConstantVectorSource([2.0]))
    builder.Connect(error.get_output_port(), block.GetInputPort("error"))
    diagram = builder.Build()
    with recorded() as recorder:
        for _ in range(2):
            Simulator(diagram).AdvanceTo(0.25)
    first, second = recorder.runs["pid"]
    times = [0.0, 0.0, 0.1, 0.2] if at_start else [0.0, 0.1, 0.2]
    for run in (first, second):
        np.testing.assert_allclose(run.times, times)
        vectors = {name: (values, missing) for name, values, missing in run.vectors()}
        assert vectors["observation.error"][0].tolist() == [[2.0]] * len(times)
        assert vectors["observation.valid"][1].all()
        compensation = 2.0 + 0.1 * np.arange(1, len(times) + 1)
        np.testing.assert_allclose(vectors["command.compensation"][0][:, 0], compensation)
