"""The two loops in Chamfer and in other simulators: a function for each yields its engines.

Packages that are not on every machine are imported when the function is called.
"""

import io
import platform
from collections.abc import Callable, Iterator
from contextlib import redirect_stdout
from dataclasses import replace
from importlib.metadata import PackageNotFoundError, version
from typing import Any, Final

import control as ct
import numpy as np
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import Context, DiagramBuilder, System
from pydrake.systems.primitives import LogVectorOutput, VectorLogSink
from scipy.integrate import odeint, solve_ivp

from chamfer.analysis.benchmarks.engine import LoopCase, LoopEngine, Samples
from chamfer.analysis.linear.simulate import simulate
from chamfer.diagrams.servo.compiled_loop import run_fsm_trials
from chamfer.diagrams.servo.servo_loops import make_pid_loop, make_servo_diagram
from chamfer.diagrams.servo.servo_scenario import fsm_axis
from chamfer.systems.exact_discretisation import fuse

CHAMFER: Final = "Chamfer"
COMPILED: Final = "Chamfer, compiled"
DRAKE: Final = "Drake as it comes"
PER_TICK: Final = "SciPy RK45 per tick"
_TRIALS: Final = 1000
_RTOL: Final = 1e-6


def chamfer(case: LoopCase) -> Iterator[LoopEngine]:
    """Yield the project's own loops; they step at the output's times, where they are exact."""

    def build() -> System:
        if case.loop == "fsm":
            return make_servo_diagram(case.scenario, loops=["fsm"], step=case.step)
        return fuse(make_pid_loop(case.scenario, "velocity"))

    def run(system: System) -> Samples:
        outputs = simulate(system, duration=case.duration, step=case.step).outputs
        return outputs["fsm.actual_trajectory"] if case.loop == "fsm" else outputs["y0"][:, -1]

    how = "stepped by Drake" if case.loop == "fsm" else "fused by Drake, solved by matrix powers"
    note = f"exact steps of {1e3 * case.step:g} ms, {how}"
    yield LoopEngine(name=CHAMFER, build=build, run=run, accuracy=1e-10, note=note)


def compiled(case: LoopCase) -> Iterator[LoopEngine]:
    """Yield the loops that a trial of a map or a sweep uses: thousands of FSM loops."""
    if case.loop == "pid":
        return  # runs as it does alone
    axis = fsm_axis(case.scenario, "position")
    # The first trial is the case, the others have other increments.
    axes = [
        replace(axis, increment=share * axis.increment)
        for share in np.geomspace(1.0, 10.0, _TRIALS).tolist()
    ]

    def run(_model: None) -> Samples:
        first: Samples = run_fsm_trials(
            case.scenario, "position", duration=case.duration, step=case.step, axes=axes
        ).actual_trajectory[0]
        return first

    note = f"a map of {_TRIALS} trials, times of one"
    yield LoopEngine(name=COMPILED, run=run, accuracy=1e-10, note=note, trials=_TRIALS)


def drake(case: LoopCase) -> Iterator[LoopEngine]:
    """Yield Drake's own blocks, continuous in C++, with an integrator."""
    stiff = case.loop == "pid"
    Model = tuple[Simulator, Context, VectorLogSink]

    def build() -> Model:
        builder = DiagramBuilder()
        servo = builder.AddSystem(make_servo_diagram(case.scenario, loops=[case.loop]))
        output = servo.GetOutputPort(f"{case.loop}.actual_trajectory")
        logger = LogVectorOutput(output, builder, publish_period=case.step)
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

    accuracy, note = 1e-5, "C++ plant, default RK3, accuracy 1e-3"
    if stiff:
        accuracy, note = 1e-6, f"C++ blocks, radau3, accuracy {_RTOL:g}"
    yield LoopEngine(name=DRAKE, build=build, run=run, accuracy=accuracy, note=note)


def scipy(case: LoopCase) -> Iterator[LoopEngine]:
    """Yield hand-written equations: LSODA by both interfaces, or the FSM's plant per tick."""
    m, b, k = case.mass_damping_stiffness
    p, i, d, n = case.gains
    tolerances: dict[str, Any] = {"rtol": _RTOL, "atol": 1e-8}
    time, rest = case.time, [0.0, 0.0, 0.0, 0.0]

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
            state = solve_ivp(plant, (0.0, case.step), state, **tolerances).y[:, -1]
            output[row] = state[0]
        return output

    note = f"hand-written equations, rtol {_RTOL:g}"
    if case.loop == "fsm":
        note = f"solve_ivp, {note}"
        yield LoopEngine(name=PER_TICK, run=run_fsm, accuracy=1e-6, note=note)
        return
    for name, run in (("odeint", run_odeint), ("solve_ivp", run_solve_ivp)):
        yield LoopEngine(name=f"SciPy LSODA, {name}", run=run, accuracy=1e-6, note=note)


def _plant(case: LoopCase) -> dict[str, Samples]:
    """Return the plant's matrices: from force to velocity, or from position to position."""
    m, _, k = case.mass_damping_stiffness
    gain, output = (1.0, [[0.0, 1.0]]) if case.loop == "pid" else (k, [[1.0, 0.0]])
    return {"A": case.dynamics, "B": np.array([[0.0], [gain / m]]), "C": np.array(output)}


def python_control(case: LoopCase) -> Iterator[LoopEngine]:
    """Yield linear blocks for the PID loop, a discrete nonlinear one for the FSM loop."""
    p, i, d, n = case.gains
    sampling = {} if case.loop == "pid" else {"dt": case.step}

    def law(_time: float, state: Samples, error: Samples, _params: object) -> list[float]:
        return [case.compensate(float(state[0]), float(error[0]))]

    def build() -> Any:
        plant = ct.ss(*_plant(case).values(), 0.0)
        if case.loop == "fsm":
            plant = ct.sample_system(plant, case.step, "zoh")
        plant = ct.ss(plant, inputs="command", outputs="actual", name="plant")
        ports = {"inputs": "error", "outputs": "command", "name": "controller"}
        if case.loop == "pid":
            matrices = np.diag([0.0, -n]), [[1.0], [n]], [[i, -d * n]], p + d * n
            controller = ct.ss(*matrices, **ports)
        else:
            controller = ct.nlsys(law, law, states=1, **ports, **sampling)
        junction = ct.summing_junction(["desired", "-actual"], "error", name="vision", **sampling)
        blocks = [plant, controller, junction]
        return ct.interconnect(blocks, inputs="desired", outputs="actual", **sampling)

    def run(model: Any) -> Samples:
        time = case.time
        if case.loop == "pid":
            response = ct.forced_response(model, time, case.amplitude)
        else:
            desired = np.full_like(time, case.amplitude)
            response = ct.input_output_response(model, time, desired)
        return np.asarray(response.outputs, dtype=np.float64)

    note = "interconnect, forced_response (exact)"
    if case.loop == "fsm":
        note = "all discrete at the tick, plant by zero-order hold (exact)"
    yield LoopEngine(name="python-control", build=build, run=run, accuracy=1e-10, note=note)


def bdsim(case: LoopCase) -> Iterator[LoopEngine]:
    """Yield block diagrams on SciPy's integrators."""
    import bdsim as library

    def build() -> Any:
        # It says on standard output which toolboxes it did not find.
        with redirect_stdout(io.StringIO()):
            quiet = {"banner": False, "graphics": False, "progress": False, "quiet": True}
            runtime = library.BDSim(sysargs=False, **quiet)
        diagram = runtime.blockdiagram()
        vision = diagram.SUM("+-")
        plant = diagram.LTI_SS(**_plant(case), x0=np.zeros(2))
        diagram.connect(diagram.CONSTANT(case.amplitude), vision[0])
        diagram.connect(plant, vision[1])
        (add_pid if case.loop == "pid" else add_fsm)(diagram, vision, plant)
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
        hold = diagram.ZOH(diagram.clock(case.step, "s"), x0=[start])
        diagram.connect(hold, law[0])
        diagram.connect(vision, law[1])
        diagram.connect(law, hold)
        diagram.connect(hold, plant)

    def run(model: Any) -> Samples:
        runtime, diagram, plant = model
        wanted = case.time
        with redirect_stdout(io.StringIO()):
            result = runtime.run(
                diagram,
                case.duration,
                dt=float(wanted[1]) if case.loop == "pid" else None,
                solver="LSODA" if case.loop == "pid" else "RK45",
                solver_args={"rtol": _RTOL, "atol": 1e-9},
                watch=[plant],
            )
        output = np.asarray(result.y, dtype=np.float64).ravel()
        return output if case.loop == "pid" else output[np.searchsorted(result.t, wanted - 1e-9)]

    note = f"LSODA, faster than Radau and BDF, rtol {_RTOL:g}"
    if case.loop == "fsm":
        note = f"RK45, rtol {_RTOL:g}, tick at t = 0 put into the initial state"
    yield LoopEngine(name="bdsim", build=build, run=run, accuracy=1e-6, note=note)


def pathsim(case: LoopCase) -> Iterator[LoopEngine]:
    """Yield block diagrams with an integrator in every block."""
    from pathsim import Connection, Simulation
    from pathsim.blocks import PID, Adder, Constant, Scope, StateSpace, Wrapper
    from pathsim.solvers import GEAR52A, RKDP54

    rtol = 1e-5 if case.loop == "pid" else 1e-6
    step = case.step

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
        plant = StateSpace(**_plant(case), D=np.zeros((1, 1)))
        pid = PID(Kp=p, Ki=i, Kd=d, f_max=n)
        controller = pid if case.loop == "pid" else Wrapper(law(), T=step)
        scope = Scope(sampling_period=step)
        simulation = Simulation(
            [desired, vision, controller, plant, scope],
            [
                Connection(desired, vision[0]),
                Connection(plant, vision[1], scope),
                Connection(vision, controller),
                Connection(controller, plant),
            ],
            Solver=GEAR52A if case.loop == "pid" else RKDP54,
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

    note = f"{'GEAR52A' if case.loop == 'pid' else 'RKDP54'}, rtol {rtol:.0e}"
    yield LoopEngine(name="pathsim", build=build, run=run, accuracy=1e-6, note=note)


PEERS: Final = (chamfer, compiled, drake, scipy, python_control, bdsim, pathsim)
EXTRA: Final = ("bdsim", "pathsim", "fullseye")  # distributions of the extra `bench`


def engines(case: LoopCase) -> list[LoopEngine]:
    """Return the engines that are installed, Chamfer first."""
    left_out = missing()
    return [one for peer in PEERS if peer.__name__ not in left_out for one in peer(case)]


def versions() -> dict[str, str]:
    """Return the versions of Python and of all engines, missing ones included."""
    found = {"python": platform.python_version()}
    for name in ("drake", "numpy", "scipy", "control", "mujoco", *EXTRA):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "missing"
    return found


def missing() -> list[str]:
    """Return the distributions that are not installed."""
    return [name for name, found in versions().items() if found == "missing" and name in EXTRA]
