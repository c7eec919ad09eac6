"""Which pictures of a mouth are refused: none is wrong and sure."""

from dataclasses import replace

import pytest

from chamfer.analysis.sight.hand_camera import STUDY, figures, resolve_hand_camera, run
from chamfer.models.validation import ParameterError


def outcome_of(**changes):
    scenario = resolve_hand_camera(replace(STUDY, **changes))
    return scenario, run(scenario, 1, lambda *done: None)


@pytest.mark.parametrize("chamfer", [0.001, 0.0])
def test_no_picture_is_wrong_and_sure(chamfer):
    parts = replace(STUDY.parts, chamfer_width=chamfer)
    scenario, outcome = outcome_of(pictures=1, parts=parts)
    value = {name: metric.value for name, metric in outcome.metrics.items()}
    assert value["wrong"] == 0
    for name in ("plain", "noise", "dirt", "second-hole", "shadow", "scratches"):
        assert value[f"{name}.mild.found"] == 100, name
    for name in ("other-hole", "no-hole"):
        assert value[f"{name}.severe.found"] == 0, name
    assert value["plain.lateral_error.95"] < 5e-5
    assert set(figures(scenario, outcome)) == {"hand-camera"}


def test_a_gap_at_which_the_peg_hides_the_mouth_is_refused():
    with pytest.raises(ParameterError, match=r"reach is 0.004, allowed: one with which some"):
        resolve_hand_camera(replace(STUDY, gap=0.004))
