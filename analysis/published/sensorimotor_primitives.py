"""Results that Morrow, Nelson and Khosla print, and this project's targets."""

import math
from typing import Final

from chamfer.analysis.published.rows import at_least, at_most, near, of, specified
from chamfer.analysis.report.checks import Published

TITLE: Final = (
    "J. D. Morrow, B. J. Nelson, P. K. Khosla: Vision and force driven sensorimotor primitives "
    "for robotic assembly skills"
)

# Target of the success rate of campaigns, %.
_SUCCESS: Final = {
    "d-connector-success": 98.0,
    "bnc-connector-success": 98.0,
    "peg-skill-success": 98.0,
    "rj45-connector-success": 95.0,
}

_CONNECTORS: Final = ("d-connector", "bnc-connector", "rj45-connector")

# fmt: off
PUBLISHED: Final[tuple[Published, ...]] = (
    *of("correlation",
        near("correlation.free", math.pi**2 / 8, 0.001, "",
             "section 3.2, eq. (1): two fully correlated sinusoids",
             "the limit of many samples; 100 samples of a cycle give 1.2345", kind="predicted")),
    *of("lissajous",
        near("repeats_after", 0.0, 1e-9, "m",
             "section 2: N cycles of the slower sine wave before the pattern repeats",
             "distance of the tool from its place N cycles before, the largest of all N",
             kind="predicted")),
    *of("vision-primitives", *(
        at_least(f"{primitive}.converged", 100.0, "%",
                 "section 3.1: positioning with poorly-calibrated camera/robot systems",
                 "the paper prints no numbers; 20 % of focal lengths and 10 degrees are assumed")
        for primitive in ("translation", "rotation", "fixed_point", "grasp"))),
    *(row for connector in ("d", "bnc") for row in of(f"{connector}-connector",
        at_least("success", 1.0, "", "abstract: successfully applied to two connector insertions",
                 "all parameters are assumed, the paper prints none"))),
    *(row for name, aim in _SUCCESS.items() for row in of(name,
        at_least("success_rate", aim, "%", "target of this project",
                 "the paper prints no rate; the drawn errors are assumed"),
        at_most("false_done", 0.0, "%", "target of this project",
                "the skill reports done, and the plug is not mated"),
        at_most("force.peak_share", 1.5, "", "target of this project",
                "as a share of each run's assumed mating force; the paper prints no forces"))),
    *(row for name in ("skill", "peg-skill", *_CONNECTORS, *_SUCCESS) for row in of(name,
        *specified(
            at_most("force.share", 100.0, "%", "limit of the parts",
                    "of connector.largest_force, assumed; along any axis at any step"),
            at_most("torque.share", 100.0, "%", "limit of the parts",
                    "of connector.largest_torque, assumed; about any axis at any step")))),
)
