"""The block that charges a crucible."""

from pydrake.systems.framework import Context

from chamfer.systems.charging.charging_law import ChargingLaw
from chamfer.systems.charging.charging_params import (
    ChargingBeliefs,
    ChargingInputs,
    ChargingMemory,
    ResolvedChargingParams,
)
from chamfer.systems.statechart.state_machine import StateMachine


class ChargingMachine(StateMachine[ChargingInputs, ChargingMemory]):
    """Charges a crucible, nugget by nugget.

    .. pydrake_system::

        name: ChargingMachine
        input_ports:
        - endpoint_motion
        - desired_position
        - desired_velocity
        - progress
        - measured_force
        - mean_force
        - held
        - homed (optional)
        - alive (optional)
        - halt (optional)
        - layer_normal (optional)
        output_ports:
        - segment
        - hold
        - mode
        - desired_force
        - selection
        - grip
        - tare
        - below
        - restart
        - wall
        - item
        - finished
        - trouble
        - state

    ``endpoint_motion``, shape (14,), by the encoders; ``desired_position``, ``desired_velocity``,
    shape (7,) each, and ``progress``, size 1, what
    :class:`chamfer.systems.trajectory.path_follower.PathFollower` gives; ``measured_force``, shape
    (3,), N, of the nugget on its environment, world axes, tared, and ``mean_force``, shape (3,),
    N, the mean of its last readings, by which contact is told. Size 1 each: ``held``, 1 with a
    part in the gripper; ``homed``, 1 with the encoders' zeros known; ``alive``, 1 while the force
    sensor works; ``halt``, 1 while the operator wants all to stand still. ``layer_normal``, shape
    (3,), unit, of what lies below, as an observer estimates it.

    ``segment``, shape (25,), and ``hold``, size 1, are for the path follower; ``mode``, size 1,
    ``desired_force``, shape (7,), N, and ``selection``, shape (49,), for the hybrid controller.
    ``below``, shape (3,), is the direction into what lies below that is taken for true; for the
    observer ``restart``, size 1, is 1 while nothing is pressed on below, and ``wall``, shape (3,),
    the direction into a wall that is pressed on meanwhile, else zeros.
    Size 1 each: ``grip``, 1 to close the gripper; ``tare``, 1 while the force sensor's zero is
    taken; ``item``, index in the plan; ``finished``, 1 done, 2 stopped, 0 before; ``trouble``,
    :class:`chamfer.systems.charging.charging_params.ChargingTrouble`.
    """

    def __init__(self, params: ResolvedChargingParams, beliefs: ChargingBeliefs) -> None:
        super().__init__(ChargingLaw(params, beliefs))

    def reason(self, context: Context) -> str:
        """Return what stopped the cycle, in words; "" if nothing did."""
        return self.snapshot(context).memory.said()
