"""Accommodation, or damping control, as a block (section 3.2)."""

from chamfer.systems.force.accommodation_law import AccommodationLaw, AccommodationParams
from chamfer.systems.law_block import LawBlock


class AccommodationController(LawBlock[AccommodationLaw]):
    """Perturbs a commanded velocity in proportion to the wrench, ``V_ref = V_cmd + D^-1 F``.

    .. pydrake_system::

        name: AccommodationController
        input_ports:
        - command
        - wrench
        - damping (optional)
        output_ports:
        - velocity
        - perturbed

    All of shape (6,), angular above linear, in the axes of one frame, whose origin is the
    reference point: ``command`` and ``velocity`` in rad/s and m/s, ``wrench`` in N m and N, on the
    tool. The velocity is computed once a period and held; ``perturbed`` is the command that it was
    computed of, held likewise. ``damping``, N m s/rad and N s/m, sets sub-matrices of D: of each
    axis the damping in place of that of the parameters, infinity for stiff, 0 for that of the
    parameters.

    Discrete state: the velocity, the command.

    Raises:
        ParameterError: At construction, and in a run for a damping that is set, if an axis is not
            monotone against the stated stiffness; in a run if another input is not finite.
    """

    def __init__(self, params: AccommodationParams) -> None:
        super().__init__(AccommodationLaw(params))
