"""The computed border of the damping against simulations of blocks and bodies."""

from dataclasses import replace
from typing import Final

import pytest

from chamfer.analysis.insertion.admittance_stability import (
    CONTACT_STABILITY,
    computed_border,
    damped,
    grows,
)
from chamfer.systems.force.accommodation_law import AXES

RCC: Final = {"centre": 0.08, "stiffness": (300.0, 300.0, 200.0, 5e4, 5e4, 1e5)}


@pytest.mark.parametrize(
    ("axis", "share", "wrist"),
    [("x", 1.0, {}), ("x", 0.003, {}), ("ry", 1.0, {}), ("z", 0.1, RCC), ("ry", 1.0, RCC)],
    ids=["x stiff", "x soft", "tilt", "lateral with an rcc", "tilt with an rcc"],
)
def test_border_within_a_tenth(axis: str, share: float, wrist: dict[str, object]) -> None:
    loop = CONTACT_STABILITY.loop
    loop = replace(
        loop,
        wrist=replace(loop.wrist, **wrist),  # type: ignore[arg-type]
        contact=tuple(share * k for k in loop.contact),
    )
    i = AXES.index(axis)
    edge = damped(loop, i, computed_border(loop, i))
    for off, unstable in ((0.9, True), (1.1, False)):
        grew = grows(damped(edge, i, off), i, duration=0.4, step=5e-4)
        assert grew is unstable, (off, edge.damping[i])
