"""How fast Chamfer means to be, as ratios that do not depend on the machine."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

from analysis.benchmarks import observers
from analysis.benchmarks.cold_start import COMMAND, IMPORTS, ColdStart
from analysis.benchmarks.engine import LoopName
from analysis.benchmarks.observers import Updates
from analysis.benchmarks.real_time import TARGETS, RealTime
from analysis.benchmarks.timing import Times, ratio

_REFERENCE: Final = "Chamfer"


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
) -> list[Target]:
    """Return the targets with what was measured.

    Those of the FSM loop were seen in a prototype, with the engines' versions and settings of
    its time.
    """
    found = [
        _slower("fsm", name, bound, times)
        for name, bound in (
            ("python-control", 4.7),
            ("SciPy RK45 per tick", 13.0),
            ("bdsim", 74.0),
            ("pathsim", 118.0),
        )
    ]
    found += [
        _slower("pid", name, 1.0, times)
        for name in ("Drake as it comes", "python-control", "bdsim", "pathsim")
    ]
    pid = times.get("pid", {})
    found += [
        Target(
            text=f"PID loop: Chamfer / {name}",
            relation="at_most",
            bound=1.5,
            measured=ratio(_median(pid, _REFERENCE), _median(pid, name)),
        )
        for name in ("SciPy LSODA, solve_ivp", "SciPy LSODA, odeint")
    ]
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
    return found


def _slower(
    loop: LoopName, name: str, bound: float, times: Mapping[LoopName, Mapping[str, Times]]
) -> Target:
    taken = times.get(loop, {})
    return Target(
        text=f"{loop.upper()} loop: {name} / Chamfer",
        relation="at_least",
        bound=bound,
        measured=ratio(_median(taken, name), _median(taken, _REFERENCE)),
    )


def _median(taken: Mapping[str, Times], name: str) -> float | None:
    return taken[name].run if name in taken else None
