"""Pictures in all conditions, what is counted of them, and that it says no."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.experiment import Outcome, load, select
from chamfer.analysis.sight import detection_conditions, picture_conditions
from chamfer.analysis.sight.camera_accuracy import AccuracyScenario
from chamfer.analysis.sight.detection_conditions import (
    SEVERITIES,
    ConditionsScenario,
    ConditionTask,
    picture,
)
from chamfer.analysis.sight.detection_trials import detection_error
from chamfer.analysis.sight.picture_conditions import CONDITIONS
from chamfer.models.validation import ParameterError
from chamfer.systems.cameras.camera_image import Image
from chamfer.systems.vision.detections import Detection, Status
from chamfer.systems.vision.part_appearance import Appearance

DETECTION_CONDITIONS = load(select(CATALOGUE.entries, ["detection-conditions"])[0])

SCENARIO = DETECTION_CONDITIONS.resolve(ConditionsScenario(pictures=1))


@pytest.fixture(scope="module")
def outcome() -> Outcome:
    return DETECTION_CONDITIONS.run(SCENARIO, 0, lambda *_: None)


def test_there_are_some_twenty_conditions_and_every_level_is_another_picture() -> None:
    assert len(CONDITIONS) > 20
    for name in SCENARIO.conditions:
        if name not in ("none", "fine", "coarse"):
            images = [picture(SCENARIO, 0, ConditionTask(name, one, 3))[0] for one in SEVERITIES]
            assert not np.array_equal(images[0], images[1]), name
            assert not np.array_equal(images[1], images[2]), name
    for name in ("clutter", "bayer"):
        task = ConditionTask(name, "severe", 3)
        np.testing.assert_array_equal(picture(SCENARIO, 0, task)[0], picture(SCENARIO, 0, task)[0])


def test_truth_is_the_same_in_all_conditions_of_a_trial() -> None:
    truths = {
        name: picture(SCENARIO, 0, ConditionTask(name, "middle", 5))[2]
        for name in ("none", "shadow", "blur", "tip", "dark")
    }
    assert all(one == truths["none"] for one in truths.values())
    # In a picture with half as many pixels everything is at half the place.
    half = picture(SCENARIO, 0, ConditionTask("coarse", "middle", 5))[2]
    for one, other in zip(half, truths["none"], strict=True):
        assert np.add(one.tip, 0.5) * 2 == pytest.approx(np.add(other.tip, 0.5))
        assert one.angle == pytest.approx(other.angle)


def test_nothing_is_wrong_and_all_is_found_that_is_to_be(outcome: Outcome, value: Any) -> None:
    assert value(outcome, "pictures") == 3 * len(SCENARIO.conditions)
    assert value(outcome, "wrong") == 0
    for name in SCENARIO.conditions:
        asked = CONDITIONS[name].asked
        if asked != "either" and name != "clutter":
            assert value(outcome, f"{name}.middle.{asked}") == 100, name
        for error, most in (("axial", 0.35), ("lateral", 0.1), ("angle", 1e-3)):  # px, rad
            assert value(outcome, f"{name}.middle.{error}.rms") < most, name


def test_shares_add_up_and_refusals_have_a_reason(outcome: Outcome, value: Any) -> None:
    for name in SCENARIO.conditions:
        for severity in SEVERITIES:
            of = f"{name}.{severity}"
            shares = [value(outcome, f"{of}.{one}") for one in ("found", "refused", "wrong")]
            assert sum(shares) == pytest.approx(100)
            reason = outcome.metrics[f"{of}.refused"].note
            assert bool(shares[1]) == bool(reason)
    assert "peg WRONG_SHAPE 1" in outcome.metrics["tip.middle.refused"].note


def test_a_detector_that_is_wrong_is_counted(monkeypatch: pytest.MonkeyPatch, value: Any) -> None:
    scenario = dataclasses.replace(SCENARIO, photographs=False)
    found = detection_conditions.detect_parts

    def wrong(image: Image, *looks: Appearance) -> tuple[Detection, ...]:
        peg, hole = found(image, *looks)
        if peg.status == Status.VALID:
            peg = dataclasses.replace(peg, tip=(peg.tip[0] + 1.5, peg.tip[1]))
        return peg, hole

    monkeypatch.setattr(detection_conditions, "detect_parts", wrong)
    row = detection_conditions._detect(scenario, 0, ConditionTask("none", "mild", 0))
    assert row["axial"][0] == pytest.approx(1.5, abs=0.3)
    outcome = DETECTION_CONDITIONS.run(scenario, 0, lambda *_: None)
    assert value(outcome, "none.mild.wrong") == 100
    assert value(outcome, "wrong") > 50


def test_errors_of_an_axis_are_measured_at_the_tip() -> None:
    true = Detection(status=Status.VALID, tip=(100.0, 50.0), angle=0.0, point=(100.0, 50.0))
    seen = Detection(status=Status.OCCLUDED, angle=0.01, point=(50.0, 50.2))
    axial, lateral, angle = detection_error(seen, true)
    assert math.isnan(axial)
    assert lateral == pytest.approx(0.7, abs=1e-3)  # 0.2 and 50 pixels at 10 mrad
    assert angle == 0.01
    assert np.isnan(detection_error(Detection(status=Status.BLURRED), true)).all()


def test_pictures_without_photographs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(picture_conditions, "find_spec", lambda _: None)
    resolve = DETECTION_CONDITIONS.resolve
    without = resolve(ConditionsScenario())
    assert without.photographs is False
    assert "clutter" not in without.conditions
    with pytest.raises(UserError, match=r"pip install 'chamfer\[photographs\]'"):
        resolve(ConditionsScenario(photographs=True))


@pytest.mark.parametrize("scenario", [ConditionsScenario, AccuracyScenario])
def test_the_parts_are_apart(scenario: Any) -> None:
    with pytest.raises(ParameterError, match=r"^gap is -0\.01, allowed: a finite number >= 0$"):
        scenario(gap=-0.01)
