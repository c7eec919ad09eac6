"""What sensors and computers are taken to be where a scenario leaves it open."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from chamfer.diagrams.contact.contact_scenarios import AdeptLoop, PlanarLoop, PumaLoop
from chamfer.diagrams.contact.hybrid_scenario import HybridScenario, filled
from chamfer.models.validation import ParameterError
from chamfer.systems.sensing.force_sensor import ForceSensorParams

LOOPS = [PlanarLoop(), PumaLoop(), AdeptLoop()]


def told(loop: HybridScenario, part: str, **values: Any) -> Any:
    """A part of the loop with other values in it, as it is filled in."""
    changed: Any = {part: replace(getattr(loop, part), **values)}
    return getattr(filled(replace(loop, **changed)), part)


@pytest.mark.parametrize("loop", LOOPS)
def test_ideal_is_the_figure(loop: HybridScenario) -> None:
    found = filled(loop)
    assert found.encoders.exact
    assert found.controller.computation_delay == found.controller.computation_jitter == 0
    assert not any(
        getattr(found.sensor, name)
        for name in ("bias", "drift", "bandwidth", "delay", "resolution", "full_scale", "tare")
    )


@pytest.mark.parametrize("loop", LOOPS)
def test_realistic_is_nowhere_ideal(loop: HybridScenario) -> None:
    found = filled(replace(loop, sensing="realistic"))
    assert not found.encoders.exact
    assert found.encoders.quanta(found.ARM.num_joints).all()
    assert found.controller.computation_delay
    assert found.controller.computation_jitter
    sensor = found.sensor
    assert all(
        (sensor.noise, sensor.bias, sensor.drift, sensor.bandwidth, sensor.resolution, sensor.tare)
    )
    if isinstance(sensor, ForceSensorParams):
        assert np.any(sensor.coupling != np.eye(len(sensor.coupling)))
    assert filled(found) == found


def test_what_is_given_stays() -> None:
    real = replace(AdeptLoop(), sensing="realistic")
    assert told(real, "sensor", noise=0.1).noise == 0.1
    assert told(real, "sensor", noise=0.1).bandwidth == filled(real).sensor.bandwidth
    assert told(real, "encoders", counts=1000.0).counts == 1000.0
    assert told(real, "detection", detect=2.0).detect == 2.0
    assert told(real, "controller", computation_delay=0.003).computation_delay == 0.003


def test_a_scalar_cross_talk_has_no_lever() -> None:
    found = told(replace(AdeptLoop(), sensing="realistic"), "sensor", cross_talk=0.2)
    assert isinstance(found, ForceSensorParams)
    assert found.position == (0.0, 0.0, 0.0)
    assert found.coupling.shape == (3, 3)


def test_bandwidths_fit_to_the_velocity() -> None:
    for sensing in ("ideal", "realistic"):
        loop = replace(PumaLoop(), sensing=sensing)
        for velocity, bandwidth in (("exact", 0.0), ("differenced", 0.0), ("tracked", 20.0)):
            assert told(loop, "encoders", velocity=velocity).bandwidth == bandwidth
        assert told(loop, "encoders", velocity="tracked", bandwidth=7.0).bandwidth == 7.0


def test_jitter_leaves_the_delay_within_its_period() -> None:
    real = replace(AdeptLoop(), sensing="realistic")
    for delay, jitter in ((0.0, 0.0), (1e-4, 1e-4), (0.0025, 2e-4), (0.005, 0.0)):
        found = told(real, "controller", computation_delay=delay)
        assert found.computation_jitter == pytest.approx(jitter, abs=1e-12)
    with pytest.raises(ParameterError, match=r"^controller.computation_delay is 0.006, all"):
        told(real, "controller", computation_delay=0.006)
    with pytest.raises(ParameterError, match=r"^encoders.counts is .*, allowed: 4 numbers, or on"):
        told(real, "encoders", counts=(1.0, 2.0))


def test_decoupling_spreads_the_noise_and_the_thresholds_follow() -> None:
    loop = AdeptLoop()
    plain, undone = (told(loop, "sensor", decoupling=on) for on in (False, True))
    assert plain.rest_noise == undone.rest_noise
    changed = filled(replace(loop, sensor=undone)).detection.detect
    row = np.abs(np.linalg.inv(undone.coupling)[0]).sum()  # of the push, along x
    assert changed == pytest.approx(1.6 * 0.5 * row, rel=1e-5)
    assert filled(loop).detection.detect == pytest.approx(0.8)
