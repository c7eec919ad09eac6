"""Simulated insertions beside a design's prediction."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Final

from chamfer.analysis.campaign.campaign import run_each
from chamfer.analysis.campaign.trial_metrics import trial_seed
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.design.design import Design, interval
from chamfer.analysis.design.design_scenario import ResolvedDesignScenario, drawn_design
from chamfer.analysis.insertion.cell_runs import ending, insertion_metrics, run_cell_insertion
from chamfer.analysis.scenario.experiment import Progress

MOST_TRIALS: Final = 10_000


@dataclass(frozen=True, kw_only=True)
class Verified:
    """What became of simulated insertions of a design."""

    trials: int  # that finished
    seated: int
    success: float  # share
    low: float  # of its interval by Clopper and Pearson, 95 %
    high: float
    failed_trials: int  # that ended with an error, and count neither way
    endings: Mapping[str, int]  # how insertions ended that were not seated, most often first
    largest_force: float  # N, of contact, of all trials; medians of 10 ms
    warning: str  # that the prediction is contradicted, in a sentence; "": it is not


def insert_drawn(scenario: ResolvedDesignScenario, seed: int, trial: int) -> Row:
    """Simulate one insertion with drawn errors; it depends on its arguments alone.

    Returns:
        ``seated``, ``force`` N, ``simulated_seconds``, and how it ended as ``ending``.
    """
    one = drawn_design(scenario, seed, trial)
    done = run_cell_insertion(one, trial_seed(seed, trial))
    metrics = insertion_metrics(done, one)
    return {
        "seated": metrics["seated"],
        "force": metrics["force.contact"],
        "simulated_seconds": float(done.traces["time"][-1]),
        "ending": ending(done, one),
    }


def verify(
    scenario: ResolvedDesignScenario, design: Design, trials: int, seed: int, progress: Progress
) -> Verified:
    """Simulate insertions with drawn errors, and put them beside the prediction.

    Raises:
        UserError, ExperimentError: If every trial fails.
    """
    found = run_each(partial(insert_drawn, scenario, seed), range(trials), progress)
    seated = int(found.column("seated").sum())
    low, high = interval(seated, len(found))
    ends = Counter(row["ending"] for row in found.rows if not row["seated"])
    return Verified(
        trials=len(found),
        seated=seated,
        success=seated / len(found),
        low=low,
        high=high,
        failed_trials=len(found.failed),
        endings=dict(ends.most_common()),
        largest_force=float(found.column("force").max()),
        warning=contradiction(design, seated, len(found)),
    )


def contradiction(design: Design, seated: int, trials: int) -> str:
    """Return in a sentence how simulated insertions contradict a design, "" if they do not.

    A certain design has no error within its bounds that doesn't go in, and one that is not to go
    in none that does: a single one says otherwise. Where it is likely, the intervals of the
    predicted and the simulated share have to overlap.
    """
    said = f"the design is called {design.verdict!r}"
    if design.verdict == "certain" and seated < trials:
        return f"{said}, but {trials - seated} of {trials} simulated insertions were not seated"
    if design.verdict == "no" and seated:
        return f"{said}, but {seated} of {trials} simulated insertions were seated"
    if design.verdict == "likely":
        low, high = interval(seated, trials)
        if high < design.share_low or design.share_high < low:
            return (
                f"{said} with {100 * design.share_low:.3g} to {100 * design.share_high:.3g} % of "
                f"the errors inside, but {100 * low:.3g} to {100 * high:.3g} % of the insertions "
                "are seated"
            )
    return ""
