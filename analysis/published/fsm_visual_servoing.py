"""Published values of Ruybal, Lumia and Wood: the simulated loops and the wedging diagram."""

from typing import Final

from chamfer.analysis.published.fsm_work_cell import WORK_CELL
from chamfer.analysis.published.rows import at_least, at_most, near, of
from chamfer.analysis.report.checks import Published

TITLE: Final = (
    "K. R. Ruybal, R. Lumia, J. E. Wood: A finite state machine approach to visual servoing to "
    "increase positional accuracy of impedance controlled robots"
)
RISE_TIME: Final = 0.00888  # s, Fig. 8
OVERSHOOT: Final = 10.5  # %, Fig. 8

_ZERO_DC_GAIN = (
    "zero DC gain from force to velocity: a level needs an increment in every tick, and an error "
    "that causes it"
)
_ASSUMED_SINUSOID = "frequency (1 rad/s) and feedforward are assumed, the paper prints neither"

# fmt: off
PUBLISHED: Final[tuple[Published, ...]] = (
    *of("step-response",
        near("pid.rise_time", RISE_TIME, 1e-05, "s", "section 3, Fig. 8",
             "mass and damping are identified from rise time and overshoot"),
        near("pid.overshoot", OVERSHOOT, 0.05, "%", "section 3, Fig. 8",
             "relative to the final value; relative to the step it is 7.1 %"),
        at_least("pid.steady_state_error", 0.005, "m",
                 "section 3, Fig. 8: settles with some steady-state error",
                 "k/(k + I), 3.1 % of the step; the bound is above the camera's resolution",
                 kind="predicted"),
        near("fsm.overshoot", 0.0, 0.5, "%", "section 3, Fig. 8",
             "increment and thresholds are not published, they follow from the settling theorem"),
        at_most("fsm.error_max", 0.005, "m",
                "section 3, Fig. 8: none within the camera's resolution",
                "the largest error in the last fifth; a mean would hide an oscillation"),
        at_least("fsm.rise_time", RISE_TIME, "s", "section 3, Fig. 8: slower than the PID"),
        at_least("fsm.slope_ratio", 2.0, "",
                 "section 3, Fig. 8: the slope changes where the error becomes small",
                 "5 with the divider of Fig. 4, once the plant has followed"),
        at_most("fsm_velocity.error_max", 0.01, "m",
                "section 3: no steady-state error, on the plant said to be simulated",
                _ZERO_DC_GAIN, otherwise="does_not_hold"),
        near("fsm_velocity.overshoot", 0.0, 0.5, "%",
             "section 3, Fig. 8, on the plant said to be simulated",
             f"relative to the final value, below the step; {_ZERO_DC_GAIN}",
             otherwise="does_not_hold")),
    *of("sinusoid-response",
        at_most("error_rms_ratio", 1.0, "", "section 3, Fig. 9: FSM better in steady state",
                _ASSUMED_SINUSOID),
        at_least("transient_error_ratio", 1.0, "",
                 "section 3, Fig. 9: PID slightly better in the transient", _ASSUMED_SINUSOID),
        at_most("error_rms_ratio_compensation", 1.0, "",
                "section 3, Fig. 9, the plant driven by the compensation alone",
                "increments that settle can't follow 1 rad/s; frequency and increments are "
                "assumed. They follow slower sinusoids, see the frequencies in the figure"),
        at_most("error_rms_ratio_velocity", 1.0, "",
                "section 3, Fig. 9, on the plant said to be simulated", _ZERO_DC_GAIN,
                otherwise="does_not_hold")),
    *of("fsm-stability",
        at_least("pid.phase_margin", 0.0, "deg", "section 3: tuned for stability"),
        at_least("increment.tarraf_properties", 3, "",
                 "section 3: meets all of Tarraf's three properties",
                 "true of the increment as the output", kind="predicted"),
        at_least("compensation.tarraf_properties", 3, "",
                 "section 3: meets all of Tarraf's three properties",
                 "the accumulated compensation keeps any stored level without input, and two "
                 "levels never merge; for the closed loop the settling theorem replaces the "
                 "claim", kind="predicted", otherwise="does_not_hold"),
        at_least("gore_criteria", 2, "", "section 3: meets Gore's two criteria",
                 "Fig. 3 as drawn; the chart that runs does a lap in one tick and never returns "
                 "to its initial state (folded.gore_criteria)",
                 kind="predicted")),
    *of("wedging-diagram",
        near("clearance_ratio", 0.0255107, 5e-08, "", "section 4", kind="predicted"),
        near("rotation_limit", 0.05817, 5e-06, "rad", "section 4", kind="predicted"),
        near("lateral_limit", 0.019814, 5e-07, "m", "section 4",
             "r + R, where the discs cease to overlap; a peg enters as far as its chamfer reaches",
             kind="predicted"),
        near("published_worst.box_margin.rotation", 31, 0.5, "%",
             "section 5: at least 31 % margin in rotation", "to the limit of the rotation alone",
             kind="predicted"),
        near("published_worst.box_margin.lateral", 84, 0.5, "%",
             "section 5: 84 % margin in translation", "to the limit of the lateral error alone",
             kind="predicted"),
        at_least("published_worst.parallelogram_margin", 31, "%",
                 "section 5: at least 31 % with respect to the wedging diagram",
                 "31 % is the margin to a box; the diagram of Fig. 2 has sloped sides. With "
                 "errors of one sign and the compliance centre where the sides are steepest, "
                 "less remains", kind="predicted", otherwise="does_not_hold"),
        at_least("published_worst.exact_margin", 0, "%",
                 "section 5: met the alignment goals with respect to the wedging diagram",
                 "with the exact sides and the compliance centre that leaves least",
                 kind="predicted")),
    *of("insertion-map",
        at_most("predicted_safe.failed", 0, "",
                "sections 2 and 5: inside the wedging limits the peg assembles",
                "by the errors at touch; checked with at least 240 cells, which points=21 has",
                kind="predicted"),
        at_least("agreement", 90, "%",
                 "sections 2 and 5: inside the wedging limits the peg assembles",
                 "the project's target, without the cells that may wedge by prediction; the "
                 "joints' friction, which theory ignores, moves a peg on the mouth's edge",
                 kind="predicted")),
    *WORK_CELL,
)
