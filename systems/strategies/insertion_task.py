"""The insertion's chart as a block."""

from chamfer.systems.statechart.state_machine import StateMachine
from chamfer.systems.strategies.insertion_law import (
    InsertionInputs,
    InsertionLaw,
    InsertionMemory,
    InsertionTaskParams,
)


class InsertionTask(StateMachine[InsertionInputs, InsertionMemory]):
    """Decides when the peg is inserted, how far it is fed, and whether it is in.

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

    ``error``, ``valid`` and ``blind`` are those of the cameras, ``compensation``, shape (6,), m
    and rad, what has been made of them, ``diverged`` that of
    :class:`chamfer.systems.servo.divergence_watch.DivergenceWatch`; ``force`` and ``advance`` are
    those of :class:`chamfer.systems.force.impedance_controller.SpringForce`, ``<arm>_saturated``,
    of each joint, those of the impedance controllers. ``feed`` and ``offset``, of a search, go to
    :class:`chamfer.systems.force.desired_pose.FeedOffset`; ``tares`` is 1 in free space, where a
    force sensor takes its zero, ``compensates``, shape (2,), goes to
    :class:`chamfer.systems.servo.measurement_selector.MeasurementSelector`. ``errors``, shape
    (4,), are the last :class:`chamfer.systems.strategies.insertion_decision.MeasuredErrors`, 0
    before there are any; ``sensed_force``, shape (3,), N, along the hole's axes, and
    ``sensed_depth``, m, are what the arm knows of the contact, tared where the advance began;
    ``trouble`` is the :class:`chamfer.systems.strategies.insertion_law.InsertionTrouble` of the
    attempt. Nothing is connected to ``hole_saturated`` where the hole is no arm's.
    """

    def __init__(self, params: InsertionTaskParams, *, peg_joints: int, hole_joints: int) -> None:
        super().__init__(InsertionLaw(params, peg_joints=peg_joints, hole_joints=hole_joints))
