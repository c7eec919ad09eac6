"""The loads of an insertion in the cell, as the jamming diagram wants them."""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.analysis.insertion.cell_runs import errors_in_planes
from chamfer.analysis.insertion.insertion_runs import median
from chamfer.analysis.scenario.experiment import Table
from chamfer.models.peg.peg_and_hole import PegAndHole
from chamfer.models.peg_theory.wedging import jamming_level
from chamfer.systems.contact.peg_hole_contact_monitor import ContactState

Array = NDArray[np.float64]

_PUSHED: Final = 0.05  # N, the least push whose direction says something
_IN_BORE: Final = (ContactState.ONE_POINT, ContactState.TWO_POINT, ContactState.SEATED)


class Loads(NamedTuple):
    """Loads of the support on the peg in one plane, a row a moment."""

    time: Array  # s
    depth: Array  # l, m
    force_ratio: Array  # F_x / F_z
    moment_ratio: Array  # M / (r F_z)
    level: Array  # in the diagram, 1 on its sides

    @property
    def size(self) -> int:
        """How many there are."""
        return len(self.time)


def loads_in_planes(traces: Table, parts: PegAndHole, step: float) -> dict[str, Loads]:
    """Return the loads in the planes XY and XZ while the peg is pushed in the bore.

    They are what the hole does to the peg, reversed, as medians of 10 ms; the moment is about the
    middle between the tip's corners.
    """
    down = -median(traces["force_x"], step)
    turning = {"xy": -median(traces["moment_z"], step), "xz": median(traces["moment_y"], step)}
    l_of = traces["depth"] - parts.chamfer_height
    pushed = np.isin(traces["contact_state"], _IN_BORE) & (down > _PUSHED) & (l_of > 0)
    height = parts.peg_chamfer.height
    found = {}
    for plane, (lateral, tilt) in errors_in_planes(traces).items():
        across = -median(traces[f"force_{plane[1]}"], step)
        x, y = traces["depth"] - height * np.cos(tilt), lateral + height * np.sin(tilt)
        moment = turning[plane] - (x * across - y * down)
        force_ratio = across[pushed] / down[pushed]
        moment_ratio = moment[pushed] / (parts.peg_radius * down[pushed])
        level = jamming_level(parts, force_ratio, moment_ratio, l_of[pushed])
        found[plane] = Loads(
            traces["time"][pushed], l_of[pushed], force_ratio, moment_ratio, level
        )
    return found
