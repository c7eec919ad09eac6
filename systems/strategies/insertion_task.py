"""The insertion's chart as a block."""

from chamfer.systems.statechart.state_machine import StateMachine
from chamfer.systems.strategies.insertion_law import (
    InsertionInputs,
    InsertionLaw,
    InsertionMemory,
    InsertionTaskParams,
)


class InsertionTask(StateMachine[InsertionInputs, InsertionMemory]):
    """Decides when to insert the peg, how far to feed it, and whether it is in.

    .. pydrake_system::

        name: InsertionTask
        input_ports:
        - error
        - valid
        - blind
        - diverged
        - compensation
        - force
        - advance
        - peg_saturated
        - hole_saturated (optional)
        output_ports:
        - feed
        - offset
        - compensates
        - tares
        - attempts
        - errors
        - sensed_force
        - sensed_depth
        - trouble
        - state

    Inputs:

    - ``error``, ``valid`` and ``blind``: those of the cameras.
    - ``diverged``: that of :class:`chamfer.systems.servo.divergence_watch.DivergenceWatch`.
    - ``compensation``, shape (6,), m and rad: the compensation so far.
    - ``force`` and ``advance``: those of
      :class:`chamfer.systems.force.impedance_controller.SpringForce`.
    - ``<arm>_saturated``, of each joint: those of the impedance controllers. Leave
      ``hole_saturated`` unconnected for a hole on a fixture.

    Outputs:

    - ``feed`` and ``offset``, of a search: for
      :class:`chamfer.systems.force.desired_pose.FeedOffset`.
    - ``compensates``, shape (2,): for
      :class:`chamfer.systems.servo.measurement_selector.MeasurementSelector`.
    - ``tares``: 1 in free space, where a force sensor can be tared.
    - ``attempts``: their number so far.
    - ``errors``, shape (4,): the last
      :class:`chamfer.systems.strategies.insertion_decision.MeasuredErrors`, 0 before the first.
    - ``sensed_force``, shape (3,), N, along the hole's axes, and ``sensed_depth``, m: the contact
      as the arm measures it, tared where the advance began.
    - ``trouble``: the :class:`chamfer.systems.strategies.insertion_law.InsertionTrouble` of the
      attempt.
    - ``state``: index of the chart's state.
    """

    def __init__(self, params: InsertionTaskParams, *, peg_joints: int, hole_joints: int) -> None:
        super().__init__(InsertionLaw(params, peg_joints=peg_joints, hole_joints=hole_joints))
