"""One blind feed of the work cell: what became of it, and how the parts met."""

import math
from enum import IntEnum
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, EventStatus

from chamfer.analysis.insertion.insertion_runs import median
from chamfer.diagrams.insertion.blind_feed import BlindFeedScenario, Plane, make_blind_feed_diagram
from chamfer.systems.contact.peg_hole_contact_monitor import FEATURES, WRENCH_SIZE, ContactState
from chamfer.systems.pose import pose_from_vector

Array = NDArray[np.float64]

_SLICE: Final = 0.01  # s, after which a run is asked whether it is over
_MOVED: Final = 2e-4  # m, by which a peg that is held comes out at most as the push goes
_FREE: Final = 0.05  # N, of the hole along the axis: the push is gone
_IN_BORE: Final = (ContactState.ONE_POINT, ContactState.TWO_POINT)
_TOUCHING: Final = 0.01  # N
_PORTS: Final = (
    ("depth", 1),
    ("state", 1),
    ("wrench", WRENCH_SIZE),
    ("normal_forces", len(FEATURES)),
)
_CHAMFER, _FACE, _BOTTOM = (FEATURES.index(name) for name in ("chamfer", "face", "bottom"))


class FeedOutcome(IntEnum):
    """What became of a peg that was fed."""

    SEATED = 0  # as deep as it has to be, or on the bottom
    WEDGED = 1  # in the bore, held when the push is taken away
    JAMMED = 2  # in the bore, held by the push alone
    ON_EDGE = 3  # stuck on the chamfers or on the bore's edge
    MISSED = 4  # beside the mouth


class Errors(NamedTuple):
    """How the peg is off in a plane of insertion."""

    lateral: float  # m, of the tip, to +y or +z of the mouth's frame
    tilt: float  # rad, of the same sign if they add


class BlindFeed(NamedTuple):
    """A finished run; one row per step."""

    time: Array  # s, shape (n,)
    depth: Array  # m, of the tip below the mouth
    state: Array  # of ContactState
    wrench: Array  # N m above N, of the hole on the peg, shape (n, 6)
    normal: Array  # N, by feature, shape (n, 5)
    touch: dict[Plane, Errors] | None  # as the parts touch first; None: they never do


def feed_blind(scenario: BlindFeedScenario) -> BlindFeed:
    """Feed the peg until it is as deep as it can get, or else take the push away again.

    A peg that is beside the mouth at the end of the feed is left there. It is fed to the end
    because its tip may still slip off the face.
    """
    diagram = make_blind_feed_diagram(scenario)
    ports = [diagram.GetOutputPort(f"contact.{name}") for name, _ in _PORTS]
    poses = [diagram.GetOutputPort(f"{arm}.true_pose") for arm in ("peg", "hole")]
    rows = np.zeros((round(scenario.duration / scenario.step) + 2, sum(n for _, n in _PORTS)))
    time: list[float] = []
    touch: list[dict[Plane, Errors]] = []

    def record(context: Context) -> EventStatus:
        if time and context.get_time() < time[-1] + scenario.step / 2:
            return EventStatus.DidNothing()
        row = rows[len(time)]
        row[:1], row[1:2], row[2:8], row[8:] = (port.Eval(context) for port in ports)
        time.append(context.get_time())
        if row[1] != ContactState.NONE and not touch:
            touch.append(errors_in(*(port.Eval(context) for port in poses)))
        return EventStatus.DidNothing()

    simulator = Simulator(diagram)
    simulator.set_monitor(record)
    simulator.Initialize()
    for k in range(math.ceil(scenario.duration / _SLICE)):
        simulator.AdvanceTo(min(_SLICE * (k + 1), scenario.duration))
        last = rows[len(time) - 1]
        beside = last[1] in (ContactState.NONE, ContactState.FACE)
        deep = last[0] >= scenario.depth or last[8 + _BOTTOM] > _TOUCHING
        if deep or (time[-1] > scenario.released and beside):
            break
    found = rows[: len(time)]
    return BlindFeed(
        time=np.array(time),
        depth=found[:, 0],
        state=found[:, 1],
        wrench=found[:, 2:8],
        normal=found[:, 8:],
        touch=touch[0] if touch else None,
    )


def errors_in(peg: Array, hole: Array) -> dict[Plane, Errors]:
    """Return the errors of a tip's pose and a mouth's, shape (7,) each, in both planes."""
    X_MT = pose_from_vector(hole).inverse() @ pose_from_vector(peg)
    axis, tip = X_MT.rotation().matrix()[:, 0], X_MT.translation()
    planes: tuple[Plane, ...] = ("xy", "xz")
    return {
        plane: Errors(float(tip[k]), -math.atan2(axis[k], axis[0]))
        for k, plane in enumerate(planes, start=1)
    }


def outcome(scenario: BlindFeedScenario, run: BlindFeed) -> FeedOutcome:
    """Return what became of the peg."""
    fed = run.time <= scenario.released + scenario.step / 2
    if (run.state[fed] == ContactState.SEATED).any():
        return FeedOutcome.SEATED
    end = int(np.flatnonzero(fed)[-1])  # of the feed, or of the run
    if run.state[end] in _IN_BORE:
        return FeedOutcome.WEDGED if _held(run, end) else FeedOutcome.JAMMED
    on_edge = run.normal[end, _CHAMFER] > run.normal[end, _FACE]
    return FeedOutcome.ON_EDGE if on_edge else FeedOutcome.MISSED


def _held(run: BlindFeed, end: int) -> bool:
    """Whether a peg stays where it is until the push is gone."""
    axial = -run.wrench[end:, 3]
    free = np.flatnonzero(axial <= _FREE)
    return bool(free.size and run.depth[end] - run.depth[end + free[0]] < _MOVED)


def measured(scenario: BlindFeedScenario, run: BlindFeed) -> dict[str, float | None]:
    """Return what a run measured, m, N and rad; None where it is undefined.

    Forces are the largest medians of 10 ms until the peg is seated; pressing on the bottom is none
    of them.
    """
    fed = run.time <= scenario.released + scenario.step / 2
    fed &= np.logical_and.accumulate(run.normal[:, _BOTTOM] <= _TOUCHING)
    axial = median(-run.wrench[:, 3], scenario.step)[fed]
    across = np.hypot(*(median(one, scenario.step) for one in run.wrench[:, 4:].T))[fed]
    two = np.flatnonzero(run.state[fed] == ContactState.TWO_POINT)
    onset = None
    if two.size:
        onset = float(run.depth[two[0]]) - scenario.parts.chamfer_height
    touch = None if run.touch is None else run.touch[scenario.plane]
    return {
        "outcome": float(outcome(scenario, run)),
        "depth": float(run.depth[fed].max()),
        "force.axial": float(axial.max()),
        "force.lateral": float(across.max()),
        "force.raw_peak": float(-run.wrench[fed, 3].min()),
        "two_point.onset": onset,
        "touch.lateral_error": None if touch is None else touch.lateral,
        "touch.rotational_error": None if touch is None else touch.tilt,
        "simulated_seconds": float(run.time[-1]),
    }
