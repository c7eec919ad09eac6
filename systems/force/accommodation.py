"""Accommodation, or damping control, as a block (section 3.2)."""

from chamfer.systems.force.accommodation_law import AccommodationLaw, AccommodationParams
from chamfer.systems.law_block import LawBlock


class AccommodationController(LawBlock[AccommodationLaw]):
    """Changes a commanded velocity in proportion to the wrench, ``V_ref = V_cmd + D^-1 F``.

    .. pydrake_system::

        name: AccommodationController
        input_ports:
        - command
        - wrench
        - damping (optional)
        output_ports:
        - velocity
        - perturbed

    All signals have shape (6,), angular above linear, in the axes of one frame; its origin is the
    reference point. ``command`` and ``velocity`` are in rad/s and m/s, ``wrench`` in N m and N, on
    the tool. The block computes the velocity once a period and holds it. ``perturbed`` is the
    command behind it, held likewise. ``damping``, N m s/rad and N s/m, replaces the parameters'
    damping of each axis: infinity is stiff, 0 keeps the parameters' value.

    Discrete state: the velocity, the command.

    Raises:
        ParameterError: At construction, and in a run for a damping that is set, if an axis is not
            monotone against the stated stiffness; in a run if another input is not finite.
    """

    def __init__(self, params: AccommodationParams) -> None:
        super().__init__(AccommodationLaw(params))
