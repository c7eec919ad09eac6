"""The samples of a noise source of Drake's, all at once."""

import math

import numpy as np
from numpy.typing import NDArray
from pydrake.common import RandomDistribution, RandomGenerator
from pydrake.systems.framework import DiagramBuilder, System
from pydrake.systems.primitives import RandomSource


def drawn_noise(
    distribution: RandomDistribution, shape: tuple[int, int], *, after: System, seed: int
) -> NDArray[np.float64]:
    """Return what a source shows before each of its ticks, of shape (ticks, channels).

    A source that draws all its samples in one tick draws the same ones. Drake hands one generator
    from block to block: what comes before the source, the block that it is ``after``, draws its
    initial state from it, though that has no spread.
    """
    builder = DiagramBuilder()
    builder.AddSystem(after)
    source = builder.AddSystem(RandomSource(distribution, math.prod(shape), 1.0))
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    diagram.SetRandomContext(context, RandomGenerator(seed))
    samples = source.get_output_port().Eval(source.GetMyContextFromRoot(context))
    return np.array(samples).reshape(shape)
