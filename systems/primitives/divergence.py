"""Tells a simulation that diverges from a skill that fails."""

from collections.abc import Mapping

import numpy as np
from pydrake.systems.framework import Context, LeafSystem, State

from chamfer.models.validation import ParameterError


class DivergenceGuard(LeafSystem):
    """Stops a simulation whose signals are beyond all that is physical.

    .. pydrake_system::

        name: DivergenceGuard
        input_ports:
        - (one per entry of ``limits``)

    It looks once a period, before whatever was added to the diagram after it.

    Args:
        plant: What diverges, for the message.
        limits: Size and largest element of each signal.
        period: s, between two looks.

    Raises:
        ParameterError: In a run, if a signal is not finite or beyond its limit, with its time.
    """

    def __init__(
        self, plant: str, *, limits: Mapping[str, tuple[int, float]], period: float
    ) -> None:
        super().__init__()
        ports = [
            (self.DeclareVectorInputPort(name, size), most)
            for name, (size, most) in limits.items()
        ]

        def look(context: Context, state: State) -> None:
            for port, most in ports:
                values = port.Eval(context)
                bad = values[~(np.abs(values) <= most)]
                if bad.size:
                    raise ParameterError(
                        f"simulation failed: {port.get_name()} of the {plant} at "
                        f"{context.get_time():.6g} s",
                        float(bad[0]),
                        f"at most {most:g}, it diverges; a shorter step may help",
                    )

        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, look)
