"""What the planar theory says of an insertion in the cell, from its errors at the touch."""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from chamfer.analysis.insertion.cell_runs import (
    CellInsertion,
    errors_in_one_plane,
    errors_in_planes,
    touch_row,
)
from chamfer.analysis.scenario.experiment import Metric
from chamfer.diagrams.insertion.insertion import task_params
from chamfer.diagrams.insertion.insertion_scenario import InsertionScenario
from chamfer.models.peg_theory.fed_insertion import FeedPrediction, Verdict, predict_feed

Array = NDArray[np.float64]

_UNITS: Final = {
    "predicted.seated": "",
    "predicted.force.axial": "N",
    "predicted.two_point.onset": "m",
    "predicted.may_wedge": "",
    "touch.margin": "%",
}
_ASIDE: Final = 0.1  # share of an error that may be out of the plane of the theory
_HELD: Final = "the errors at the touch held, no friction in the joints, quasi-static"


def predict(scenario: InsertionScenario, done: CellInsertion) -> dict[str, Metric]:
    """Return what theory says of the last attempt, and the margin that its touch had."""
    row = touch_row(done)
    if row is None:
        never = "it never touches"
        return {name: Metric(value=None, unit=unit, note=never) for name, unit in _UNITS.items()}
    if not (scenario.parts.is_round or _along_faces(done, row)):
        across = "square parts, and errors in no plane along faces: the theory is planar"
        return {name: Metric(value=None, unit=unit, note=across) for name, unit in _UNITS.items()}
    lateral, tilt = errors_in_one_plane(done.traces, row)
    params = task_params(scenario)
    found = predict_at(scenario, lateral, tilt)
    verdict = Verdict(int(found.verdict))
    axial, onset = float(found.axial), float(found.onset)
    slides = math.isfinite(axial)
    margin = 100 * params.region.margin(lateral, abs(tilt))
    values = {
        "predicted.seated": (
            None if verdict is Verdict.MAY else float(verdict is Verdict.SAFE),
            f"{_HELD}; it may wedge or sit on the edge" if verdict is Verdict.MAY else _HELD,
        ),
        "predicted.force.axial": (
            axial if slides else None,
            f"largest; {_HELD}" if slides else "no push slides it",
        ),
        "predicted.two_point.onset": (
            onset if math.isfinite(onset) else None,
            f"l; {_HELD}" if math.isfinite(onset) else "two points never touch",
        ),
        "predicted.may_wedge": (float(found.may_wedge), "1: two points may hold it"),
        "touch.margin": (margin, "of the region free of wedging, the worst signs; < 0: outside"),
    }
    return {
        name: Metric(value=value, unit=_UNITS[name], note=note)
        for name, (value, note) in values.items()
    }


def _along_faces(done: CellInsertion, row: int) -> bool:
    """Whether lateral error and tilt are in one of the planes along the faces of square parts."""
    planes = errors_in_planes(done.traces).values()
    one, other = (np.abs([float(e[row]), float(t[row])]) for e, t in planes)
    return bool((one <= _ASIDE * other).all() or (other <= _ASIDE * one).all())


def predict_at(scenario: InsertionScenario, lateral: float, tilt: float) -> FeedPrediction:
    """Return what theory says of errors in one plane, m and rad."""

    def push_at(depth: Array) -> Array:
        return np.full(np.shape(depth), scenario.insert.push)

    return predict_feed(
        scenario.parts,
        scenario.support_at,
        push_at,
        lateral,
        tilt,
        depth=task_params(scenario).target,
    )
