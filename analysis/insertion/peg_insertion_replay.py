"""An insertion's run in three dimensions."""

from typing import Final

import numpy as np
from pydrake.geometry import Meshcat

from chamfer.analysis.report.replay import record, set_stage
from chamfer.analysis.scenario.experiment import Outcome
from chamfer.diagrams.insertion.peg_insertion import JOINTS, PegInsertionScenario
from chamfer.diagrams.insertion.peg_insertion_view import make_peg_insertion_view

_EYE: Final = np.array([0.0, -0.12, 0.07])  # m; assumed
_TARGET: Final = np.array([-0.01, 0.0, 0.0])  # m; assumed
_FLOOR: Final = np.array([0.0, 0.0, -0.05])  # m; assumed


def replay_peg_insertion(
    scenario: PegInsertionScenario, outcome: Outcome, meshcat: Meshcat
) -> None:
    """Show a run as an animation; its traces have the time and the joints' positions."""
    view = make_peg_insertion_view(scenario, meshcat)
    set_stage(meshcat, floor=_FLOOR, eye=_EYE, target=_TARGET)
    traces = outcome.traces
    positions = np.column_stack([traces[name] for name in JOINTS])
    record(meshcat, view.diagram, view.plant, np.asarray(traces["time"]), positions)
