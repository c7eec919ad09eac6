"""The motion of an arm's endpoint, from its encoders."""

from pydrake.systems.framework import BasicVector, Context, LeafSystem

from chamfer.models.arms.arm import Kinematics


class EndpointMotion(LeafSystem):
    """Turns joint positions and velocities into the endpoint's.

    .. pydrake_system::

        name: EndpointMotion
        input_ports:
        - encoders
        output_ports:
        - endpoint_motion
        - nominal_motion

    The endpoint is where a gripper's tip would be if it were relaxed, the nominal one of chapter
    4. ``encoders``, shape (2n,), q and velocity. ``endpoint_motion``, shape (2m,), the endpoint
    vector x, m (rad), then ``J v``; ``nominal_motion``, shape (2d,), the same of its d first
    coordinates, which are those of the plane or of space.

    Args:
        arm: Its kinematics; n joints, m coordinates.
        dimension: d.
    """

    def __init__(self, arm: Kinematics, *, dimension: int) -> None:
        super().__init__()
        n, m = arm.num_joints, arm.num_coordinates
        encoders = self.DeclareVectorInputPort("encoders", 2 * n)

        def declare(name: str, size: int) -> None:
            def calc(context: Context, vector: BasicVector) -> None:
                measured = encoders.Eval(context)
                q, v = measured[:n], measured[n:]
                vector.SetFromVector([*arm.endpoint(q)[:size], *(arm.jacobian(q) @ v)[:size]])

            self.DeclareVectorOutputPort(name, 2 * size, calc, {encoders.ticket()})

        declare("endpoint_motion", m)
        declare("nominal_motion", dimension)
