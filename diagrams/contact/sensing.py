"""Sensors and computer of an arm: as ideal as in the paper's figure, or as they are."""

from dataclasses import dataclass, fields, replace
from typing import Final, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from chamfer.systems.force.contact_detection import ContactDetectionParams
from chamfer.systems.sensing.encoders import EncoderParams
from chamfer.systems.sensing.force_sensor import ChannelParams, ForceSensorParams, LoadCellParams

Array = NDArray[np.float64]
Sensing = Literal["ideal", "realistic"]
SensorParams = ForceSensorParams | LoadCellParams
Params = TypeVar("Params", bound=ChannelParams)

_TRACKED: Final = 20.0  # Hz, of a tracking filter that is asked for alone
EXACT: Final = EncoderParams(counts=0.0, velocity="exact", bandwidth=0.0)


@dataclass(frozen=True, kw_only=True)
class SensingValues:
    """What is taken for the fields that a scenario leaves open."""

    sensor: SensorParams
    encoders: EncoderParams = EXACT
    computation_delay: float = 0.0  # s
    computation_jitter: float = 0.0  # s


def ideal(sensor: Params) -> Params:
    """Return the sensor with what it leaves open as if there were nothing of it."""
    nothing = dict.fromkeys(missing(sensor, sensor), 0.0)
    at_tip = {"position": (0.0, 0.0, 0.0)} if "position" in nothing else {}
    return replace(sensor, **{**nothing, **at_tip})  # type: ignore[arg-type]


def sensor_of(given: Params, values: SensingValues) -> Params:
    """Return the sensor with what it leaves open; its place only where moments are read."""
    left_open = missing(given, values.sensor)
    if isinstance(given, ForceSensorParams) and isinstance(given.cross_talk, float):
        left_open["position"] = (0.0, 0.0, 0.0)
    return replace(given, **left_open)  # type: ignore[arg-type]


def encoders_of(given: EncoderParams, values: SensingValues) -> EncoderParams:
    """Return the encoders with what they leave open; a bandwidth that fits to the velocity."""
    left_open = missing(given, values.encoders)
    if given.velocity is not None and given.bandwidth is None:
        left_open["bandwidth"] = _TRACKED if given.velocity == "tracked" else 0.0
    return replace(given, **left_open)  # type: ignore[arg-type]


def detection_of(
    given: ContactDetectionParams, sensor: SensorParams, direction: Array, R_WE: Array
) -> ContactDetectionParams:
    """Return contact detection with what the sensor's noise asks for.

    Args:
        given: Contact detection.
        sensor: Resolved.
        direction: Of the push in endpoint coordinates, shape (m,).
        R_WE: Orientation of the endpoint where it should touch.
    """
    return given.resolved(*push_errors(sensor, direction, R_WE))


def push_errors(sensor: SensorParams, direction: Array, R_WE: Array) -> tuple[float, float]:
    """Return by how much a push that is measured without contact is off, N: by noise, by bias.

    Args:
        sensor: Resolved.
        direction: Of the push in endpoint coordinates, shape (m,).
        R_WE: Orientation of the endpoint where it should touch.
    """
    share = 1.0  # of a channel's error in the push, at worst
    if isinstance(sensor, ForceSensorParams):
        channels = sensor.coupling.shape[0]
        scale = np.array([1.0, 1.0, 1.0, *3 * [sensor.radius]])[:channels]
        ahead = np.array([*direction, 0.0, 0.0])[:3]
        share = float(np.abs(ahead @ R_WE @ sensor.undoing) @ scale)
    return share * sensor.rest_noise, share * sensor.rest_bias


def missing(given: object, values: object) -> dict[str, object]:
    """Return the fields that are None, with their values of another dataclass."""
    return {
        one.name: getattr(values, one.name)
        for one in fields(given)  # type: ignore[arg-type]
        if getattr(given, one.name) is None
    }
