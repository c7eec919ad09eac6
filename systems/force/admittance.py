"""Admittance as a block: a commanded motion that gives way as a mass on spring and damper."""

from chamfer.systems.force.admittance_law import AdmittanceLaw, AdmittanceParams
from chamfer.systems.law_block import LawBlock


class AdmittanceController(LawBlock[AdmittanceLaw]):
    """Makes of a commanded velocity and a wrench the motion of a mass on spring and damper.

    .. pydrake_system::

        name: AdmittanceController
        input_ports:
        - command
        - wrench
        - damping (optional)
        output_ports:
        - velocity
        - perturbed

    ``M v' + D (v - v_cmd) + K (x - x_cmd) = F``, in the place of
    :class:`chamfer.systems.force.accommodation.AccommodationController`, whose ports it has, and
    whose velocity without M and K to the last bit. The axes are those of one frame that moves
    with the tool; of its rotations the displacement ``x - x_cmd`` is the sum, for small angles.
    A ``damping`` that is set takes the place of D; mass and spring stay.

    Discrete state: the velocity, the command and the displacement.

    Raises:
        ParameterError: At construction, and in a run for a damping that is set, if an axis is not
            monotone against the stated stiffness; in a run if another input is not finite.
    """

    def __init__(self, params: AdmittanceParams) -> None:
        super().__init__(AdmittanceLaw(params))
