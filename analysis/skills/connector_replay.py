"""An insertion's run in three dimensions: plug and socket as they truly were, and the gripper."""

from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Meshcat

from chamfer.analysis.report.replay import record, set_stage
from chamfer.analysis.scenario.experiment import Outcome, Table
from chamfer.analysis.skills.skill_run import AXES
from chamfer.diagrams.skills.connector_insertion import PartScenario
from chamfer.diagrams.skills.connector_view import make_connector_view

Array = NDArray[np.float64]

_EYE: Final = np.array([0.07, -0.05, 0.04])  # m; assumed
_TARGET: Final = np.array([-0.01, 0.01, 0.012])  # m; assumed
_FLOOR: Final = np.array([0.0, 0.0, -0.05])  # m; assumed


def replay_insertion(scenario: PartScenario, outcome: Outcome, meshcat: Meshcat) -> None:
    """Show a run as an animation, seen at first from near the socket.

    Args:
        scenario: Of the run.
        outcome: Its traces have the columns ``time``, s, and ``plug_<axis>`` and
            ``carriage_<axis>``, the true displacement of the plug's tip and that of the
            gripper, rad or m.
        meshcat: Where.

    Raises:
        ValueError: If a column is missing, or what :func:`chamfer.analysis.report.replay.record`
        raises.
    """
    view = make_connector_view(scenario, meshcat)
    set_stage(meshcat, floor=_FLOOR, eye=_EYE, target=_TARGET)
    plug, carriage = (_displacement(outcome.traces, name) for name in ("plug", "carriage"))
    time = _column(outcome.traces, "time")
    record(meshcat, view.diagram, view.plant, time, view.positions(plug, carriage))


def _displacement(traces: Table, name: str) -> Array:
    return np.column_stack([_column(traces, f"{name}_{axis}") for axis in AXES])


def _column(traces: Table, name: str) -> Array:
    if name not in traces:
        raise ValueError(f"the traces lack the column {name!r}, which the replay needs")
    return np.asarray(traces[name], dtype=np.float64)
