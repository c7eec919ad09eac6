"""Drake as it comes: the same blocks, continuous in C++, with an integrator."""

from typing import NamedTuple

from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import Context, DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput, VectorLogSink

from chamfer.analysis.benchmarks.case import Case, Samples
from chamfer.analysis.benchmarks.engine import Engine, LoopName
from chamfer.diagrams.servo.servo_loops import make_servo_diagram

_RADAU_ACCURACY = 1e-6


class _Model(NamedTuple):
    simulator: Simulator
    context: Context
    logger: VectorLogSink


def engines(case: Case, loop: LoopName) -> list[Engine]:
    """Return the engine: radau3 for the stiff PID loop, Drake's default for the FSM loop."""
    step = case.period if loop == "fsm" else float(case.pid_time[1])
    stiff = loop == "pid"

    def build() -> _Model:
        builder = DiagramBuilder()
        servo = builder.AddSystem(make_servo_diagram(case.scenario, loops=[loop]))
        output = servo.GetOutputPort(f"{loop}.actual_trajectory")
        logger = LogVectorOutput(output, builder, publish_period=step)
        root = builder.Build()
        context = root.CreateDefaultContext()
        simulator = Simulator(root, context)
        if stiff:
            config = SimulatorConfig()
            config.integration_scheme = "radau3"
            config.accuracy = _RADAU_ACCURACY
            config.use_error_control = True
            ApplySimulatorConfig(config, simulator)
        return _Model(simulator, context, logger)

    def run(model: _Model) -> Samples:
        model.simulator.Initialize()
        model.simulator.AdvanceTo(case.duration)
        output: Samples = model.logger.FindLog(model.context).data()[0].copy()
        return output

    return [
        Engine(
            name="Drake as it comes",
            build=build,
            run=run,
            accuracy=1e-6 if stiff else 1e-5,
            note=f"C++ blocks, radau3, accuracy {_RADAU_ACCURACY:g}"
            if stiff
            else "C++ plant, default RK3, accuracy 1e-3",
        )
    ]
