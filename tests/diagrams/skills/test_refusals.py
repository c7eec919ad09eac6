"""Scenarios of skills and of vision primitives that cannot be."""

from typing import Any

import pytest

from chamfer.diagrams.skills.connector_scenario import ConnectorScenario
from chamfer.diagrams.skills.dither_loops import CorrelationScenario
from chamfer.models.arms.wrist import WristParams
from chamfer.models.validation import ParameterError
from chamfer.systems.force.admittance_law import AdmittanceParams
from chamfer.systems.primitives.trajectory_primitives import Dither
from chamfer.systems.sensing.force_sensor import WrenchSensorParams

STIFF = WristParams(stiffness=tuple(1.3 * k for k in WristParams().stiffness))
UNSTABLE = f"stiffness is {STIFF.stiffness}, allowed: at most"

SPRUNG = AdmittanceParams(stiffness=(0.0,) * 6, spring=(1.0,) * 6)


@pytest.mark.parametrize(
    ("kind", "changes", "message"),
    [
        # What is believed has to be stable, the truth need not.
        (ConnectorScenario, {"wrist": STIFF}, f"wrist.{UNSTABLE}"),
        (ConnectorScenario, {"believed_wrist": STIFF}, f"believed_wrist.{UNSTABLE}"),
        (
            ConnectorScenario,
            {"believed_sensor": WrenchSensorParams(noise=1.0)},
            "believed_sensor.noise is 1.0, allowed: left open: only origin, cross_talk, decoupl",
        ),
        (ConnectorScenario, {"accommodation": SPRUNG}, f"accommodation.spring is {SPRUNG.spring}"),
        (CorrelationScenario, {"dither": Dither(frequency=3.3)}, "dither.frequency is 3.3, allow"),
        (CorrelationScenario, {"dither": Dither(frequency=100 / 3)}, "dither.frequency is 33.3"),
    ],
)
def test_refuses(kind: Any, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError) as refused:
        kind(**changes)
    assert str(refused.value).startswith(message)
