"""Metrics of insertions, and the comparison of a skill's report with the truth."""

import math
from typing import Any, Final, NamedTuple

import numpy as np

from chamfer.analysis.campaign.trial_metrics import Quantity, Trial
from chamfer.analysis.skills.skill_run import SkillResult
from chamfer.models.connectors.connector import Connector
from chamfer.systems.primitives.position_primitives import Held
from chamfer.systems.primitives.skill import RETRACT, Skill

# What :func:`insertion_metrics` measures.
INSERTION: Final = {
    "success": Quantity(""),
    "duration": Quantity("s"),
    "depth": Quantity("m"),
    "force.peak": Quantity("N"),
    "force.peak_share": Quantity(""),
    "force.share": Quantity("%"),
    "torque.peak": Quantity("N m"),
    "torque.share": Quantity("%"),
    "retries": Quantity(""),
    "real_time_factor": Quantity(""),
}
MATED: Final = 0.0005  # m, of the mated depth, within which a plug is in
_LOCKED: Final = 0.3  # rad, of the mated turn, within which it is locked
_TILTED: Final = 0.015  # rad, of a plug that is out of line; what lies on an obstacle is flatter
_TOUCH: Final = 1.0  # N, with which a plug touches something at least
_HELD: Final = 0.5  # between 0, nothing is in the gripper, and 1
_CLEAR: Final = 0.002  # m, over the socket's face, where a plug that is retracted is at least


def insertion_metrics(done: SkillResult, connector: Connector) -> Trial:
    """Return the metrics of a run.

    ``success`` is 1 if the skill reports done and the plug is truly in. ``force.peak`` is the
    largest true push or pull along the insertion at any step of the plant, its share that of the
    true mating force, and ``torque.peak`` the largest true torque about an axis, likewise.
    ``force.share`` and ``torque.share`` are the largest load along and about any axis, as a share
    of the load that plug and socket withstand.
    """
    traces = done.traces
    depth = float(traces["depth"][-1])
    peak, torque = float(done.peaks[-1]), float(done.peaks[:3].max())
    return {
        "success": float(failure(done, connector) is None),
        "duration": float(traces["time"][-1]),
        "depth": depth,
        "force.peak": peak,
        "force.peak_share": peak / connector.mating_force,
        "force.share": 100 * float(done.peaks[3:].max()) / connector.largest_force,
        "torque.peak": torque,
        "torque.share": 100 * torque / connector.largest_torque,
        "retries": float(traces["retries"][-1]),
        "real_time_factor": round(float(traces["time"][-1]) / done.wall_seconds, 2),
    }


class Failure(NamedTuple):
    """The reason of a failed run, and the true values at its failure."""

    state: str  # in which it failed
    outcome: str  # of that state, such as "jammed"
    depth: float  # m, true
    mated: float  # m, depth of a mated plug
    force: float  # N, on the plug against its insertion, true
    tilt: float  # rad, of the plug in the socket, true
    time: float  # s
    expected: str  # in place of the outcome, in words; may be empty

    @property
    def reason(self) -> str:
        """The state and its outcome, by which runs are counted."""
        return f"{self.state}: {self.outcome}"

    @property
    def text(self) -> str:
        """The whole reason in one line."""
        found = (
            f"{self.reason} at {1e3 * self.depth:z.1f} of {1e3 * self.mated:.1f} mm, "
            f"{self.force:z.0f} N, {math.degrees(self.tilt):.1f} degrees, after {self.time:.1f} s"
        )
        return f"{found}; expected {self.expected}" if self.expected else found


def failure(done: SkillResult, connector: Connector) -> Failure | None:
    """Return the reason of a failed run, with the truth in the simulation; None for a success."""
    state, outcome, expected = done.state, "still running", ""
    row = len(done.traces["time"]) - 1
    if done.outcome == "failed":
        state, _, outcome = done.reason.rpartition(": ")
        expected = done.expected
        row = next((_row(done, one.time) for one in done.path[::-1] if one.target == RETRACT), row)
    names = ("depth", "turn", "true_wrench_z", "tilt", "time")
    depth, turn, force, tilt, time = (float(done.traces[name][row]) for name in names)
    if done.outcome == "done":
        if is_mated(connector, depth, turn):
            return None
        state = done.path[-1].source
        outcome, expected = "done but not mated", f"within {1e3 * MATED:g} mm"
        if connector.mated_turn is not None:
            turned = math.remainder(turn - connector.mated_turn, math.pi)
            expected += f", turned {math.degrees(turned):.0f} degrees from the mated angle"
    return Failure(state, outcome, depth, connector.mated_depth, force, tilt, time, expected)


def failure_columns(found: Failure | None) -> dict[str, str | float | None]:
    """Return a failure as columns of a trial's row, None and empty without one."""
    numbers = {name: getattr(found, name, None) for name in ("depth", "force", "tilt", "time")}
    return {
        "reason": found.reason if found else "",
        "reason.text": found.text if found else "",
        **{f"reason.{name}": value for name, value in numbers.items()},
    }


def peak(done: SkillResult) -> dict[str, Any]:
    """Return the place of the largest true force along the insertion: state, depth, tilt."""
    at = done.peak_time
    state = next((one.source for one in done.path if one.time >= at), done.state)
    row = min(_row(done, at), len(done.traces["time"]) - 1)
    return {"state": state, **{name: float(done.traces[name][row]) for name in ("depth", "tilt")}}


def is_mated(connector: Connector, depth: float, turn: float) -> bool:
    """Return whether a plug is fully in, m, and locked by its turn in the socket about z, rad."""
    if abs(depth - connector.mated_depth) > MATED:
        return False
    if connector.mated_turn is None:
        return True
    return abs(math.remainder(turn - connector.mated_turn, math.pi)) < _LOCKED


class InsertionVerdict(NamedTuple):
    """The truth about a run."""

    mated: bool  # at the end of the run
    false_done: bool  # it reports done, and the plug is not mated
    hindered: int  # how often it detected an obstructed motion of the plug
    false_hindered: int  # how often the plug was then not even in the mouth of the socket
    false_reason: bool  # it failed, but not for its reason, or the plug is not out


def verdict(done: SkillResult, connector: Connector, skill: Skill) -> InsertionVerdict:
    """Return the truth about a run of a skill."""
    depth, turn = done.traces["depth"], done.traces["turn"]
    mated = is_mated(connector, float(depth[-1]), float(turn[-1]))
    found = [one for one in done.path if one.outcome == "hindered"]
    outside = [one for one in found if depth[_row(done, one.time)] < connector.lead_in]
    return InsertionVerdict(
        mated=mated,
        false_done=done.outcome == "done" and not mated,
        hindered=len(found),
        false_hindered=len(outside),
        false_reason=done.outcome == "failed" and not _truthful(done, connector, skill),
    )


def _truthful(done: SkillResult, connector: Connector, skill: Skill) -> bool:
    """Return whether a skill failed for its reason, and is out of the socket.

    A reason is a state and its outcome at the failure. A lost grip is judged by the truth; a part
    that the cameras lost is not judged. Every other reason needs a plug that was never held, or
    that is held, not mated, and pulled out in the end. A jammed plug also touches something, and a
    tilted one is out of line.
    """
    given_up = [one for one in done.path if one.target == RETRACT]
    if not given_up:
        return False
    last = given_up[-1]
    row = _row(done, last.time)
    depth, turn, tilt = (float(done.traces[name][row]) for name in ("depth", "turn", "tilt"))
    held = done.traces["holding"][: row + 1] >= _HELD
    state = next(one for one in skill.states if one.name == last.source)
    if last.outcome == "lost" and any(isinstance(one, Held) for one in state.run):
        return state.looks or not held[-1]
    force = [done.traces[f"true_wrench_{axis}"][row] for axis in "xyz"]
    if last.outcome in ("jammed", "tilted") and np.linalg.norm(force) < _TOUCH:
        return False
    if last.outcome == "tilted" and tilt < _TILTED:
        return False
    out = float(done.traces["depth"][-1]) < -_CLEAR
    return not held.any() or bool(held[-1] and out and not is_mated(connector, depth, turn))


def _row(done: SkillResult, time: float) -> int:
    """Return the traces' row at a time, s, such as when a state was left."""
    return int(np.searchsorted(done.traces["time"], time - 1e-6))
