from collections.abc import Callable, Collection, Iterable

import pytest
from pydrake.systems.framework import BasicVector, Context, Diagram, LeafSystem

from chamfer.models.arms.arm import Arm

Wire = tuple[str, str, str, str]  # from block and port, to block and port


def of(diagram: Diagram, flat: bool = False) -> set[Wire]:
    assert not (flat and any(isinstance(system, Diagram) for system in diagram.GetSystems()))
    return {
        (
            source.get_name(),
            source.get_output_port(output).get_name(),
            target.get_name(),
            target.get_input_port(entrance).get_name(),
        )
        for (target, entrance), (source, output) in diagram.connection_map().items()
    }


@pytest.fixture(scope="session")
def wires() -> Callable[..., set[Wire]]:
    """Finds every connection between a diagram's blocks; a diagram in it is one, if not flat."""
    return of


def acting_on(wiring: Iterable[Wire], block: str, cut: Collection[str] = ()) -> set[str]:
    before: dict[str, set[str]] = {}
    for source, _, target, _ in wiring:
        before.setdefault(target, set()).add(source)
    found: set[str] = set()
    front = [block]
    while front:
        more = before.get(front.pop(), set()) - found
        found |= more
        front += [name for name in more if name not in cut]
    return found


@pytest.fixture(scope="session")
def known_to() -> Callable[..., set[str]]:
    """Finds what acts on a block, directly or through others, but not through those to cut."""
    return acting_on


class Push(LeafSystem):
    """A user's own law: pushes straight ahead with the desired force, whatever is measured."""

    def __init__(self, arm: Arm, **wrong: int) -> None:
        super().__init__()
        n, m = arm.num_joints, arm.num_coordinates
        sizes = {"encoders": 2 * n, "desired_force": m, "desired_position": m} | {
            "measured_force": m,
            "selection": m * m,
            "mode": 1,
            **wrong,
        }
        ports = {name: self.DeclareVectorInputPort(name, size) for name, size in sizes.items()}
        motion, force = ports["encoders"], ports["desired_force"]

        def calc(context: Context, vector: BasicVector) -> None:
            J = arm.jacobian(motion.Eval(context)[:n])
            vector.SetFromVector(J.T @ force.Eval(context))

        self.DeclareVectorOutputPort("torque", n, calc, {motion.ticket(), force.ticket()})
        for name in ("position_error", "force_error"):
            self.DeclareVectorOutputPort(name, m, lambda _, vector: vector.SetZero())


@pytest.fixture(scope="session")
def push() -> type[Push]:
    """A hybrid law of one's own, whose input ports may have wrong sizes."""
    return Push
