"""Runs of the loop that charges a crucible, and the limits of section 1.1.2 for each item."""

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.analysis.linear.simulate import Run, simulate
from chamfer.analysis.scenario.experiment import Progress, Table
from chamfer.diagrams.charging.charging_loop import make_charging_diagram
from chamfer.diagrams.charging.charging_scenario import (
    ResolvedCrucibleChargingScenario,
    make_scenes,
)
from chamfer.models.arms.adept_wrist import ADEPT_WRIST, gripper_points
from chamfer.models.charging.packing import LaidNugget, Nugget, PlanItem
from chamfer.models.charging.station import Station
from chamfer.models.surfaces.surface import locate
from chamfer.systems.charging.charging_machine import ChargingMachine
from chamfer.systems.contact.arm_motion import CONTACT_SIGNALS
from chamfer.systems.force.projection import unit

Array = NDArray[np.float64]

_TOLD: Final = ("gap", "peak_force", "impact_speed")
_LAYER: Final = 1  # index of the contact point that meets what lies below
_MET: Final = 1e-3  # m, gap to it
_FAR: Final = 1.0  # m, gap to what is not there


class ChargingRun(NamedTuple):
    """Result of a run."""

    traces: dict[str, Array]
    transitions: dict[str, NDArray[Any]]  # time s, source, target, label, item; one row each
    reason: str  # why it stopped, "" if it finished


def run_charging(
    scenario: ResolvedCrucibleChargingScenario, seed: int, progress: Progress | None = None
) -> ChargingRun:
    """Simulate until the plan is laid or the cycle has stopped.

    The traces are those of :func:`traces_of`.
    """
    diagram = make_charging_diagram(scenario)
    machine = diagram.GetSubsystemByName("charging chart")
    assert isinstance(machine, ChargingMachine)
    finished = diagram.GetOutputPort("finished")

    def ended(root: Any) -> bool:
        return bool(finished.Eval(diagram.GetMyContextFromRoot(root))[0] > 0)

    run = simulate(
        diagram,
        duration=scenario.duration,
        step=scenario.controller.period,
        seed=seed,
        progress=progress,
        ended=ended,
    )
    assert run.final is not None
    context = machine.GetMyContextFromRoot(run.final)
    records = machine.transitions(context)
    time = np.array([one.time for one in records])
    rows = np.searchsorted(run.time, time, side="right") - 1
    return ChargingRun(
        traces=traces_of(scenario, run),
        transitions={
            "time": time,
            "source": np.array([one.source for one in records]),
            "target": np.array([one.target for one in records]),
            "label": np.array([one.label for one in records]),
            "item": run.outputs["item"][rows],
        },
        reason=machine.reason(context),
    )


def traces_of(scenario: ResolvedCrucibleChargingScenario, run: Run) -> dict[str, Array]:
    """Return the outputs of a run of the loop with a resolved scenario as columns.

    One row a period: ``time`` s; ``state``, index in the chart, ``mode`` of the hybrid
    controller, ``item``, ``grip``, ``held``, ``scene``, ``finished``; the endpoint's coordinates
    and ``desired_`` ones, m and rad; ``nugget_x``, ``_y``, ``_z``, the grip point with what the
    gripper gives, m; ``measured_force_x``, ... and ``desired_force_x``, ... N, of the item on its
    environment; ``feeder_``, ``wall_`` and ``layer_`` ``force`` N, ``gap`` m, ``peak_force`` N
    and ``impact_speed`` m/s, 0 and far where the scene lacks them; ``normal_x``, ... below, the
    believed one, with an observer its ``normal_deviation`` rad, and
    ``true_normal_x``, ...; ``layer_shift`` m; joint positions, velocities and torques.
    """
    arm, outputs = scenario.ARM, run.outputs
    n = arm.num_joints
    q, v = outputs["encoders"][:, :n], outputs["encoders"][:, n:]
    endpoint = np.array([arm.endpoint(one) for one in q])
    traces = {"time": run.time}
    for name in ("state", "mode", "item", "grip", "held", "scene", "finished"):
        traces[name] = outputs[name]
    for i, name in enumerate(arm.coordinates):
        traces[name] = endpoint[:, i]
        traces[f"desired_{name}"] = outputs["desired_position"][:, i]
    grip = _grip_point(scenario, outputs, q)
    for i, axis in enumerate("xyz"):
        traces[f"nugget_{axis}"] = grip[:, i]
        for name in ("measured_force", "desired_force"):
            traces[f"{name}_{axis}"] = outputs[name][:, i]
    traces |= _contacts(scenario, outputs)
    traces |= _normals(scenario, outputs)
    traces["layer_shift"] = np.linalg.norm(outputs["layer_shift"], axis=1)
    for i, name in enumerate(arm.joint_names):
        traces[f"{name}.position"] = q[:, i]
        traces[f"{name}.velocity"] = v[:, i]
        traces[f"{name}.torque"] = outputs["torque"][:, i]
    return traces


def _contacts(
    scenario: ResolvedCrucibleChargingScenario, outputs: dict[str, Array]
) -> dict[str, Array]:
    """Return the contacts at feeder, wall and layer."""
    item = outputs["item"].astype(int)
    carries = outputs["scene"].astype(int) % 2 == 1
    azimuth = np.array([one.azimuth for one in scenario.plan])[item]
    outwards = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(len(item))], axis=1)
    force, contact = outputs["contact_force"], outputs["contact"]
    size = len(CONTACT_SIGNALS)
    found = {}
    for name, point, there, into in (
        ("feeder", 0, ~carries, np.array([0.0, 0.0, -1.0])),
        ("wall", 0, carries, outwards),
        ("layer", 1, carries, np.array([0.0, 0.0, -1.0])),
    ):
        push = -np.sum(force[:, 3 * point : 3 * point + 3] * into, axis=1)
        found[f"{name}_force"] = np.where(there, push, 0.0)
        for i, signal in enumerate(CONTACT_SIGNALS):
            if signal in _TOLD:
                value = contact[:, size * point + i]
                found[f"{name}_{signal}"] = np.where(there, value, _FAR * (signal == "gap"))
    return found


def _normals(
    scenario: ResolvedCrucibleChargingScenario, outputs: dict[str, Array]
) -> dict[str, Array]:
    """Return the normal below: the believed one, and the true one where it is touched."""
    surfaces = [scene.points[-1].surface for scene in make_scenes(scenario)]
    size = len(CONTACT_SIGNALS)
    gap, place = (outputs[name][:, size * _LAYER :] for name in ("contact", "tip"))
    true = np.tile([0.0, 0.0, 1.0], (len(gap), 1))
    for row in np.flatnonzero((outputs["scene"] % 2 == 1) & (gap[:, 0] < _MET)):
        surface = surfaces[int(outputs["scene"][row])]
        true[row] = locate(surface, place[row, :3]).normal
    found = {f"normal_{axis}": -outputs["below"][:, i] for i, axis in enumerate("xyz")}
    found |= {f"true_normal_{axis}": true[:, i] for i, axis in enumerate("xyz")}
    if "layer_deviation" in outputs:
        found["normal_deviation"] = outputs["layer_deviation"].ravel()
    return found


def _grip_point(
    scenario: ResolvedCrucibleChargingScenario, outputs: dict[str, Array], q: Array
) -> Array:
    """Return the middle of the item's top, or between the fingers, m, shape (k, 3).

    That is the first contact point less its offset, which hangs on the gripper as the item does.
    """
    dynamics, scenes = scenario.dynamics(), make_scenes(scenario)
    offsets = np.array([scene.points[0].offset for scene in scenes])[outputs["scene"].astype(int)]
    turned = [dynamics.orientation(one) @ offset for one, offset in zip(q, offsets, strict=True)]
    grip: Array = outputs["tip"][:, :3] - np.array(turned)
    return grip


Mask = NDArray[np.bool_]
Worst = Callable[[Sequence[float]], float]

SCAN_SPEED: Final = 0.03  # m/s, section 1.1.2
# States on the wall, moving along it but for the first.
SLIDING: Final = ("wall.press", "wall.slide", "wall.land", "wall.lost", "wall.follow")
_LAID: Final[dict[str, tuple[str, Worst]]] = {
    "layer_shift": ("m", max),
    "peak_force": ("N", max),
    "impact_speed": ("m/s", max),
    "normal_error": ("rad", max),  # of what lies below, as it is taken to be in the end
    "position_error": ("m", max),
    "gripper_clearance": ("m", min),
}
# By name, the unit and what is the worst of several items.
LIMITS: Final[dict[str, tuple[str, Worst]]] = {
    "acquire.descent_speed": ("m/s", max),
    "acquire.grip_force": ("N", max),
    "acquire.lift_speed": ("m/s", max),
    "scan.speed_error": ("m/s", max),
    "scan.position_error": ("m", max),
    "slew.time": ("s", max),
    "slew.position_error": ("m", max),
    "slew.clearance": ("m", min),
    "wall.approach_speed": ("m/s", max),
    "wall.slide_force": ("N", max),
    "wall.slide_force_min": ("N", min),
    "wall.losses": ("", max),  # of true contact
    "wall.losses_seen": ("", max),  # that the chart took for one, rightly or not
    **{f"{kind}.{name}": limit for kind in ("wall", "crown") for name, limit in _LAID.items()},
    "bulk.position_error": ("m", max),
}


def limits_in(plan: Sequence[PlanItem]) -> dict[str, tuple[str, Worst]]:
    """Return :data:`LIMITS` of the modes that a plan has; bulk is not scanned."""
    kinds = {item.kind for item in plan}
    absent = {"wall", "crown", "bulk", *({"scan"} if kinds == {"bulk"} else ())} - kinds
    return {name: one for name, one in LIMITS.items() if name.partition(".")[0] not in absent}


class Item(NamedTuple):
    """A true item of the plan, and its desired place."""

    kind: str
    nugget: Nugget
    goal: tuple[float, float, float]  # m, of the middle of its top at rest
    azimuth: float  # rad
    laid: tuple[LaidNugget, ...] = ()  # nuggets in the crucible by then


def items_of(scenario: ResolvedCrucibleChargingScenario) -> tuple[Item, ...]:
    """Return a resolved scenario's true items."""
    goals = scenario.places(believed=False)
    return tuple(
        Item(
            planned.kind,
            nugget,
            (*goal.position, goal.layer + nugget.height),
            goal.azimuth,
            goal.laid,
        )
        for planned, nugget, goal in zip(scenario.plan, scenario.nuggets, goals, strict=True)
    )


def item_limits(
    traces: Table, names: Sequence[str], item: Item, index: int, station: Station
) -> dict[str, float]:
    """Measure one item's cycle; measurements that its run did not reach are missing.

    ``names`` are those of the chart's states by their index in the traces; item and station are
    the true ones.
    """
    mine = traces["item"] == index
    current = np.where(mine, np.array(names)[traces["state"].astype(int)], "")
    time = traces["time"]
    nugget = in_space(traces, "nugget")
    velocity = np.gradient(nugget, time, axis=0)
    off = np.linalg.norm(nugget - in_space(traces, "desired"), axis=1)
    found: dict[str, float] = {}

    def during(*states: str) -> Mask:
        return np.isin(current, states)

    def most(name: str, values: Array, mask: Mask) -> None:
        if mask.any():
            found[name] = float(values[mask].max())

    gripping = during("acquire.descend", "acquire.touch", "acquire.grip")
    most("acquire.descent_speed", -velocity[:, 2], during("acquire.descend"))
    if during("acquire.grip").any():
        most("acquire.grip_force", traces["feeder_peak_force"], gripping)
    most("acquire.lift_speed", velocity[:, 2], during("acquire.lift"))
    passing = during("scan.pass") & (
        np.abs(nugget[:, 1] - station.scanner[1]) < station.scan_length / 2
    )
    most("scan.position_error", off, passing)
    most("scan.speed_error", np.abs(np.linalg.norm(velocity, axis=1) - SCAN_SPEED), passing)
    slewing = during("slew.over")
    if slewing.any():
        found["slew.time"] = float(np.ptp(time[slewing]))
        outline = nugget_points(item.nugget, nugget[slewing], traces["yaw"][slewing])
        lowest = nugget[slewing] - (0.0, 0.0, item.nugget.height)
        found["slew.clearance"] = min(
            clearance(outline, station),
            *(
                locate(one, point).gap
                for one in (laid.surface(item.nugget) for laid in item.laid)
                for point in lowest
            ),
            math.inf,
        )
    most("slew.position_error", off, slewing)
    laying = np.char.startswith(current.astype(str), f"{item.kind}.") | during("release.open")
    set_down = during(f"{item.kind}.set_down", "bulk.pour")
    if item.kind == "wall":
        outwards = velocity[:, 0] * np.cos(item.azimuth) + velocity[:, 1] * np.sin(item.azimuth)
        most("wall.approach_speed", outwards, during("wall.approach", "wall.seek"))
        sliding = during(*SLIDING)
        most("wall.slide_force", traces["wall_peak_force"], sliding)
        if sliding.any():
            found["wall.slide_force_min"] = float(traces["wall_force"][sliding].min())
        # Between press and set-down, where it moves along the wall.
        along = during(*SLIDING[1:])
        if along.any():
            found["wall.losses"] = _begins(along & ~(traces["wall_force"] > 0))
            found["wall.losses_seen"] = _begins(during("wall.lost"))
    if item.kind in ("wall", "crown"):
        most(f"{item.kind}.layer_shift", traces["layer_shift"], laying)
        peaks = np.maximum(traces["wall_peak_force"], traces["layer_peak_force"])
        most(f"{item.kind}.peak_force", peaks, laying)
        impacts = np.maximum(traces["wall_impact_speed"], traces["layer_impact_speed"])
        most(f"{item.kind}.impact_speed", impacts, laying)
        if laying.any():
            leaving = laying | during("retreat.up")
            endpoint = [traces[name][leaving] for name in ADEPT_WRIST.coordinates]
            gripper = gripper_points(np.stack(endpoint, axis=1))
            found[f"{item.kind}.gripper_clearance"] = clearance(gripper, station)
    if item.kind != "bulk" and set_down.any():
        last = np.flatnonzero(set_down)[-1]
        wall = np.array([np.cos(item.azimuth), np.sin(item.azimuth), 0.0])
        into_wall = np.outer(wall, wall) if item.kind == "wall" else np.zeros((3, 3))
        # At the wall in its tangent plane; across it the wall is known.
        taken, true = (
            unit(one - into_wall @ one)
            for one in (in_space(traces, name)[last] for name in ("normal", "true_normal"))
        )
        found[f"{item.kind}.normal_error"] = math.acos(min(float(taken @ true), 1.0))
    if set_down.any():
        last = np.flatnonzero(set_down)[-1]
        # The bulk filler pours from where it is told to, the others are laid on what is below.
        height = traces["desired_z"][last] if item.kind == "bulk" else item.goal[2]
        goal = np.array([*item.goal[:2], height])
        found[f"{item.kind}.position_error"] = float(np.linalg.norm(nugget[last] - goal))
    return found


def nugget_points(nugget: Nugget, grip: Array, yaw: Array) -> Array:
    """Return points all over a nugget in the world, m, shape (k, 26, 3).

    ``grip``, m, shape (k, 3), is the middle of its top; ``yaw``, rad, has the shape (k,).
    """
    directions = np.array(list(itertools.product((-1.0, 0.0, 1.0), repeat=3)))
    directions = np.delete(directions, 13, axis=0)  # the centre
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    points = directions * nugget.semi_axes + nugget.centre
    c, s = np.cos(yaw)[:, np.newaxis], np.sin(yaw)[:, np.newaxis]
    x = grip[:, :1] + c * points[:, 0] - s * points[:, 1]
    y = grip[:, 1:2] + s * points[:, 0] + c * points[:, 1]
    return np.stack([x, y, grip[:, 2:] + points[:, 2]], axis=2)


def clearance(points: Array, station: Station) -> float:
    """Return the least way from points, m, shape (..., 3), to the crucible's wall, m.

    It is negative in the material.
    """
    x, y = station.crucible_centre
    radius = np.hypot(points[..., 0] - x, points[..., 1] - y)
    over = points[..., 2] - station.rim_height
    inner = station.crucible_radius
    beside = np.maximum(inner - radius, radius - inner - station.crucible_thickness)
    apart = np.hypot(np.maximum(over, 0.0), np.maximum(beside, 0.0))
    return float(np.where(apart > 0, apart, np.maximum(over, beside)).min())


def _begins(mask: Mask) -> float:
    """Return how often a condition becomes true."""
    return float(np.sum(np.diff(mask.astype(int)) == 1))


def in_space(traces: Table, name: str) -> Array:
    """Return a place, such as ``nugget`` or ``desired``, at each row, m, shape (k, 3)."""
    return np.stack([traces[f"{name}_{axis}"] for axis in "xyz"], axis=1)
