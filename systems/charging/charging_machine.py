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

    Inputs:

    * ``endpoint_motion``, shape (14,), from the encoders.
    * ``desired_position``, ``desired_velocity``, shape (7,) each, and ``progress``, size 1, from
      :class:`chamfer.systems.trajectory.path_follower.PathFollower`.
    * ``measured_force``, shape (3,), N, of the nugget on its environment, world axes, tared.
    * ``mean_force``, shape (3,), N, the mean of its last readings, which shows contact.
    * ``held``, size 1, is 1 with a part in the gripper.
    * ``homed``, size 1, is 1 with the encoders' zeros known.
    * ``alive``, size 1, is 1 while the force sensor works.
    * ``halt``, size 1, is 1 while the operator halts the cycle.
    * ``layer_normal``, shape (3,), unit, is an observer's estimate of the normal below.

    Outputs:

    * ``segment``, shape (25,), and ``hold``, size 1, for the path follower.
    * ``mode``, size 1, ``desired_force``, shape (7,), N, and ``selection``, shape (49,), for the
      hybrid controller.
    * ``below``, shape (3,), the direction into the surface below that the chart assumes.
    * ``restart``, size 1, for the observer: 1 while nothing below is pressed.
    * ``wall``, shape (3,), for the observer: the direction into a wall that is pressed too, else
      zeros.
    * ``grip``, size 1, is 1 to close the gripper.
    * ``tare``, size 1, is 1 while the force sensor's zero is taken.
    * ``item``, size 1, index in the plan; ``state``, that of the chart.
    * ``finished``, size 1: 1 done, 2 stopped, 0 before.
    * ``trouble``, size 1, a :class:`chamfer.systems.charging.charging_params.ChargingTrouble`.
    """

    def __init__(self, params: ResolvedChargingParams, beliefs: ChargingBeliefs) -> None:
        super().__init__(ChargingLaw(params, beliefs))

    def reason(self, context: Context) -> str:
        """Return the reason why the cycle stopped, in words; "" if it did not."""
        return self.snapshot(context).memory.said()
