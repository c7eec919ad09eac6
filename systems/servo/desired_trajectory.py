"""Desired trajectories that are themselves linear systems.

A step and a sinusoid are the outputs of linear systems without input. As such they can be fused
with a linear loop and stepped exactly, which a sampled source can't.
"""

from dataclasses import dataclass

import numpy as np
from pydrake.systems.primitives import LinearSystem

from chamfer.models.validation import require_finite, require_positive


@dataclass(frozen=True, kw_only=True)
class Step:
    """A step at t = 0 from zero to ``amplitude``."""

    amplitude: float = 1.0  # m, height of the step; Fig. 8

    def __post_init__(self) -> None:
        require_finite(self, "amplitude")


@dataclass(frozen=True, kw_only=True)
class Sinusoid:
    """``amplitude sin(frequency t)``; the paper prints the amplitude but not the frequency."""

    amplitude: float = 1.0  # m, half of the way from peak to peak; Fig. 9
    frequency: float = 1.0  # rad/s, assumed: the default of Simulink's block

    def __post_init__(self) -> None:
        require_finite(self, "amplitude")
        require_positive(self, "frequency")


def make_desired_trajectory(trajectory: Step | Sinusoid) -> LinearSystem:
    """Return the trajectory, m, as a continuous linear system without input."""
    if isinstance(trajectory, Step):
        dynamics, initial = np.zeros((1, 1)), np.array([trajectory.amplitude])
    else:
        w = trajectory.frequency
        dynamics, initial = np.array([[0.0, w], [-w, 0.0]]), np.array([0.0, trajectory.amplitude])
    n = len(initial)
    source = LinearSystem(A=dynamics, B=np.zeros((n, 0)), C=np.eye(1, n), D=np.zeros((1, 0)))
    source.configure_default_state(initial)
    source.set_name("desired trajectory")
    return source
