"""The trajectory compensator of Figs. 3 and 4 as a block."""

from chamfer.systems.servo.compensator_law import (
    CompensatorInputs,
    CompensatorLaw,
    CompensatorMemory,
    CompensatorParams,
)
from chamfer.systems.statechart.state_machine import StateMachine


class TrajectoryCompensator(StateMachine[CompensatorInputs, CompensatorMemory]):
    """Corrects a commanded trajectory step by step until the measured error is gone.

    .. pydrake_system::

        name: TrajectoryCompensator
        input_ports:
        - error
        - valid (optional)
        - desired_trajectory (optional)
        output_ports:
        - compensation
        - command
        - increment
        - axis_state
        - state

    All ports except ``valid`` (1: use the measurement) and ``state`` have one element per axis:

    - ``command``: the desired trajectory plus the compensation;
    - ``increment``: the increment of the last tick, before the limit;
    - ``axis_state``: the state of each axis' chart, as an index into ``axis_chart.state_names``.

    An error that is not finite counts as not valid.
    """

    def __init__(self, params: CompensatorParams) -> None:
        law = CompensatorLaw(params)
        super().__init__(law)
        self.axis_chart = law.axis_chart
