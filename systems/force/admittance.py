"""Admittance as a block: a commanded motion that gives way as a mass on spring and damper."""

from chamfer.systems.force.admittance_law import AdmittanceLaw, AdmittanceParams
from chamfer.systems.law_block import LawBlock


class AdmittanceController(LawBlock[AdmittanceLaw]):
    """Moves like a mass on spring and damper under a commanded velocity and a wrench.

    .. pydrake_system::

        name: AdmittanceController
        input_ports:
        - command
        - wrench
        - damping (optional)
        output_ports:
        - velocity
        - perturbed

    ``M v' + D (v - v_cmd) + K (x - x_cmd) = F``. The block replaces
    :class:`chamfer.systems.force.accommodation.AccommodationController` and has the same ports.
    Without M and K its velocity is the same to the last bit. The axes are those of one frame that
    moves with the tool. The displacement ``x - x_cmd`` is the sum of its rotations, for small
    angles. A ``damping`` that is set replaces D; mass and spring stay.

    Discrete state: the velocity, the command and the displacement.

    Raises:
        ParameterError: At construction, and in a run for a damping that is set, if an axis is not
            monotone against the stated stiffness; in a run if another input is not finite.
    """

    def __init__(self, params: AdmittanceParams) -> None:
        super().__init__(AdmittanceLaw(params))
