"""Runs of the loop that charges a crucible."""

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.analysis.linear.simulate import Run, simulate
from chamfer.analysis.scenario.experiment import Progress
from chamfer.diagrams.charging.charging_loop import make_charging_diagram
from chamfer.diagrams.charging.charging_scenario import CrucibleChargingScenario
from chamfer.diagrams.charging.charging_scenes import make_scenes
from chamfer.models.validation import known
from chamfer.systems.charging.charging_machine import ChargingMachine
from chamfer.systems.contact.arm_motion import CONTACT_SIGNALS

Array = NDArray[np.float64]

_TOLD: Final = ("gap", "peak_force", "impact_speed")
_FAR: Final = 1.0  # m, gap to what is not there


class ChargingRun(NamedTuple):
    """What a run did."""

    traces: dict[str, Array]
    transitions: dict[str, NDArray[Any]]  # time s, source, target, label, item; one row each
    reason: str  # why it stopped, "" if it finished


def run_charging(
    scenario: CrucibleChargingScenario, seed: int, progress: Progress | None = None
) -> ChargingRun:
    """Simulate a resolved scenario until the plan is laid or the cycle has stopped.

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
        duration=known("duration", scenario.duration),
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


def traces_of(scenario: CrucibleChargingScenario, run: Run) -> dict[str, Array]:
    """Return what a run of the loop with a resolved scenario put out as columns.

    One row a period: ``time`` s; ``state``, index in the chart, ``mode`` of the hybrid
    controller, ``item``, ``grip``, ``held``, ``scene``, ``finished``; the endpoint's coordinates
    and ``desired_`` ones, m and rad; ``nugget_x``, ``_y``, ``_z``, the grip point with what the
    gripper gives, m; ``measured_force_x``, ... and ``desired_force_x``, ... N, of the item on its
    environment; ``feeder_``, ``wall_`` and ``layer_`` ``force`` N, ``gap`` m, ``peak_force`` N
    and ``impact_speed`` m/s, 0 and far where the scene lacks them; ``layer_shift`` m; joint
    positions, velocities and torques.
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
    traces["layer_shift"] = np.linalg.norm(outputs["layer_shift"], axis=1)
    for i, name in enumerate(arm.joint_names):
        traces[f"{name}.position"] = q[:, i]
        traces[f"{name}.velocity"] = v[:, i]
        traces[f"{name}.torque"] = outputs["torque"][:, i]
    return traces


def _contacts(scenario: CrucibleChargingScenario, outputs: dict[str, Array]) -> dict[str, Array]:
    """Return what happens at feeder, wall and layer."""
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


def _grip_point(scenario: CrucibleChargingScenario, outputs: dict[str, Array], q: Array) -> Array:
    """Return the middle of the item's top, or between the fingers, m, shape (k, 3).

    That is the first contact point less its offset, which hangs on the gripper as the item does.
    """
    dynamics, scenes = scenario.dynamics(), make_scenes(scenario)
    offsets = np.array([scene.points[0].offset for scene in scenes])[outputs["scene"].astype(int)]
    turned = [dynamics.orientation(one) @ offset for one, offset in zip(q, offsets, strict=True)]
    grip: Array = outputs["tip"][:, :3] - np.array(turned)
    return grip
