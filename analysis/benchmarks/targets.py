"""How fast Chamfer means to be, as ratios that do not depend on the machine."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

from chamfer.analysis.benchmarks import compiled, insertion, observers
from chamfer.analysis.benchmarks.cold_start import COMMAND, IMPORTS, ColdStart
from chamfer.analysis.benchmarks.engine import LoopName
from chamfer.analysis.benchmarks.insertion import Insertions
from chamfer.analysis.benchmarks.observers import Updates
from chamfer.analysis.benchmarks.real_time import TARGETS, RealTime
from chamfer.analysis.benchmarks.timing import Times, ratio

_REFERENCE: Final = "Chamfer"
# Drake as it comes is no peer of the FSM loop: it runs the same compensator.
_PEERS: Final[Mapping[LoopName, tuple[str, ...]]] = {
    "fsm": ("python-control", "SciPy RK45 per tick", "bdsim", "pathsim"),
    "pid": (
        "Drake as it comes",
        "SciPy LSODA, solve_ivp",
        "SciPy LSODA, odeint",
        "python-control",
        "bdsim",
        "pathsim",
    ),
}
_TIMES_FASTER: Final = 100.0  # a trial of a map than SciPy's, stepped per tick


@dataclass(frozen=True, kw_only=True)
class Target:
    """A ratio of two times and the bound on it."""

    text: str
    relation: Literal["at_least", "at_most"]
    bound: float
    measured: float | None  # None: not measured

    @property
    def ok(self) -> bool | None:
        """Whether the bound is kept; None if it was not measured."""
        if self.measured is None:
            return None
        if self.relation == "at_least":
            return self.measured >= self.bound
        return self.measured <= self.bound


def targets(
    times: Mapping[LoopName, Mapping[str, Times]],
    cold: ColdStart,
    real_time: RealTime,
    updates: Updates,
    insertions: Insertions,
) -> list[Target]:
    """Return the targets with what was measured: to be ahead of every peer, and by how much."""
    found = [
        Target(
            text=f"{loop.upper()} loop: {name} / {_REFERENCE}",
            relation="at_least",
            bound=1.0,
            measured=_slower(times, loop, name, _REFERENCE),
        )
        for loop, names in _PEERS.items()
        for name in names
    ]
    found.append(
        Target(
            text=f"FSM loop: SciPy RK45 per tick / {compiled.NAME}",
            relation="at_least",
            bound=_TIMES_FASTER,
            measured=_slower(times, "fsm", "SciPy RK45 per tick", compiled.NAME),
        )
    )
    trial = _median(times.get("fsm", {}), compiled.NAME)
    found.append(
        Target(
            text=f"FSM loop: {compiled.NAME}, s for 10,000 trials on one core",
            relation="at_most",
            bound=20.0,
            measured=None if trial is None else 10_000 * trial,
        )
    )
    found.append(
        Target(
            text=f"{COMMAND} / {IMPORTS}",
            relation="at_most",
            bound=2.0,
            measured=ratio(cold.median(COMMAND), cold.median(IMPORTS)),
        )
    )
    found += [
        Target(
            text=f"{name}: simulated / elapsed",
            relation="at_least",
            bound=bound,
            measured=real_time.median(name),
        )
        for name, bound in TARGETS.items()
    ]
    found += [
        Target(
            text=f"an update of the observer {name}, us",
            relation="at_most",
            bound=1e6 * bound,
            measured=1e6 * updates.seconds[name] if name in updates.seconds else None,
        )
        for name, bound in observers.TARGETS.items()
    ]
    return [*found, *_insertions(insertions)]


def _insertions(found: Insertions) -> list[Target]:
    bounds, engine = insertion.TARGETS, insertion.CHAMFER
    return [
        Target(
            text="insertions: outcome as exact statics say where they are sure, %",
            relation="at_least",
            bound=bounds["agreement"],
            measured=insertion.agreement(found, engine),
        ),
        Target(
            text="insertions: onset from Whitney's closed form, mm",
            relation="at_most",
            bound=bounds["onset"],
            measured=insertion.worst_onset(found, engine),
        ),
        Target(
            text="insertions: peak from exact statics at 3 to 5 degrees, %",
            relation="at_most",
            bound=bounds["force"],
            measured=insertion.worst_force(found, engine),
        ),
    ]


def _slower(
    times: Mapping[LoopName, Mapping[str, Times]], loop: LoopName, name: str, reference: str
) -> float | None:
    taken = times.get(loop, {})
    return ratio(_median(taken, name), _median(taken, reference))


def _median(taken: Mapping[str, Times], name: str) -> float | None:
    return taken[name].run if name in taken else None
