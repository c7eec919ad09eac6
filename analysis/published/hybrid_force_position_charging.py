"""Limits of the thesis for each mode of charging a crucible (section 1.1.2, appendix C)."""

from typing import Final

from chamfer.analysis.published.rows import at_least, at_most, near, of, specified
from chamfer.analysis.report.checks import Published

_SPECIFIED: Final = "section 1.1.2"
_ASSUMED: Final = "the arm's masses, friction and gains, and the cell, are not published"

# Each is of the worst item of the plan; the metric's note has all of them.

# fmt: off
CHARGING: Final[tuple[Published, ...]] = of("crucible-charging", *specified(
    near("acquire.descent_speed", 0.15, 0.02, "m/s", _SPECIFIED,
         "the thesis gives no tolerance, 0.02 m/s is assumed"),
    at_most("acquire.grip_force", 20.0, "N", _SPECIFIED, _ASSUMED),
    near("acquire.lift_speed", 0.15, 0.02, "m/s", _SPECIFIED,
         "the thesis gives no tolerance, 0.02 m/s is assumed"),
    at_most("scan.speed_error", 0.001, "m/s", _SPECIFIED,
            "a constant 3 cm/s; the thesis gives no tolerance, 1 mm/s is assumed"),
    at_most("scan.position_error", 0.0005, "m", _SPECIFIED, _ASSUMED),
    near("slew.time", 2.5, 0.1, "s", _SPECIFIED,
         "the thesis gives no tolerance, 0.1 s is assumed"),
    at_most("slew.position_error", 0.01, "m", _SPECIFIED, _ASSUMED),
    at_least("slew.clearance", 0.0, "m", _SPECIFIED, _ASSUMED),
    at_most("wall.approach_speed", 0.1, "m/s", _SPECIFIED, _ASSUMED),
    at_most("wall.slide_force", 2.0, "N", _SPECIFIED, _ASSUMED),
    at_most("wall.losses", 0.0, "", _SPECIFIED, _ASSUMED),
    at_most("wall.peak_force", 2.0, "N", _SPECIFIED,
            "stated for the slide; here for all contact with wall and layer, until release; the "
            "5 N of section C.1, which scratch, are above it"),
    at_most("wall.layer_shift", 0.0005, "m", _SPECIFIED,
            "without disturbing the layer below; no tolerance is given, 0.5 mm is assumed"),
    at_most("wall.impact_speed", 0.2, "m/s", "section C.2",
            "less than half of the damaging speed, 0.44 m/s and more"),
    at_most("wall.position_error", 0.01, "m", _SPECIFIED,
            "a designated location; no tolerance is given, that of bulk filling is assumed"),
    at_most("crown.layer_shift", 0.0005, "m", _SPECIFIED,
            "like wall building, without wall contact; 0.5 mm is assumed"),
    at_most("crown.peak_force", 2.0, "N", _SPECIFIED,
            "like wall building; stated for the slide along the wall, here for the set-down"),
    at_most("crown.impact_speed", 0.2, "m/s", "section C.2", _ASSUMED),
    at_most("crown.position_error", 0.01, "m", _SPECIFIED,
            "a designated location; no tolerance is given, that of bulk filling is assumed"),
    at_most("bulk.position_error", 0.01, "m", _SPECIFIED, _ASSUMED)))

# Of the cycle as a whole, and of each remedy's randomised cycles.
CYCLES: Final[tuple[Published, ...]] = (
    *of("crucible-charging", *specified(
        at_least("cycle.placed_share", 100.0, "%", _SPECIFIED,
                 "of the plan, within 1 cm of its place; a cycle that stops lacks the rest"))),
    *of("charging-campaign", *specified(*(
        at_least(f"{remedy}.cycle.all_limits", 100.0, "%", _SPECIFIED,
                 "share of the cycles; the metrics have each limit by itself")
        for remedy in ("none", "decoupling", "compensation", "soft_gripper", "all",
                       "no_observer")))),
)
