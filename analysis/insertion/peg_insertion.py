"""Whitney's case: one peg on a spring support is fed into its hole (Fig. 1)."""

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from chamfer.analysis.insertion.insertion_runs import Insertion, insert, measure, median, path
from chamfer.analysis.insertion.peg_insertion_figures import plot_peg_insertion
from chamfer.analysis.scenario.experiment import Outcome, Progress, Table, column
from chamfer.diagrams.insertion.peg_insertion import (
    JOINTS,
    PegInsertionScenario,
)
from chamfer.systems.contact.peg_hole_contact_monitor import FEATURES


def run(scenario: PegInsertionScenario, seed: int, progress: Progress) -> Outcome:
    """Feed the peg in; nothing is random."""
    finished = insert(scenario, progress)
    return Outcome(
        metrics=measure(scenario, finished),
        traces=_traces(scenario, finished),
        simulated_seconds=float(finished.time[-1]),
        tables={"predicted": path(scenario)},
    )


def _traces(scenario: PegInsertionScenario, run: Insertion) -> Table:
    lateral = {f"force_{axis}": run.lateral[:, k] for k, axis in enumerate("yz")}
    columns = {
        "time": run.time,
        "depth": run.depth,
        "push": run.push,
        "force_x": run.axial,
        **lateral,
        "force_x_median": median(run.axial, scenario.step),
        "force_y_median": median(run.lateral[:, 0], scenario.step),
        "state": run.state,
        **{f"normal_{name}": run.normal[:, k] for k, name in enumerate(FEATURES)},
        **{name: run.joints[:, k] for k, name in enumerate(JOINTS)},
        "tip": run.joints[:, 1] - scenario.support.centre_distance * np.sin(run.tilt),
        "tilt": run.tilt,
        "loss": run.loss,
    }
    return {name: column(values) for name, values in columns.items()}


def figures(scenario: PegInsertionScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    return {"peg-insertion": plot_peg_insertion(scenario, outcome)}
