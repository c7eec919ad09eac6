"""Scenarios of skills and of vision primitives that cannot be."""

import math
from typing import Any

import pytest

from chamfer.diagrams.skills.connector_scenario import ConnectorScenario
from chamfer.diagrams.skills.connector_sight import SightSettings
from chamfer.diagrams.skills.dither_loops import CorrelationScenario
from chamfer.diagrams.skills.vision_servo import VisionServoScenario
from chamfer.models.arms.wrist import WristParams
from chamfer.models.validation import ParameterError
from chamfer.systems.primitives.trajectory_primitives import Dither

STIFF = WristParams(stiffness=tuple(1.3 * k for k in WristParams().stiffness))
UNSTABLE = f"stiffness is {STIFF.stiffness}, allowed: at most"
OFF = (0.0, 0.0, 0.0, 0.0, 0.0, math.nan)


@pytest.mark.parametrize(
    ("kind", "changes", "message"),
    [
        (VisionServoScenario, {"primitive": "zoom"}, "primitive is 'zoom', allowed: translation"),
        (VisionServoScenario, {"start": (0.0,)}, "start is (0.0,), allowed: 6 finite numbers"),
        (VisionServoScenario, {"lever": ()}, "lever is (), allowed: 3 finite numbers"),
        (SightSettings, {"middle": (0.0,)}, "middle is (0.0,), allowed: 3 finite numbers"),
        (SightSettings, {"plug": (0.0, math.inf, 0.0)}, "plug is (0.0, inf, 0.0), allowed: 3"),
        (SightSettings, {"standby": ()}, "standby is (), allowed: 3 finite numbers"),
        (ConnectorScenario, {"robot": "puma"}, "robot is 'puma', allowed: carriage, wam"),
        (ConnectorScenario, {"initial_error": OFF}, f"initial_error is {OFF}, allowed: 6 finite"),
        # What is believed has to be stable, the truth need not.
        (ConnectorScenario, {"wrist": STIFF}, f"wrist.{UNSTABLE}"),
        (ConnectorScenario, {"believed_wrist": STIFF}, f"believed_wrist.{UNSTABLE}"),
        (CorrelationScenario, {"dither": Dither(frequency=3.3)}, "dither.frequency is 3.3, allow"),
        (CorrelationScenario, {"dither": Dither(frequency=100 / 3)}, "dither.frequency is 33.3"),
    ],
)
def test_refuses(kind: Any, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError) as refused:
        kind(**changes)
    assert str(refused.value).startswith(message)
