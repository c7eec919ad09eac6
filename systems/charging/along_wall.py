"""Contact with the layer below, for a nugget that is also at the wall."""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem


class AlongWall(LeafSystem):
    """Removes the components along the wall's normal from force and motion.

    .. pydrake_system::

        name: AlongWall
        input_ports:
        - wall
        - force
        - motion
        output_ports:
        - force_along
        - motion_along

    The rest of the force comes from the layer and from friction at the wall, which is along the
    motion. So section 4.1 holds in the wall's tangent plane as it does with a single contact.

    ``force``, shape (3,), N; ``motion``, shape (6,), m and m/s; ``wall``, shape (3,), its unit
    normal, zeros where there is no wall.
    """

    def __init__(self) -> None:
        super().__init__()
        wall = self.DeclareVectorInputPort("wall", 3)

        def declare(name: str, size: int) -> None:
            whole = self.DeclareVectorInputPort(name, size)

            def calc(context: Context, vector: BasicVector) -> None:
                rows, normal = whole.Eval(context).reshape(-1, 3), wall.Eval(context)
                vector.SetFromVector((rows - np.outer(rows @ normal, normal)).ravel())

            depends = {whole.ticket(), wall.ticket()}
            self.DeclareVectorOutputPort(f"{name}_along", size, calc, depends)

        declare("force", 3)
        declare("motion", 6)
