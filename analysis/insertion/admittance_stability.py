"""How much damping a position-controlled arm needs in contact: computed, simulated, by theory."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import LinearBushingRollPitchYaw
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import (
    ConstantVectorSource,
    DiscreteTimeDelay,
    LinearSystem,
    LogVectorOutput,
    MatrixGain,
    Multiplexer,
)

from chamfer.analysis.drawing.figure_style import (
    FORCE,
    FSM,
    PUBLISHED,
    dress,
    legend,
    new_figure,
)
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress, column
from chamfer.diagrams.contact.hybrid_loop_stability import Stability
from chamfer.diagrams.insertion.contact_loop import ContactLoop, axes_of, least_factor
from chamfer.models.arms.position_arm import ServoParams
from chamfer.models.arms.wrist import SIZE, WristParams, add_wrist, in_joint_order
from chamfer.models.validation import ParameterError, require_one_of, require_positive
from chamfer.systems.force.accommodation_law import AXES, DAMPING
from chamfer.systems.force.admittance_law import AdmittanceLaw
from chamfer.systems.force.contact_admittance import ContactAdmittanceParams
from chamfer.systems.force.contact_detection_law import CONTACT
from chamfer.systems.force.sampled_loop import NEUTRAL
from chamfer.systems.law import Signal
from chamfer.systems.law_block import LawBlock
from chamfer.systems.recording import recording
from chamfer.systems.sensing.force_sensor import ChannelParams, ForceSensor, Gauges

Array = NDArray[np.float64]

_PUSHED: Final = 1e-6  # m or rad, by which the flange is off at first
_ROUGH: Final = 0.4  # of the fastest motion's reciprocal, the integrator's step at most
_FAR: Final = (0.5, 2.0)  # times the computed border, tried as well
_NEAR: Final = (1.3, 1 / 1.3)  # times it, between which the simulated one is sought
_WIDE: Final = (1e3, 1e-3)  # times the given damping, between which the computed one is sought
# The wrist's axes in the hole's: its z points away from the hole, against x.
_TURN: Final = np.kron(np.eye(2), [[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


@dataclass(frozen=True, kw_only=True)
class ContactStabilityScenario:
    """A loop, one of its axes, and contacts of which each has its border of the damping."""

    loop: ContactLoop = ContactLoop(
        servo=ServoParams(),
        admittance=ContactAdmittanceParams(),
        wrist=WristParams(
            stiffness=(2e3, 2e3, 2e3, 3e5, 3e5, 1e6),
            damping_ratio=0.3,
            mass=1.0,
            inertia=4e-3,
            centre_of_mass=0.03,
        ),
        contact=(200.0, 200.0, 200.0, 1e6, 1e6, 1e6),
        bandwidth=100.0,
    )  # assumed
    axis: str = "x"  # whose damping is looked at
    shares: tuple[float, ...] = (0.003, 0.01, 0.03, 0.1, 0.3, 1.0)  # of the contact's stiffness
    duration: float = 0.6  # s, of each simulation
    step: float = 5e-4  # s, of the force sensor
    halvings: int = 4  # of the simulated border

    def __post_init__(self) -> None:
        require_positive(self, "duration", "step")
        require_one_of(self, "axis", AXES)
        if not (self.shares and all(0 < share < math.inf for share in self.shares)):
            raise ParameterError("shares", self.shares, "finite numbers > 0")
        if self.halvings not in range(1, 21):
            raise ParameterError("halvings", self.halvings, "a whole number, 1 to 20")


CONTACT_STABILITY: Final = ContactStabilityScenario()


def damped(loop: ContactLoop, axis: int, factor: float) -> ContactLoop:
    """Return a loop with the damping of one of its six axes times a factor."""
    damping = tuple(D * factor if i == axis else D for i, D in enumerate(loop.damping))
    return replace(loop, admittance=replace(loop.admittance, damping=damping))


def delayed_border(k: float, delay: float, mass: float = 0.0, spring: float = 0.0) -> float:
    """Return the least D with which ``M x''(t) + D x'(t) + K x(t) = -k x(t - tau)`` is stable.

    The first w with ``k cos(w tau) + K = M w^2`` has it: ``D = k sin(w tau) / w``. Without M and
    K that is ``2 k tau / pi``. Source: N. D. Hayes, Roots of the transcendental equation
    associated with a certain difference-differential equation, J. London Math. Soc. s1-25 (1950).
    """
    if spring >= k:
        return 0.0
    low, high = 0.0, math.pi / delay
    for _ in range(60):
        w = (low + high) / 2
        low, high = (w, high) if k * math.cos(w * delay) + spring > mass * w * w else (low, w)
    return k * math.sin(low * delay) / low


def computed_border(loop: ContactLoop, axis: int) -> float:
    """Return the factor on one axis' damping from which on it is stable in contact."""

    def stable(factor: float) -> bool:
        loops = damped(loop, axis, factor).loops()
        touching = [one for one in loops if one.mode == CONTACT and AXES[axis] in axes_of(one)]
        return all(one.growth_rate() <= NEUTRAL for one in touching)

    return least_factor(stable, *_WIDE, 10)


def make_contact_diagram(loop: ContactLoop, step: float) -> Diagram:
    """Return the loop of real blocks and bodies, with nothing of the linear model.

    Drake's bodies on the wrist's springs and, as the contact, a bushing. ``log`` keeps the wrench
    as it is read, N m above N, shape (6,), in the hole's axes. The sensor's step is in s.
    """
    builder, wrist, period = DiagramBuilder(), loop.wrist, loop.servo.period
    add, wire = builder.AddNamedSystem, builder.Connect
    plant = add("tool", MultibodyPlant(0.0))
    held = add_wrist(plant, plant.world_frame(), wrist)
    k, no, tip = np.abs(_TURN.T @ loop.contact), np.zeros(3), held.body.body_frame()
    touching = LinearBushingRollPitchYaw(plant.world_frame(), tip, k[:3], no, k[3:], no)
    plant.AddForceElement(touching)
    plant.Finalize()
    # The motion of the wrist's joints of the tip's in the hole's axes.
    centre = np.eye(SIZE)
    centre[3:5, :2] = [[0.0, wrist.centre], [-wrist.centre, 0.0]]
    centre = in_joint_order() @ centre @ _TURN.T
    law = wrist.law @ np.kron(np.eye(2), centre)
    springs = add("springs", MatrixGain(np.hstack([law, -wrist.law])))
    both = add("flange and tool", Multiplexer([2 * SIZE, 2 * SIZE]))
    felt = add("wrench about the tip", MatrixGain(-centre.T))
    one, w = np.eye(SIZE), loop.servo.frequency
    follow = np.kron([[0.0, 1.0], [-w * w, -2 * w]], one), np.kron([[0.0], [w * w]], one)
    servo = add("servo", LinearSystem(*follow, np.eye(2 * SIZE), np.zeros((2 * SIZE, SIZE))))
    names = ("noise", "bias", "drift", "resolution", "full_scale", "tare")
    params = ChannelParams(
        **dict.fromkeys(names, 0.0),
        bandwidth=loop.bandwidth,
        delay=loop.delay,
    )
    read = ForceSensor(params, Gauges(-one, np.ones(SIZE)), step=step, period=period)
    sensor, gives_way = add("sensor", read), AdmittanceLaw(loop.law(loop.damping))
    gives_way.outputs = {"displacement": Signal(SIZE)}
    admittance = add("admittance", LawBlock(gives_way))
    command = add("command", ConstantVectorSource(np.zeros(SIZE)))
    late = add("delay", DiscreteTimeDelay(period, loop.servo.delay, SIZE))
    wire(command.get_output_port(), admittance.GetInputPort("command"))
    wire(admittance.GetOutputPort("displacement"), late.get_input_port())
    wire(late.get_output_port(), servo.get_input_port())
    wire(servo.get_output_port(), both.get_input_port(0))
    wire(plant.get_state_output_port(held.instance), both.get_input_port(1))
    wire(both.get_output_port(), springs.get_input_port())
    wire(springs.get_output_port(), plant.get_actuation_input_port(held.instance))
    wire(springs.get_output_port(), felt.get_input_port())
    wire(felt.get_output_port(), sensor.GetInputPort("tool_force"))
    wire(sensor.GetOutputPort("reading"), admittance.GetInputPort("wrench"))
    LogVectorOutput(sensor.GetOutputPort("reading"), builder, period).set_name("log")
    return builder.Build()


@recording(None)
def grows(loop: ContactLoop, axis: int, *, duration: float, step: float) -> bool:
    """Return whether the load that is read grows in a simulation, in the last quarter of it.

    The flange is off by a little at first. Duration and the sensor's step are in s.
    """
    diagram = make_contact_diagram(loop, step)
    simulator, stiffest = Simulator(diagram), max(loop.contact) + max(loop.wrist.stiffness)
    config = SimulatorConfig(
        integration_scheme="runge_kutta3",
        max_step_size=min(step, _ROUGH * math.sqrt(loop.wrist.mass / stiffest)),
        use_error_control=False,
    )
    ApplySimulatorConfig(config, simulator)
    context = simulator.get_mutable_context()
    servo = diagram.GetSubsystemByName("servo").GetMyMutableContextFromRoot(context)
    servo.SetContinuousState(_PUSHED * np.eye(2 * SIZE)[axis])
    simulator.AdvanceTo(duration)
    force = np.abs(diagram.GetSubsystemByName("log").FindLog(context).data()[axis])
    quarter = len(force) // 4
    return bool(force[-quarter:].max() > force[-2 * quarter : -quarter].max())


def run(scenario: ContactStabilityScenario, seed: int, progress: Progress) -> Outcome:
    """Return the border of the damping over the contact's stiffness, three ways.

    Traces: ``stiffness`` of springs and contact in series, N/m or N m/rad; ``designed``,
    ``border`` computed, ``simulated`` and ``delayed``, N s/m or N m s/rad. Table ``tried``:
    ``stiffness``, ``damping``, and whether it ``grew``.
    """
    axis, given = AXES.index(scenario.axis), scenario.loop.admittance
    rows, tried = [], list[tuple[float, float, bool]]()
    for i, share in enumerate(scenario.shares):
        progress(i / len(scenario.shares), f"contact times {share:g}")
        contact = tuple(share * stiffness for stiffness in scenario.loop.contact)
        loop = replace(scenario.loop, contact=contact)
        k, D = loop.stiffness[axis], loop.damping[axis]
        edge = damped(loop, axis, computed_border(loop, axis))

        def calm(factor: float, k: float = k, edge: ContactLoop = edge) -> bool:
            at = damped(edge, axis, factor)
            grew = grows(at, axis, duration=scenario.duration, step=scenario.step)
            tried.append((k, at.damping[axis], grew))
            return not grew

        for far in _FAR:
            calm(far)
        seen = edge.damping[axis] * least_factor(calm, *_NEAR, scenario.halvings)
        delayed = delayed_border(k, loop.lag, given.inertia[axis], given.spring[axis])
        rows.append((k, D, edge.damping[axis], seen, delayed))
    names = ("stiffness", "designed", "border", "simulated", "delayed")
    traces = {name: column(values) for name, values in zip(names, np.transpose(rows), strict=True)}
    apart = 100 * float(np.abs(traces["simulated"] / traces["border"] - 1).max())
    metrics = {
        "border.difference": Metric(value=apart, unit="%", note="of the simulated, at most"),
        "border.damping": Metric(value=float(traces["border"][-1]), unit=DAMPING[axis]),
        "designed.damping": Metric(value=float(traces["designed"][-1]), unit=DAMPING[axis]),
        **loop_metrics(scenario.loop.stability()),
    }
    columns = zip(("stiffness", "damping", "grew"), np.transpose(tried), strict=True)
    tables = {"tried": {name: column(values) for name, values in columns}}
    seconds = scenario.duration * len(tried)
    return Outcome(metrics=metrics, traces=traces, simulated_seconds=seconds, tables=tables)


def loop_metrics(found: Stability) -> dict[str, Metric]:
    """Return growth and margins of a loop of contact, the least of its axes."""
    gain, delay = (
        found.least_gain or "none up to 1000",
        found.least_delay or "none up to 10 periods",
    )
    return {
        "loop.growth_contact": Metric(value=found.growth_contact, unit="1/s"),
        "loop.gain_margin": Metric(value=found.gain_margin, unit="", note=gain),
        "loop.delay_margin": Metric(value=found.delay_margin, unit="s", note=delay),
    }


def figures(scenario: ContactStabilityScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    figure = new_figure(7.0, 4.8)
    axes, traces, tried = figure.subplots(), outcome.traces, outcome.tables["tried"]
    k, axis = traces["stiffness"], AXES.index(scenario.axis)
    axes.loglog(k, traces["designed"], label="designed: does not ring", **FSM)
    axes.loglog(k, traces["border"], label="border, computed", **FORCE)
    axes.loglog(k, traces["delayed"], label="border of as long a pure delay (Hayes)", **PUBLISHED)
    for grew, label, mark in ((0, "simulated: calm", "o"), (1, "simulated: grows", "x")):
        at = tried["stiffness"][tried["grew"] == grew], tried["damping"][tried["grew"] == grew]
        axes.plot(*at, mark, label=label, color="black", mfc="none", ms=5)
    unit = "N m/rad" if axis < 3 else "N/m"
    dress(
        axes,
        title=f"Damping that contact asks for, {scenario.axis}",
        x=f"stiffness of springs and contact in series / ({unit})",
        y=f"damping / ({DAMPING[axis]})",
    )
    legend(axes, loc="upper left")
    return {"contact-stability": figure}
