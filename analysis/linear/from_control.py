"""Systems of python-control as Drake blocks."""

import control
import numpy as np
from pydrake.systems.primitives import LinearSystem, MatrixGain

from chamfer.models.validation import ParameterError


def from_control(
    system: "control.StateSpace | control.TransferFunction",
) -> LinearSystem | MatrixGain:
    """Return a linear system of python-control as a Drake block with its name.

    A sampled system becomes a block that is updated once a period, one without states a gain. The
    block's vector input and output have the order of the system's. python-control chooses the
    states of a transfer function.

    Raises:
        ParameterError: If it is not linear, has more zeros than poles, has several inputs or
            outputs as a transfer function, is sampled with no period, or has numbers that are not
            finite and real.
    """
    if not isinstance(system, control.StateSpace | control.TransferFunction):
        raise ParameterError(
            "system", type(system).__name__, "a StateSpace or TransferFunction of python-control"
        )
    name = system.name
    if system.dt is True:
        raise ParameterError("dt", True, "a period, s, or 0 for continuous time")
    if isinstance(system, control.TransferFunction):
        if not system.issiso():
            allowed = "one input and one output, more of them as a StateSpace"
            raise ParameterError("transfer function", name, allowed)
        zeros, poles = len(system.zeros()), len(system.poles())
        if zeros > poles:
            raise ParameterError("zeros", zeros, f"at most as many as poles, {poles}")
        system = control.ss(system)
    matrices = [np.asarray(one) for one in (system.A, system.B, system.C, system.D)]
    if not all(np.isrealobj(one) and np.isfinite(one).all() for one in matrices):
        raise ParameterError("system", name, "finite real numbers in all matrices")
    if system.nstates:
        block = LinearSystem(*matrices, time_period=float(system.dt or 0.0))
    else:
        block = MatrixGain(D=matrices[3])
    block.set_name(name)
    return block
