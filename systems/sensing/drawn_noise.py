"""The samples of Drake's sources of noise, all at once."""

import math

import numpy as np
from numpy.typing import NDArray
from pydrake.common import RandomDistribution, RandomGenerator
from pydrake.systems.framework import DiagramBuilder, System
from pydrake.systems.primitives import ConstantVectorSource, RandomSource

Noise = tuple[RandomDistribution | None, tuple[int, int]]  # None: zeros; ticks and channels


def drawn_noise(
    *noises: Noise, seed: int, after: System | None = None
) -> list[NDArray[np.float64]]:
    """Return the sources' outputs before each of their ticks, shape (ticks, channels) each.

    A source that draws all its samples in one tick draws the same ones. Drake hands one generator
    from block to block, in which each source draws a seed of its own: what comes before them, the
    block that they are ``after``, draws its initial state from it, though that has no spread.
    """
    builder = DiagramBuilder()
    builder.AddSystem(after or ConstantVectorSource([0.0]))  # a diagram of no block is refused
    sources = [
        kind and builder.AddSystem(RandomSource(kind, math.prod(shape), 1.0))
        for kind, shape in noises
    ]
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    diagram.SetRandomContext(context, RandomGenerator(seed))
    found = [np.zeros(shape) for _, shape in noises]
    for samples, source in zip(found, sources, strict=True):
        if source:
            own = source.GetMyContextFromRoot(context)
            samples.flat[:] = source.get_output_port().Eval(own)
    return found
