"""What is asked of a design, answered: its chain, what to change, a map, simulated insertions."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from chamfer.analysis.design.changes import Change, changes
from chamfer.analysis.design.design import Design, assess
from chamfer.analysis.design.design_map import DesignMap, MapAxis, map_design
from chamfer.analysis.design.design_scenario import DesignScenario, resolve_design
from chamfer.analysis.design.verification import Verified, verify
from chamfer.analysis.scenario.experiment import Progress

# What is done, and up to which share of the whole it is told to be.
_CHANGES: Final = "changes"
_MAP: Final = "map"
_INSERTIONS: Final = "insertions"


@dataclass(frozen=True, kw_only=True)
class Answer:
    """What is found of a design."""

    scenario: DesignScenario  # resolved
    seed: int
    design: Design
    changes: tuple[Change, ...] | None  # the largest sensitivity first; None: not asked
    map: DesignMap | None = None
    verified: Verified | None = None


def answer(
    given: DesignScenario,
    *,
    what_to_change: bool = True,
    axes: Sequence[MapAxis] | None,
    trials: int,
    seed: int,
    progress: Progress,
) -> Answer:
    """Answer what is asked of a design.

    Args:
        given: The design, not resolved: what it leaves open follows from what is changed.
        what_to_change: Whether to look for changes, which takes most of the time.
        axes: Of its map; None: no map.
        trials: How many insertions to simulate; 0: none.
        seed: Of all randomness.
        progress: Told how far it is.

    Raises:
        ParameterError: If there can be no such design.
    """
    wanted = {_CHANGES: what_to_change, _MAP: axes is not None, _INSERTIONS: trials > 0}
    asked = [name for name, is_asked in wanted.items() if is_asked]

    def stage(name: str) -> Progress:
        begin, whole = asked.index(name), len(asked)

        def told(fraction: float, doing: str = "") -> None:
            progress((begin + fraction) / whole, f"{name} {doing}".rstrip())

        return told

    scenario = resolve_design(given)
    design = assess(scenario, seed)
    return Answer(
        scenario=scenario,
        seed=seed,
        design=design,
        changes=changes(given, seed, stage(_CHANGES)) if what_to_change else None,
        map=map_design(given, axes, seed, stage(_MAP)) if axes else None,
        verified=verify(scenario, design, trials, seed, stage(_INSERTIONS)) if trials else None,
    )
