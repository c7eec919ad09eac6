"""The sensor at the wrist of an insertion: what it leaves open, and what it reads."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from chamfer.diagrams.skills.connector_sensing import SENSING, add_wrench_sensor, sensor_of
from chamfer.systems.sensing.force_sensor import WrenchSensorParams

STEP = 0.001  # s


def test_what_is_given_stays_and_the_rest_is_that_of_the_sensing() -> None:
    given = WrenchSensorParams(noise=0.17)
    assert sensor_of(given, "realistic") == replace(SENSING["realistic"], noise=0.17)
    assert sensor_of(SENSING["ideal"], "realistic") == SENSING["ideal"]


def test_an_ideal_sensor_reads_what_is_there() -> None:
    true = [0.1, -0.2, 0.3, 4.0, -5.0, 6.0]
    builder = DiagramBuilder()
    source = builder.AddSystem(ConstantVectorSource(true))
    reading = add_wrench_sensor(
        builder, SENSING["ideal"], source.get_output_port(), step=STEP, period=10 * STEP
    )
    builder.ExportOutput(reading, "wrench")
    diagram = builder.Build()
    found = diagram.GetOutputPort("wrench").Eval(diagram.CreateDefaultContext())
    np.testing.assert_allclose(found, true, atol=1e-12)


def test_a_realistic_one_mixes_forces_and_moments_by_a_hundredth_each() -> None:
    params = SENSING["realistic"]
    # The gauges feel the opposite, what the arm does.
    read = -params.undoing @ params.gauges.pick_up  # of moments above forces
    mixed = 0.01 + 0.99 * np.eye(3)
    np.testing.assert_allclose(read[:3, :3], mixed)
    np.testing.assert_allclose(read[3:, 3:], mixed)
    assert params.noise is not None
    assert params.noise / np.sqrt(3) == pytest.approx(0.5, rel=0.01)
