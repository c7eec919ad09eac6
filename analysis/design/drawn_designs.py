"""Cells as they may be asked for: parts, arms and cameras of drawn sizes."""

import math
from dataclasses import dataclass, replace
from typing import Final, get_args

import numpy as np

from chamfer.analysis.design.design_scenario import FEWEST, DesignScenario
from chamfer.diagrams.cell.work_cell import HoleKind
from chamfer.diagrams.insertion.insertion import FEED_SPEED
from chamfer.models.validation import ParameterError, require_one_of, require_positive

_MOST: Final = 10_000
_DEPTH: Final = 3.5  # of the hole's radius, that the tip is to go

_LENGTHS: Final = ("chamfer_width", "peg_length", "hole_length", "outer_radius")

Range = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class DrawnDesignsScenario:
    """Which designs are drawn, and how often each is simulated.

    Lengths of the parts go with their radius as the default ones do, the turning stiffness with
    the root of the stiffness, and all cameras see as much as the default ones.
    """

    designs: int = 20  # that are drawn
    trials: int = 4  # simulated insertions of each
    draws: int = 200  # of errors, for each prediction
    radius: Range = (0.0015, 0.015)  # m, of the hole, evenly in its logarithm
    clearance: Range = (0.005, 0.05)  # radial, over the hole's radius, likewise
    friction: Range = (0.1, 0.6)  # between peg and hole, evenly
    stiffness: Range = (100.0, 5000.0)  # N/m, of the arms, evenly in its logarithm
    width: Range = (160.0, 1280.0)  # pixels, of the cameras, likewise
    hole: HoleKind = "arm"  # what holds the hole; or fixture
    duration: float = 30.0  # s, that an insertion may last

    def __post_init__(self) -> None:
        for name, least in (("designs", 1), ("trials", 1), ("draws", FEWEST)):
            if not least <= getattr(self, name) <= _MOST:
                raise ParameterError(name, getattr(self, name), f"{least} to {_MOST}")
        for name in ("radius", "clearance", "friction", "stiffness", "width"):
            low, high = getattr(self, name)
            if not (0 < low <= high < math.inf):
                allowed = "two finite numbers > 0, the lower one first"
                raise ParameterError(name, getattr(self, name), allowed)
        if not self.clearance[1] < 1:
            raise ParameterError("clearance", self.clearance, "less than 1")
        require_one_of(self, "hole", get_args(HoleKind))
        require_positive(self, "duration")

    def sizes(self, seed: int, design: int) -> dict[str, float]:
        """Return what is drawn of one of a seed's designs, in the fields' units."""
        generator = np.random.default_rng([seed, design])

        def logarithmic(ends: Range) -> float:
            return float(np.exp(generator.uniform(*np.log(ends))))

        return {
            "radius": logarithmic(self.radius),
            "clearance": logarithmic(self.clearance),
            "friction": float(generator.uniform(*self.friction)),
            "stiffness": logarithmic(self.stiffness),
            "width": round(logarithmic(self.width)),
        }

    def drawn(self, seed: int, design: int) -> DesignScenario:
        """Return one of a seed's designs, not resolved.

        Raises:
            ParameterError: If there can be no such design.
        """
        sizes = self.sizes(seed, design)
        radius, stiffness, width = sizes["radius"], sizes["stiffness"], int(sizes["width"])
        default = DesignScenario()
        parts = replace(
            default.parts,
            hole_radius=radius,
            peg_radius=radius * (1 - sizes["clearance"]),
            friction=sizes["friction"],
            **{
                name: getattr(default.parts, name) / default.parts.hole_radius * radius
                for name in _LENGTHS
            },
        )
        impedance, hole, cameras = default.impedance, default.hole, default.cameras
        stiffer = math.sqrt(stiffness / impedance.stiffness[0])
        about = [stiffer * one for one in impedance.rotational_stiffness]
        seen = cameras.width * cameras.pixel_size
        steps = math.ceil(FEED_SPEED * impedance.period / (2 * parts.clearance))
        return replace(
            default,
            parts=parts,
            impedance=replace(
                impedance,
                stiffness=(stiffness,) * 3,
                rotational_stiffness=(about[0], about[1], about[2]),
            ),
            hole=replace(hole, kind=self.hole),
            cameras=replace(
                cameras, width=width, height=round(0.75 * width), pixel_size=seen / width
            ),
            insert=replace(default.insert, speed=FEED_SPEED, depth=_DEPTH * radius),
            step=impedance.period / steps,
            duration=self.duration,
            draws=self.draws,
        )
