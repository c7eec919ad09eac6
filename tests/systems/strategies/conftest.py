"""A strategy's chart, driven through its states by what could have been sensed there."""

import math
from collections.abc import Callable
from typing import Any, Final

import numpy as np
import pytest

from chamfer.models.cameras.camera import CameraPlacement, View
from chamfer.systems.primitives.force_primitives import GuardedMove, Level, Stick, along, velocity
from chamfer.systems.primitives.position_primitives import Held, Place, Way
from chamfer.systems.primitives.primitive import STILL, Observation, Vector
from chamfer.systems.primitives.seating import Seat
from chamfer.systems.primitives.skill import Outcome, Skill, SkillState
from chamfer.systems.primitives.skill_law import SkillMemory, make_skill_chart
from chamfer.systems.primitives.vision_primitives import VisTranslation
from chamfer.systems.primitives.visual_servoing import Servoing, StaticCameras
from chamfer.systems.statechart.chart import Snapshot, TransitionRecord
from chamfer.systems.strategies.grasp_and_transport import (
    PARTS,
    ResolvedGraspAndTransportParams,
    make_grasp_and_transport,
)
from chamfer.systems.vision.detections import Detection, Status, pack_detections

PERIOD: Final = 0.05  # s, of the ticks, for long searches
UNSEEN: Final = Detection(status=Status.NO_COLOUR)
VIEWS: Final[tuple[View, ...]] = ("xz", "yz")
CAMERAS: Final = StaticCameras(
    **{
        view: CameraPlacement(view=view, roll=math.pi / 2).camera.miscalibrated(
            focal_factor=1.1, turn=(0.05, -0.05, 0.05)
        )
        for view in VIEWS
    }
)


class Drive:
    """Makes the outcomes of a skill's states happen: every tick is sensed as they need it."""

    def __init__(self, skill: Skill) -> None:
        self.states = {state.name: state for state in skill.states}
        self.chart = make_skill_chart(skill)
        self.now: Snapshot[SkillMemory] = self.chart.start()
        self.time = 0.0
        self.carriage = np.zeros(6)
        self.records: list[TransitionRecord] = []
        self.path = [skill.states[0].name]
        self.velocities: list[Vector] = []  # of the state that it is in
        self.tick()

    @property
    def state(self) -> str:
        return self.now.state

    @property
    def memory(self) -> SkillMemory:
        return self.now.memory

    def tick(self, **sensed: Any) -> None:
        """Tick with nothing sensed but what is given; what was commanded moves freely."""
        command = self.memory.velocity
        free: dict[str, Any] = {
            "carriage": tuple(self.carriage.tolist()),
            "motion": command,
            "wrench": STILL,
            "perturbed": command,
        }
        self.now, record = self.chart.step(self.now, Observation(**{**free, **sensed}), self.time)
        self.time += PERIOD
        if record is not None:
            self.records.append(record)
            self.path.append(record.target)
            self.velocities = []
        self.velocities.append(self.memory.velocity)

    def make(self, outcome: Outcome) -> str:
        """Let the state end so, and return the state that follows."""
        state = self.states[self.state]
        shift, sensed = sensed_of(state, outcome, self)
        self.carriage += shift
        for _ in range(round(state.timeout / PERIOD) + 2):
            self.tick(**sensed)
            if self.state != state.name:
                raise AssertionError(f"{state.name} times out before it is {outcome}")
            if self.memory.event is not None:
                assert self.memory.event == outcome
                self.tick()
                assert self.state != state.name
                return self.state
        raise AssertionError(f"{state.name} is never {outcome}")

    def end(self) -> str:
        """Tick until a final state, and return it."""
        for _ in range(1000):
            if self.chart.state(self.state).outcome is not None:
                return self.state
            self.tick()
        raise AssertionError(f"stays in {self.state}")

    def way(self) -> np.ndarray:
        """Return the way that the state has commanded so far, rad above m."""
        return PERIOD * np.sum(self.velocities, axis=0)


def sensed_of(state: SkillState, outcome: Outcome, drive: Drive) -> tuple[Vector, dict[str, Any]]:
    """Return how the carriage is moved at first, and what is sensed, for an outcome."""
    kinds: dict[type, Any] = {type(one): one for one in reversed(state.run)}
    if VisTranslation in kinds:
        return STILL, seen(kinds[VisTranslation], outcome)
    if outcome == "hindered":
        return STILL, {"motion": STILL}
    if Held in kinds and outcome == "lost":
        return STILL, {"holding": (0.0,)}
    if Level in kinds:
        if outcome == "lost":
            return (0.11, 0.11, 0.0, 0.0, 0.0, 0.0), {}
        return STILL, {"wrench": (0.1, 0.1, 0, 0, 0, 0) if outcome == "timed out" else STILL}
    if GuardedMove in kinds:
        move = kinds[GuardedMove]
        if outcome == "lost":
            start: Any = drive.memory.memories[state.run.index(move)]
            way = start + 1.01 * move.limit - along(move.direction, tuple(drive.carriage))
            return velocity(move.direction, way), {}
        against = velocity(move.direction, -1.01 * move.threshold)
        return STILL, {"wrench": against if outcome == "contact" else STILL}
    for kind in (Place, Seat, Way, Stick):
        if kind in kinds:
            memory = drive.memory.memories[state.run.index(kinds[kind])]
            return moved(kinds[kind], outcome, memory, tuple(drive.carriage))
    return STILL, {}


def moved(
    primitive: Any, outcome: Outcome, memory: Any, carriage: Vector
) -> tuple[Vector, dict[str, Any]]:
    """Likewise, for a primitive that looks how far it is from where it began, or from the mark."""
    match primitive, outcome:
        case Place(), "done":
            return (0.0, 0.0, 0.0, *np.subtract(memory, carriage[3:]).tolist()), {}
        case Seat(), "done" | "jammed" | "tilted" | "timed out":
            way = (1.01 if outcome == "done" else 0.99) * primitive.distance
            shift = memory.start + way - along(primitive.direction, carriage)
            against = velocity(primitive.direction, -1.01 * primitive.limit)
            wrench = against if outcome in ("jammed", "tilted") else STILL
            turned = np.subtract(memory.turns, carriage[:2])  # back to where its way begins
            if outcome == "tilted":
                turned += 1.01 * np.array(primitive.tilt)
            return np.add(velocity(primitive.direction, shift), (*turned, 0, 0, 0, 0)), {
                "wrench": wrench
            }
        case Way(), "done" | "jammed":
            way = primitive.least + (1e-5 if outcome == "done" else -1e-5)
            start = along(primitive.direction, memory.start)
            shift = start + way - along(primitive.direction, carriage)
            turned = np.subtract(memory.start[:2], carriage[:2]) if primitive.tilt else (0.0, 0.0)
            return np.add(velocity(primitive.direction, shift), (*turned, 0, 0, 0, 0)), {}
        case Stick(), "lost":
            shift = memory + 1.01 * primitive.threshold - along(primitive.direction, carriage)
            return velocity(primitive.direction, shift), {}
    return STILL, {}


def seen(sight: VisTranslation, outcome: Outcome) -> dict[str, Any]:
    """Return what the cameras see of a part that is there, far away, or not to be seen."""
    found = {}
    for view in VIEWS:
        camera: Any = getattr(sight.cameras, view)
        there = np.array([140.0, 130.0])
        goal = camera.project(camera.point(there, sight.cameras.depth) + sight.offset)
        tips = {sight.target: there, sight.moved: goal + (0 if outcome == "done" else 20)}
        parts = [
            Detection(status=Status.VALID, tip=tuple(tips[part].tolist()))
            if part in tips and not (outcome == "lost" and part == sight.moved)
            else UNSEEN
            for part in range(PARTS)
        ]
        found[f"{view}_detections"] = tuple(pack_detections(*parts).tolist())
    return found


def grasp(then: str) -> tuple[SkillState, ...]:
    params = ResolvedGraspAndTransportParams(top=0.03, weight=0.0)
    return make_grasp_and_transport(params, CAMERAS, Servoing(), above=(0.0, 0.0, 5e-3), then=then)


@pytest.fixture(scope="session")
def grasp_states() -> Callable[[str], tuple[SkillState, ...]]:
    """Makes the states that grasp and transport, with cameras believed wrong."""
    return grasp


@pytest.fixture(scope="session")
def make_drive() -> type[Drive]:
    """The class, to be called with a skill."""
    return Drive
