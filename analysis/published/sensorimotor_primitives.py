"""What Morrow, Nelson and Khosla print."""

import math
from typing import Final

from chamfer.analysis.report.checks import Published

TITLE: Final = (
    "J. D. Morrow, B. J. Nelson, P. K. Khosla: Vision and force driven sensorimotor primitives "
    "for robotic assembly skills"
)

# Of campaigns, the rate of success that we ask for, %.
_SUCCESS: Final = {
    "d-connector-success": 98.0,
    "bnc-connector-success": 98.0,
    "peg-skill-success": 98.0,
    "rj45-connector-success": 95.0,
}

PUBLISHED: Final[tuple[Published, ...]] = (
    Published(
        experiment="correlation",
        metric="correlation.free",
        relation="near",
        value=math.pi**2 / 8,
        tolerance=0.001,
        unit="",
        kind="predicted",
        source="section 3.2, eq. (1): two fully correlated sinusoids",
        note="the limit of many samples; 100 samples of a cycle give 1.2345",
    ),
    Published(
        experiment="lissajous",
        metric="repeats_after",
        relation="near",
        value=0.0,
        tolerance=1e-9,
        unit="m",
        kind="predicted",
        source="section 2: N cycles of the slower sine wave before the pattern repeats",
        note="how far from where it began the tool is after N cycles, the largest of all N",
    ),
    *(
        Published(
            experiment="vision-primitives",
            metric=f"{primitive}.converged",
            relation="at_least",
            value=100.0,
            unit="%",
            kind="calibrated",
            source="section 3.1: positioning with poorly-calibrated camera/robot systems",
            note="the paper says no numbers: 20 % of the focal lengths and 10 degrees are assumed",
        )
        for primitive in ("translation", "rotation", "fixed_point", "grasp")
    ),
    *(
        Published(
            experiment=f"{connector}-connector",
            metric="success",
            relation="at_least",
            value=1.0,
            unit="",
            kind="calibrated",
            source="abstract: successfully applied to two connector insertions",
            note="all parameters are assumed, the paper prints none",
        )
        for connector in ("d", "bnc")
    ),
    *(
        Published(
            experiment=name,
            metric="success_rate",
            relation="at_least",
            value=aim,
            unit="%",
            kind="calibrated",
            source="our aim",
            note="the paper prints no rate; the errors of its worlds are assumed",
        )
        for name, aim in _SUCCESS.items()
    ),
    *(
        Published(
            experiment=name,
            metric="false_done",
            relation="at_most",
            value=0.0,
            unit="%",
            kind="calibrated",
            source="our aim",
            note="of a plug that is said to be mated and is not",
        )
        for name in _SUCCESS
    ),
    *(
        Published(
            experiment=name,
            metric="force.peak_share",
            relation="at_most",
            value=1.5,
            unit="",
            kind="calibrated",
            source="our aim",
            note="the paper prints no forces; of each run's mating force, assumed too",
        )
        for name in _SUCCESS
    ),
)
