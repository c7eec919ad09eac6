"""The block that runs the insertion's chart over the alignment loop."""

from chamfer.systems.statechart.state_machine import MachineOutput, StateMachine
from chamfer.systems.strategies.insertion_chart import (
    InsertionInputs,
    InsertionMemory,
    InsertionTaskParams,
    make_insertion_chart,
)

_AXES = 6


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
        - compensates
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
    of each joint, those of the impedance controllers. ``feed`` goes to
    :class:`chamfer.systems.force.desired_pose.FeedOffset`, ``compensates``, shape (2,), to
    :class:`chamfer.systems.servo.measurement_selector.MeasurementSelector`. ``errors``, shape
    (4,), are the last :class:`chamfer.systems.strategies.insertion_decision.MeasuredErrors`, 0
    before there are any; ``sensed_force``, shape (3,), N, along the hole's axes, and
    ``sensed_depth``, m, are what the arm knows of the contact, tared where the advance began;
    ``trouble`` is the :class:`chamfer.systems.strategies.insertion_chart.InsertionTrouble` of the
    attempt.

    Args:
        params: Parameters.
        peg_joints: How many joints the peg's arm has.
        hole_joints: Likewise the hole's; nothing is connected where it is no arm.
    """

    def __init__(self, params: InsertionTaskParams, *, peg_joints: int, hole_joints: int) -> None:
        super().__init__(
            make_insertion_chart(params),
            inputs=InsertionInputs,
            sizes={
                "error": _AXES,
                "valid": 1,
                "blind": 1,
                "diverged": 1,
                "compensation": _AXES,
                "force": 3,
                "advance": 1,
                "peg_saturated": peg_joints,
                "hole_saturated": hole_joints,
            },
            outputs={
                "feed": MachineOutput(
                    size=3, read=lambda memory: (memory.feed, memory.rate, memory.time)
                ),
                "compensates": MachineOutput(
                    size=2,
                    read=lambda memory: (float(memory.compensates), float(memory.along)),
                ),
                "attempts": MachineOutput(size=1, read=lambda memory: (float(memory.attempts),)),
                "errors": MachineOutput(size=4, read=lambda memory: tuple(memory.errors)),
                "sensed_force": MachineOutput(size=3, read=lambda memory: memory.sensed_force),
                "sensed_depth": MachineOutput(size=1, read=lambda memory: (memory.sensed_depth,)),
                "trouble": MachineOutput(size=1, read=lambda memory: (float(memory.trouble),)),
            },
            optional=("hole_saturated",),
            period=params.period,
        )
