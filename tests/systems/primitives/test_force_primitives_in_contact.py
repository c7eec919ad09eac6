"""Force primitives on a spring under damping control: a maintained velocity v is the force D v."""

import math
from typing import Any, Final, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Integrator, LogVectorOutput

from chamfer.systems.contact.spring_constraint import SpringConstraint, SpringConstraintParams
from chamfer.systems.force.accommodation import AccommodationController, AccommodationParams
from chamfer.systems.primitives.force_primitives import (
    AXIS_NAMES,
    GuardedMove,
    Obstructed,
    Stick,
)
from chamfer.systems.primitives.position_primitives import Centre
from chamfer.systems.primitives.primitive import Primitive
from chamfer.systems.primitives.skill import DONE, Skill, SkillState
from chamfer.systems.primitives.skill_machine import SkillMachine, SkillMemory
from chamfer.systems.primitives.trajectory_primitives import Dither, MoveDx
from chamfer.systems.statechart.chart import Snapshot

PERIOD: Final = 0.01  # s
SAMPLES: Final = 100  # of a cycle
DAMPING: Final = 800.0  # N s/m
STIFFNESS: Final = 2e4  # N/m


class Run(NamedTuple):
    state: Snapshot[SkillMemory]
    carriage: NDArray[np.float64]  # rad above m, shape (6, n), at the ticks
    motion: NDArray[np.float64]  # V_ref likewise
    wrench: NDArray[np.float64]  # N m above N
    ended: float | None  # s

    @property
    def how(self) -> str:
        """Event of the primitive that ended the run, or nothing."""
        return self.state.memory.reason.partition(": ")[2]


def run(
    *primitives: Primitive,
    duration: float,
    begin: float = 0.0,
    sides: Any = "one",
    axis: Any = "x",
    stiffness: float = STIFFNESS,
) -> Run:
    """Run primitives under damping control beside a spring, the contact on one side by default."""
    builder = DiagramBuilder()
    ends = any(one.events.get("done", math.inf) < 1e3 for one in primitives)
    answers: dict[Any, str] = {"done" if ends else "timed out": DONE}
    skill = Skill(
        name="one",
        states=[SkillState(name="one", run=primitives, on=answers, timeout=1e3)],
        retract=[MoveDx()],
    )
    machine = builder.AddSystem(SkillMachine(skill, parts=1, period=PERIOD))
    accommodation = builder.AddSystem(
        AccommodationController(
            AccommodationParams(damping=(2.0, 2.0, 2.0, DAMPING, DAMPING, DAMPING), period=PERIOD)
        )
    )
    carriage = builder.AddSystem(Integrator(6))
    spring = builder.AddSystem(
        SpringConstraint(
            SpringConstraintParams(
                index=AXIS_NAMES.index(axis), sides=sides, stiffness=stiffness, stop_at=begin
            )
        )
    )
    connect = builder.Connect
    connect(machine.GetOutputPort("velocity"), accommodation.GetInputPort("command"))
    connect(accommodation.GetOutputPort("velocity"), carriage.get_input_port())
    connect(carriage.get_output_port(), spring.get_input_port())
    connect(spring.get_output_port(), accommodation.GetInputPort("wrench"))
    connect(carriage.get_output_port(), machine.GetInputPort("carriage"))
    connect(spring.get_output_port(), machine.GetInputPort("wrench"))
    connect(accommodation.GetOutputPort("velocity"), machine.GetInputPort("motion"))
    connect(accommodation.GetOutputPort("perturbed"), machine.GetInputPort("perturbed"))
    ports = carriage.get_output_port(), machine.GetInputPort("motion"), spring.get_output_port()
    logs = [
        LogVectorOutput(
            accommodation.GetOutputPort("velocity") if i == 1 else port, builder, PERIOD
        )
        for i, port in enumerate(ports)
    ]
    diagram = builder.Build()
    simulator = Simulator(diagram)
    simulator.AdvanceTo(duration)
    context = machine.GetMyContextFromRoot(simulator.get_context())
    taken = machine.transitions(context)
    return Run(
        machine.snapshot(context),
        *(log.FindLog(simulator.get_context()).data().copy() for log in logs),
        taken[0].time if taken else None,
    )


@pytest.mark.parametrize("begin", [0.005, 0.0123])
@pytest.mark.parametrize("speed", [0.01, 0.02])
def test_a_guarded_move_makes_contact_within_a_ticks_travel(begin: float, speed: float) -> None:
    move = GuardedMove(direction="+x", speed=speed, threshold=4.0)
    found = run(move, duration=3.0, begin=begin)
    assert found.how == "contact"
    felt = begin + 4.0 / STIFFNESS
    # Without command accommodation gives way until the force is gone.
    assert found.carriage[3, -1] == pytest.approx(begin, abs=1e-6)
    # Two more ticks, until it knows and until accommodation has the command.
    assert found.carriage[3].max() < felt + 3 * speed * PERIOD


@pytest.mark.parametrize("speed", [0.002, 0.005])
def test_a_stuck_tool_stalls_at_the_damping_times_the_speed(speed: float) -> None:
    found = run(Stick(direction="+x", speed=speed), duration=2.0)
    assert found.how == ""
    assert found.wrench[3, -1] == pytest.approx(-DAMPING * speed, rel=1e-6)
    assert found.motion[3, -1] == pytest.approx(0.0, abs=1e-9)
    assert found.carriage[3, -1] == pytest.approx(DAMPING * speed / STIFFNESS, rel=1e-6)


DITHER: Final = Dither(axis="x", amplitude=0.001, frequency=1.0, cycles=1e3)


@pytest.mark.parametrize(("stiffness", "event"), [(0.8, ""), (1.6, "hindered")])
def test_what_is_stiff_enough_follows_from_the_closed_form(stiffness: float, event: str) -> None:
    # (pi^2 / 8) / sqrt(1 + (k / (D w))^2) is 0.8 at k = 1.174 D w.
    k = stiffness * DAMPING * 2 * math.pi
    only_c = Obstructed(axes=("x",), samples=(SAMPLES,), amplitude_threshold=0.0)
    found = run(DITHER, only_c, duration=6.0, sides="both", stiffness=k)
    assert found.how == event


def test_under_damping_control_a_stop_on_one_side_is_seen_by_the_amplitude() -> None:
    def watched(*centre: Primitive, **thresholds: float) -> str:
        watch = Obstructed(axes=("x",), samples=(SAMPLES,), **thresholds)  # type: ignore[arg-type]
        return run(DITHER, *centre, watch, duration=6.0, sides="one").how

    centre = Centre(dither=DITHER, gain=5.0)
    assert watched(centre, amplitude_threshold=0.0) == ""
    assert watched(centre, amplitude_threshold=0.85, threshold=0.0) == "hindered"
    # Without centring the stop pushes the dither away within a cycle, and nothing hinders it.
    assert watched(amplitude_threshold=0.95) == ""
