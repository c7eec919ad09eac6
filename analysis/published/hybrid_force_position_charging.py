"""What the thesis asks of each mode of charging a crucible (section 1.1.2, appendix C)."""

from typing import Final, Literal

from chamfer.analysis.report.checks import Published

_SPECIFIED = "section 1.1.2"
_ASSUMED = "the arm's masses, friction and gains, and the cell, are not published"


def _limit(
    metric: str,
    relation: Literal["at_most", "at_least"],
    value: float,
    unit: str,
    source: str = _SPECIFIED,
    note: str = _ASSUMED,
) -> Published:
    return Published(
        experiment="crucible-charging",
        metric=metric,
        relation=relation,
        value=value,
        unit=unit,
        kind="calibrated",
        source=source,
        note=note,
    )


def _near(metric: str, value: float, tolerance: float, unit: str) -> Published:
    return Published(
        experiment="crucible-charging",
        metric=metric,
        relation="near",
        value=value,
        tolerance=tolerance,
        unit=unit,
        kind="calibrated",
        source=_SPECIFIED,
        note=f"how near is not said, {tolerance:g} {unit} is assumed",
    )


# Each is of the worst item of the plan; the metric's note has all of them.
CHARGING: Final[tuple[Published, ...]] = (
    _near("acquire.descent_speed", 0.15, 0.02, "m/s"),
    _limit("acquire.grip_force", "at_most", 20.0, "N"),
    _near("acquire.lift_speed", 0.15, 0.02, "m/s"),
    _limit(
        "scan.speed_error",
        "at_most",
        1e-3,
        "m/s",
        note="a constant 3 cm/s; how constant is not said, 1 mm/s is assumed",
    ),
    _limit("scan.position_error", "at_most", 5e-4, "m"),
    _near("slew.time", 2.5, 0.1, "s"),
    _limit("slew.position_error", "at_most", 0.01, "m"),
    _limit("slew.clearance", "at_least", 0.0, "m"),
    _limit("wall.approach_speed", "at_most", 0.10, "m/s"),
    _limit("wall.slide_force", "at_most", 2.0, "N"),
    _limit("wall.losses", "at_most", 0.0, ""),
    _limit(
        "wall.peak_force",
        "at_most",
        2.0,
        "N",
        note="said of the slide; here of all contact with wall and layer, until it is let go",
    ),
    _limit(
        "wall.layer_shift",
        "at_most",
        5e-4,
        "m",
        note="without disturbing the layer below; how little is not said, 0.5 mm is assumed",
    ),
    _limit("wall.scratch_time", "at_most", 0.0, "s", "section C.1, sustained above 5 N"),
    _limit("wall.impact_speed", "at_most", 0.20, "m/s", "section C.2"),
    _limit("wall.impact_share", "at_most", 50.0, "%", "section C.2"),
    _limit(
        "wall.position_error",
        "at_most",
        0.01,
        "m",
        note="a designated location; how near is not said, that of bulk filling is assumed",
    ),
    _limit(
        "crown.layer_shift",
        "at_most",
        5e-4,
        "m",
        note="as wall building, without wall contact; 0.5 mm is assumed",
    ),
    _limit(
        "crown.peak_force",
        "at_most",
        2.0,
        "N",
        note="as wall building; said of the slide along the wall, here of the set-down",
    ),
    _limit("crown.scratch_time", "at_most", 0.0, "s", "section C.1, sustained above 5 N"),
    _limit("crown.impact_speed", "at_most", 0.20, "m/s", "section C.2"),
    _limit("crown.impact_share", "at_most", 50.0, "%", "section C.2"),
    _limit(
        "crown.position_error",
        "at_most",
        0.01,
        "m",
        note="a designated location; how near is not said, that of bulk filling is assumed",
    ),
    _limit("bulk.position_error", "at_most", 0.01, "m"),
)
