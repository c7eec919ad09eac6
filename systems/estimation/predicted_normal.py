"""A predicted normal, as a camera that has seen the surface before would give it (section 4.5)."""

from pydrake.systems.framework import BasicVector, Context, LeafSystem

from chamfer.models.surfaces.surface import Surface, normal


class PredictedNormal(LeafSystem):
    """Gives the normal of a stored surface where the gripper is.

    .. pydrake_system::

        name: PredictedNormal
        input_ports:
        - nominal_motion
        output_ports:
        - predicted_normal

    ``nominal_motion``, shape (2d,), is the nominal endpoint's position, m, then its velocity;
    ``predicted_normal``, shape (d,), unit, that of the stored surface's level at this position.

    Args:
        surface: The surface as it is taken to be.
    """

    def __init__(self, surface: Surface) -> None:
        super().__init__()
        d = surface.dimension
        motion = self.DeclareVectorInputPort("nominal_motion", 2 * d)

        def calc(context: Context, vector: BasicVector) -> None:
            vector.SetFromVector(normal(surface, motion.Eval(context)[:d]))

        self.DeclareVectorOutputPort("predicted_normal", d, calc, {motion.ticket()})
