"""What each imperfection of sensors and computer is, and how detection is measured."""

from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from chamfer.analysis.contact.sensing_sensitivity import (
    IMPERFECTIONS,
    LOOPS,
    SensitivityScenario,
    contacts_in_air,
    imperfect,
    latency,
    resolve_sensing_sensitivity,
)
from chamfer.diagrams.contact.hybrid_scenario import HybridScenario


@pytest.fixture(scope="module")
def scenario() -> SensitivityScenario:
    return resolve_sensing_sensitivity(SensitivityScenario())


def differences(one: HybridScenario, other: HybridScenario) -> set[str]:
    return {
        f"{part}.{field.name}"
        for part in ("sensor", "encoders", "controller", "surface")
        for field in fields(getattr(one, part))
        if getattr(getattr(one, part), field.name) != getattr(getattr(other, part), field.name)
    }


@pytest.mark.parametrize("name", LOOPS)
def test_each_imperfection_is_what_its_name_says(scenario: SensitivityScenario, name: str) -> None:
    loop = getattr(scenario, name)
    ideal = imperfect(loop, "none")
    assert ideal.sensor.rest_noise == ideal.sensor.rest_bias == 0
    assert ideal.encoders.exact
    assert ideal.controller.computation_delay == 0
    found = {one: differences(imperfect(loop, one), ideal) for one in IMPERFECTIONS}
    assert found["noise"] == {"sensor.noise"}
    assert found["no_tare"] == {"sensor.bias", "sensor.drift"}
    assert found["drift"] == {"sensor.bias", "sensor.drift", "sensor.tare"}
    assert found["velocity"] == {"encoders.velocity"}
    assert found["friction"] == {"surface.friction_noise"}
    assert found["sample_late"] == {"controller.computation_delay"}
    # All of them together are the loop as it is.
    everything = differences(imperfect(loop, "all"), ideal)
    assert everything == set().union(*found.values())
    assert differences(imperfect(loop, "all"), loop) == {"controller.allow_unstable"}
    late = imperfect(loop, "all_sample_late")
    assert late.controller.computation_delay == loop.controller.period
    assert late.sensor == loop.sensor


def test_detection_knows_of_a_bias_that_is_not_tared(scenario: SensitivityScenario) -> None:
    tared, biased = (
        imperfect(scenario.adept, one).detection.release for one in ("drift", "no_tare")
    )
    assert tared is not None
    assert biased is not None
    assert biased > 1.0 > tared


def traces(mode: Any, force: Any) -> dict[str, np.ndarray]:
    push = np.array(force, dtype=float)
    return {
        "time": 0.005 * np.arange(len(push)),
        "mode": np.array(mode, dtype=float),
        "force": push,
        "peak_force": push,
    }


def test_contact_in_air_is_false() -> None:
    assert contacts_in_air(traces([0, 0, 1, 2, 1, 1], [0, 0, 0, 0, 0, 4])) == 2
    assert contacts_in_air(traces([0, 0, 0, 1, 1, 1], [0, 0, 1, 2, 3, 4])) == 0
    assert contacts_in_air(traces([0, 0, 1, 2, 1, 1], [0, 1, 2, 0, 2, 4])) == 0


def test_latency_is_the_longest_that_it_may_have_been() -> None:
    # Above 3 N in the fourth row, so since the third at the earliest.
    assert latency(traces([0, 0, 0, 0, 1, 1], [0, 1, 2, 4, 5, 5]), 3.0) == pytest.approx(0.01)
    assert latency(traces([0, 0, 1, 1, 1, 1], [0, 1, 2, 4, 5, 5]), 3.0) == 0
    assert latency(traces([0, 0, 0], [0, 5, 5]), 3.0) is None
    assert latency(traces([0, 0, 0], [0, 0, 0]), 3.0) is None
