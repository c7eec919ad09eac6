import numpy as np

from analysis.run.simulate import simulate
from diagrams.servo.parallel_axes import make_parallel_axes_diagram
from diagrams.servo.servo_loops import make_fsm_loop
from diagrams.servo.servo_scenario import FsmParams, StepScenario, fsm_axis
from systems.servo.compensator import AxisParams
from systems.servo.desired_trajectory import Step
from systems.servo.spring_mass_damper import make_spring_mass_damper


def test_each_axis_is_the_loop_that_it_would_be_alone() -> None:
    settings = [(0.004, 0.3), (0.009, 1.0), (0.03, -0.7)]
    scenarios = [
        StepScenario(
            fsm=FsmParams(increment=increment, limit=10.0), desired=Step(amplitude=amplitude)
        )
        for increment, amplitude in settings
    ]
    axes: list[AxisParams] = [fsm_axis(scenario, "position") for scenario in scenarios]
    period = scenarios[0].fsm.period
    together = simulate(
        make_parallel_axes_diagram(
            axes,
            make_spring_mass_damper(scenarios[0].plant, "position"),
            np.array([amplitude for _, amplitude in settings]),
            scenarios[0].measurement,
            step=period,
        ),
        duration=2.0,
        step=period,
    )
    for i, scenario in enumerate(scenarios):
        alone = simulate(
            make_fsm_loop(scenario, "position", step=period), duration=2.0, step=period
        )
        np.testing.assert_allclose(
            together.outputs["actual_trajectory"][:, i],
            alone.outputs["actual_trajectory"],
            atol=1e-12,
        )
    increments = together.outputs["increment"]
    assert set(np.abs(increments[:, 1]).round(12)) <= {0.0, 0.0018, 0.009}
