"""The force and torque sensor at the wrist of an insertion: as ideal as can be, or as they are."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import MatrixGain

from chamfer.diagrams.contact.sensing import Sensing, add_sensor, ideal, missing
from chamfer.systems.sensing.force_sensor import WrenchSensorParams

_NONE: Final = tuple(map(tuple, np.eye(6).tolist()))
# A calibrated six-axis sensor of 200 N: noise with a standard deviation of 0.5 N and 0.01 N m,
# forces leak into each other by 1 %; the numbers are those at the tool's tip. All is assumed.
SENSING: Final[Mapping[Sensing, WrenchSensorParams]] = {
    "ideal": ideal(WrenchSensorParams(cross_talk=_NONE)),
    "realistic": WrenchSensorParams(
        noise=0.87,
        bias=1.0,
        drift=0.02,
        bandwidth=500.0,
        delay=1.7e-3,
        resolution=0.05,
        full_scale=200.0,
        tare=0.0,
        cross_talk=(
            (1.0, 0.01, 0.01, 0.1, 0.1, 0.1),
            (0.01, 1.0, 0.01, 0.1, 0.1, 0.1),
            (0.01, 0.01, 1.0, 0.1, 0.1, 0.1),
            (2e-4, 2e-4, 2e-4, 1.0, 0.01, 0.01),
            (2e-4, 2e-4, 2e-4, 0.01, 1.0, 0.01),
            (2e-4, 2e-4, 2e-4, 0.01, 0.01, 1.0),
        ),
        position=(0.0, 0.0, 0.0),
    ),
}


def sensor_of(given: WrenchSensorParams, sensing: Sensing) -> WrenchSensorParams:
    """Return the sensor with what it leaves open."""
    return replace(given, **missing(given, SENSING[sensing]))  # type: ignore[arg-type]


def add_wrench_sensor(
    builder: DiagramBuilder,
    params: WrenchSensorParams,
    true: OutputPort,
    *,
    step: float,
    period: float,
) -> OutputPort:
    """Add a sensor; return the wrench on the tool that it reads, (6,), N m above N.

    Args:
        builder: Of the loop.
        params: Resolved.
        true: (6,), N m above N, at the tip.
        step: s, at which that changes.
        period: s, of the computer.
    """
    reading = add_sensor(builder, "", params, params.gauges, true, step=step, period=period)
    wrench = builder.AddNamedSystem("wrist sensor's reading", MatrixGain(params.undoing))
    builder.Connect(reading, wrench.get_input_port())
    return wrench.get_output_port()
