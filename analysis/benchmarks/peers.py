"""The two loops in Chamfer and in other simulators: a function for each returns its engines.

What not every machine has is imported when the function is called.
"""

import io
from collections.abc import Callable, Iterable
from contextlib import redirect_stdout
from dataclasses import dataclass, replace
from importlib.util import find_spec
from typing import Any, Final

import control as ct
import numpy as np
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import Context, DiagramBuilder, System
from pydrake.systems.primitives import LogVectorOutput, VectorLogSink
from scipy.integrate import odeint, solve_ivp

from chamfer.analysis.benchmarks.engine import LoopCase, LoopEngine, LoopName, Samples
from chamfer.analysis.linear.simulate import simulate
from chamfer.diagrams.servo.compiled_loop import run_fsm_trials
from chamfer.diagrams.servo.servo_loops import make_pid_loop, make_servo_diagram
from chamfer.diagrams.servo.servo_scenario import fsm_axis
from chamfer.systems.exact_discretisation import fuse

COMPILED: Final = "Chamfer, compiled"
_TRIALS: Final = 1000
_RTOL: Final = 1e-6


def chamfer(case: LoopCase, loop: LoopName) -> list[LoopEngine]:
    """Return the project's own loops; they step at the output's times, where they are exact."""
    step = float(case.time(loop)[1])

    def build() -> System:
        if loop == "fsm":
            return make_servo_diagram(case.scenario, loops=[loop], step=step)
        return fuse(make_pid_loop(case.scenario, "velocity"))

    def run(system: System) -> Samples:
        outputs = simulate(system, duration=case.duration, step=step).outputs
        return outputs["fsm.actual_trajectory"] if loop == "fsm" else outputs["y0"][:, -1]

    how = "stepped by Drake" if loop == "fsm" else "fused by Drake, solved by matrix powers"
    note = f"exact steps of {1e3 * step:g} ms, {how}"
    return [LoopEngine(name="Chamfer", build=build, run=run, accuracy=1e-10, note=note)]


def compiled(case: LoopCase, loop: LoopName) -> list[LoopEngine]:
    """Return what a trial of a map or a sweep takes: FSM loops by the thousand, PID one by one."""
    scenario = case.scenario
    axis = fsm_axis(scenario, "position")
    # The first trial is the case, the others have other increments.
    axes = [
        replace(axis, increment=share * axis.increment)
        for share in np.geomspace(1.0, 10.0, _TRIALS).tolist()
    ]
    step = float(case.time("pid")[1])

    def run_pid(model: Any) -> Samples:
        output: Samples = simulate(model, duration=case.duration, step=step).outputs["y0"]
        return output[:, -1]

    def run_fsm(_model: None) -> Samples:
        first: Samples = run_fsm_trials(
            scenario, "position", duration=case.duration, step=case.period, axes=axes
        ).actual_trajectory[0]
        return first

    pid = LoopEngine(
        name=COMPILED,
        build=lambda: fuse(make_pid_loop(case.scenario, "velocity")),
        run=run_pid,
        accuracy=1e-10,
        note="fused, solved by matrix powers",
    )
    if loop == "pid":
        return [pid]
    note = f"a map of {_TRIALS} trials, times of one"
    return [replace(pid, build=lambda: None, run=run_fsm, note=note, trials=_TRIALS)]


def drake(case: LoopCase, loop: LoopName) -> list[LoopEngine]:
    """Return Drake as it comes: the same blocks, continuous in C++, with an integrator."""
    stiff = loop == "pid"
    Model = tuple[Simulator, Context, VectorLogSink]

    def build() -> Model:
        builder = DiagramBuilder()
        servo = builder.AddSystem(make_servo_diagram(case.scenario, loops=[loop]))
        output = servo.GetOutputPort(f"{loop}.actual_trajectory")
        logger = LogVectorOutput(output, builder, publish_period=float(case.time(loop)[1]))
        root = builder.Build()
        context = root.CreateDefaultContext()
        simulator = Simulator(root, context)
        if stiff:
            config = SimulatorConfig()
            config.integration_scheme = "radau3"
            config.accuracy = _RTOL
            config.use_error_control = True
            ApplySimulatorConfig(config, simulator)
        return simulator, context, logger

    def run(model: Model) -> Samples:
        simulator, context, logger = model
        simulator.Initialize()
        simulator.AdvanceTo(case.duration)
        output: Samples = logger.FindLog(context).data()[0].copy()
        return output

    radau = f"C++ blocks, radau3, accuracy {_RTOL:g}"
    return [
        LoopEngine(
            name="Drake as it comes",
            build=build,
            run=run,
            accuracy=1e-6 if stiff else 1e-5,
            note=radau if stiff else "C++ plant, default RK3, accuracy 1e-3",
        )
    ]


def scipy(case: LoopCase, loop: LoopName) -> list[LoopEngine]:
    """Return hand-written equations: LSODA by both interfaces, or the FSM's plant per tick."""
    m, b, k = case.mass_damping_stiffness
    p, i, d, n = case.gains
    tolerances: dict[str, Any] = {"rtol": _RTOL, "atol": 1e-8}
    time, rest = case.time(loop), [0.0, 0.0, 0.0, 0.0]

    def derivative(_time: float, state: Samples) -> list[float]:
        position, velocity, integral, filtered = state.tolist()
        error = case.amplitude - velocity
        force = p * error + i * integral + d * n * (error - filtered)
        acceleration = (force - b * velocity - k * position) / m
        return [velocity, acceleration, error, n * (error - filtered)]

    def run_odeint(_model: None) -> Samples:
        states = odeint(derivative, rest, time, tfirst=True, **tolerances)
        return np.asarray(states[:, 1], dtype=np.float64)

    def run_solve_ivp(_model: None) -> Samples:
        span = (0.0, float(time[-1]))
        solution = solve_ivp(derivative, span, rest, method="LSODA", t_eval=time, **tolerances)
        return np.asarray(solution.y[1], dtype=np.float64)

    def run_fsm(_model: None) -> Samples:
        state, compensation = np.zeros(2), 0.0
        output = np.zeros_like(time)

        def plant(_time: float, state: Samples) -> list[float]:
            position, velocity = state.tolist()
            return [velocity, (k * (compensation - position) - b * velocity) / m]

        for row in range(1, len(output)):
            compensation = case.compensate(compensation, case.amplitude - float(state[0]))
            state = solve_ivp(plant, (0.0, case.period), state, **tolerances).y[:, -1]
            output[row] = state[0]
        return output

    named: dict[str, tuple[str, Callable[[None], Samples]]] = {
        "SciPy LSODA, odeint": ("", run_odeint),
        "SciPy LSODA, solve_ivp": ("", run_solve_ivp),
    }
    if loop == "fsm":
        named = {"SciPy RK45 per tick": ("solve_ivp, ", run_fsm)}
    return [
        LoopEngine(
            name=name,
            build=lambda: None,
            run=run,
            accuracy=1e-6,
            note=f"{how}hand-written equations, rtol {_RTOL:g}",
        )
        for name, (how, run) in named.items()
    ]


def python_control(case: LoopCase, loop: LoopName) -> list[LoopEngine]:
    """Return linear blocks for the PID loop, a discrete nonlinear one for the FSM loop."""
    m, _, k = case.mass_damping_stiffness
    p, i, d, n = case.gains
    sampling = {} if loop == "pid" else {"dt": case.period}

    def law(_time: float, state: Samples, error: Samples, _params: object) -> list[float]:
        return [case.compensate(float(state[0]), float(error[0]))]

    def build() -> Any:
        output = [[0.0, 1.0]] if loop == "pid" else [[1.0, 0.0]]
        plant = ct.ss(case.dynamics, [[0.0], [(1.0 if loop == "pid" else k) / m]], output, 0.0)
        if loop == "fsm":
            plant = ct.sample_system(plant, case.period, "zoh")
        plant = ct.ss(plant, inputs="command", outputs="actual", name="plant")
        ports = {"inputs": "error", "outputs": "command", "name": "controller"}
        if loop == "pid":
            matrices = np.diag([0.0, -n]), [[1.0], [n]], [[i, -d * n]], p + d * n
            controller = ct.ss(*matrices, **ports)
        else:
            controller = ct.nlsys(law, law, states=1, **ports, **sampling)
        junction = ct.summing_junction(["desired", "-actual"], "error", name="vision", **sampling)
        blocks = [plant, controller, junction]
        return ct.interconnect(blocks, inputs="desired", outputs="actual", **sampling)

    def run(model: Any) -> Samples:
        time = case.time(loop)
        if loop == "pid":
            response = ct.forced_response(model, time, case.amplitude)
        else:
            desired = np.full_like(time, case.amplitude)
            response = ct.input_output_response(model, time, desired)
        return np.asarray(response.outputs, dtype=np.float64)

    exactly = "interconnect, forced_response (exact)"
    note = (
        exactly if loop == "pid" else "all discrete at the tick, plant by zero-order hold (exact)"
    )
    return [LoopEngine(name="python-control", build=build, run=run, accuracy=1e-10, note=note)]


def _plant(case: LoopCase, loop: LoopName) -> dict[str, Samples]:
    """Return the plant's matrices: from force to velocity, or from position to position."""
    m, _, k = case.mass_damping_stiffness
    gain, output = (1.0, [[0.0, 1.0]]) if loop == "pid" else (k, [[1.0, 0.0]])
    return {"A": case.dynamics, "B": np.array([[0.0], [gain / m]]), "C": np.array(output)}


def bdsim(case: LoopCase, loop: LoopName) -> list[LoopEngine]:
    """Return block diagrams on SciPy's integrators."""
    import bdsim as library

    def build() -> Any:
        # It says on standard output which toolboxes it did not find.
        with redirect_stdout(io.StringIO()):
            quiet = {"banner": False, "graphics": False, "progress": False, "quiet": True}
            runtime = library.BDSim(sysargs=False, **quiet)
        diagram = runtime.blockdiagram()
        vision = diagram.SUM("+-")
        plant = diagram.LTI_SS(**_plant(case, loop), x0=np.zeros(2))
        diagram.connect(diagram.CONSTANT(case.amplitude), vision[0])
        diagram.connect(plant, vision[1])
        (add_pid if loop == "pid" else add_fsm)(diagram, vision, plant)
        diagram.compile()
        return runtime, diagram, plant

    def add_pid(diagram: Any, vision: Any, plant: Any) -> None:
        p, i, d, n = case.gains
        proportional, integral = diagram.GAIN(p), diagram.INTEGRATOR(gain=i)
        unfiltered, filtered = diagram.SUM("+-"), diagram.INTEGRATOR()
        bandwidth, derivative = diagram.GAIN(n), diagram.GAIN(d * n)
        force = diagram.SUM("+++")
        diagram.connect(vision, proportional, integral, unfiltered[0])
        diagram.connect(filtered, unfiltered[1])
        diagram.connect(unfiltered, bandwidth, derivative)
        diagram.connect(bandwidth, filtered)
        for port, term in enumerate((proportional, integral, derivative)):
            diagram.connect(term, force[port])
        diagram.connect(force, plant)

    def add_fsm(diagram: Any, vision: Any, plant: Any) -> None:
        law = diagram.FUNCTION(case.compensate, nin=2)
        # Its clocks skip the tick at t = 0: the hold starts with what that tick would have given.
        start = case.compensate(0.0, case.amplitude)
        hold = diagram.ZOH(diagram.clock(case.period, "s"), x0=[start])
        diagram.connect(hold, law[0])
        diagram.connect(vision, law[1])
        diagram.connect(law, hold)
        diagram.connect(hold, plant)

    def run(model: Any) -> Samples:
        runtime, diagram, plant = model
        wanted = case.time(loop)
        with redirect_stdout(io.StringIO()):
            result = runtime.run(
                diagram,
                case.duration,
                dt=float(wanted[1]) if loop == "pid" else None,
                solver="LSODA" if loop == "pid" else "RK45",
                solver_args={"rtol": _RTOL, "atol": 1e-9},
                watch=[plant],
            )
        output = np.asarray(result.y, dtype=np.float64).ravel()
        return output if loop == "pid" else output[np.searchsorted(result.t, wanted - 1e-9)]

    note = f"LSODA, faster than Radau and BDF, rtol {_RTOL:g}"
    if loop == "fsm":
        note = f"RK45, rtol {_RTOL:g}, tick at t = 0 put into the initial state"
    return [LoopEngine(name="bdsim", build=build, run=run, accuracy=1e-6, note=note)]


def pathsim(case: LoopCase, loop: LoopName) -> list[LoopEngine]:
    """Return block diagrams with an integrator in every block."""
    from pathsim import Connection, Simulation
    from pathsim.blocks import PID, Adder, Constant, Scope, StateSpace, Wrapper
    from pathsim.solvers import GEAR52A, RKDP54

    rtol = 1e-5 if loop == "pid" else 1e-6
    step = float(case.time(loop)[1])

    def law() -> Callable[[float], float]:
        compensation = 0.0

        def tick(error: float) -> float:
            nonlocal compensation
            compensation = case.compensate(compensation, float(error))
            return compensation

        return tick

    def build() -> Any:
        p, i, d, n = case.gains
        desired, vision = Constant(case.amplitude), Adder("+-")
        plant = StateSpace(**_plant(case, loop), D=np.zeros((1, 1)))
        pid = PID(Kp=p, Ki=i, Kd=d, f_max=n)
        controller = pid if loop == "pid" else Wrapper(law(), T=step)
        scope = Scope(sampling_period=step)
        simulation = Simulation(
            [desired, vision, controller, plant, scope],
            [
                Connection(desired, vision[0]),
                Connection(plant, vision[1], scope),
                Connection(vision, controller),
                Connection(controller, plant),
            ],
            Solver=GEAR52A if loop == "pid" else RKDP54,
            dt=step,
            dt_max=step,
            tolerance_lte_rel=rtol,
            tolerance_lte_abs=1e-3 * rtol,
            log=False,
        )
        return simulation, scope

    def run(model: Any) -> Samples:
        simulation, scope = model
        simulation.run(case.duration)
        return np.asarray(scope.read()[1], dtype=np.float64).ravel()

    note = f"{'GEAR52A' if loop == 'pid' else 'RKDP54'}, rtol {rtol:.0e}"
    return [LoopEngine(name="pathsim", build=build, run=run, accuracy=1e-6, note=note)]


@dataclass(frozen=True, kw_only=True)
class EngineSource:
    """What makes engines, and what has to be installed for it."""

    make: Callable[[LoopCase, LoopName], list[LoopEngine]] | None = None
    requires: str  # name to import
    distribution: str
    extra: str | None = None  # of chamfer, that installs it


SOURCES: Final = (
    EngineSource(make=chamfer, requires="pydrake", distribution="drake"),
    EngineSource(make=compiled, requires="numba", distribution="numba"),
    EngineSource(make=drake, requires="pydrake", distribution="drake"),
    EngineSource(make=scipy, requires="scipy", distribution="scipy"),
    EngineSource(make=python_control, requires="control", distribution="control"),
    EngineSource(make=bdsim, requires="bdsim", distribution="bdsim", extra="bench"),
    EngineSource(make=pathsim, requires="pathsim", distribution="pathsim", extra="bench"),
)


def installed(
    sources: Iterable[EngineSource] = SOURCES,
) -> tuple[list[EngineSource], list[EngineSource]]:
    """Return the sources that can be used and those that are missing."""
    present: list[EngineSource] = []
    missing: list[EngineSource] = []
    for source in sources:
        (present if find_spec(source.requires) else missing).append(source)
    return present, missing


def engines(sources: Iterable[EngineSource], case: LoopCase, loop: LoopName) -> list[LoopEngine]:
    """Return the engines for a loop, Chamfer first."""
    return [engine for source in sources if source.make for engine in source.make(case, loop)]


def how_to_install(source: EngineSource) -> str:
    """Return one line that names a missing peer and says how to get it."""
    wanted = f".[{source.extra}]" if source.extra else source.distribution
    return f"{source.distribution} is not installed and left out: pip install '{wanted}'"
