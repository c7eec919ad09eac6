"""Calibrations of drawn boards beside the cameras that they were drawn with."""

from typing import Any

import numpy as np
import pytest

from chamfer.analysis.calibration.calibration_accuracy import (
    PARAMETERS,
    BoardPoses,
    CalibrationScenario,
    DrawnCameras,
    focal_errors,
)
from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.scenario.experiment import load, quiet, select
from chamfer.models.validation import ParameterError

CALIBRATION_ACCURACY = load(select(CATALOGUE.entries, ["calibration-accuracy"])[0])


def test_a_few_sets(value: Any) -> None:
    outcome = CALIBRATION_ACCURACY.run(CalibrationScenario(sets=2, pictures=8), 0, quiet)
    traces = outcome.traces
    assert len(traces["set"]) == 2
    assert value(outcome, "focal_length.near") == 100.0
    assert value(outcome, "found") == 100.0
    assert value(outcome, "left_out") == 0.0
    assert 0.01 < value(outcome, "corners.error") < 0.04
    # What remains in corners are their errors along both axes, without what the fit takes up.
    ratio = value(outcome, "reprojection_error") / value(outcome, "corners.error")
    assert ratio == pytest.approx(np.sqrt(2), rel=0.1)
    largest = np.max(
        np.abs([traces[f"{name}_error"] / traces[f"{name}_true"] for name in ("fx", "fy")]), axis=0
    )
    np.testing.assert_allclose(focal_errors(traces), 100 * largest)
    assert value(outcome, "focal_length.error.max") == pytest.approx(100 * largest.max())
    for name in PARAMETERS:
        off = traces[f"{name}_error"] / traces[f"{name}_sd"]
        within = 100 * np.mean(np.abs(off) <= 3)
        assert value(outcome, f"{name}.within") == within
        low, high = (value(outcome, f"{name}.within.{end}") for end in ("low", "high"))
        assert low <= within <= high
        assert value(outcome, f"{name}.ratio") == pytest.approx(np.sqrt(np.mean(off**2)))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: CalibrationScenario(board="9x6"), "board is '9x6'"),
        (lambda: DrawnCameras(width=10), "width is 10"),
        (lambda: DrawnCameras(focal_length=(9.0, 600.0)), "focal_length is"),
        (lambda: DrawnCameras(k1=(0.1, -0.1)), "k1 is"),
        (lambda: BoardPoses(tilt=1.3), "tilt is"),
        (lambda: BoardPoses(extent=(0.4, 0.3)), "extent is"),
        (lambda: BoardPoses(extent=(0, 1)), "extent is"),
    ],
)
def test_what_can_t_be_drawn(make: object, message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        make()  # type: ignore[operator]
