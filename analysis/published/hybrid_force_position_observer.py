"""Published results of the thesis on hybrid control for its observer, chapters 4 and 5."""

from typing import Final, NamedTuple

from chamfer.analysis.published.rows import at_least, at_most, near, of
from chamfer.analysis.report.checks import Published

_CALIBRATED = (
    "sample time, multiple of the standard deviation and initial covariance are not published; "
    "T = 0.05 s, 3 standard deviations and 0.1 rad fit Figs. 5-3 to 5-6 together"
)


class ForceRange(NamedTuple):
    """A force and the limits that it keeps, N."""

    desired: float
    low: float
    high: float


FIG_5_8_FORCE: Final = ForceRange(desired=5.0, low=4.5, high=5.2)
FIG_5_8_BAND: Final = 6.0  # deg, approximately

_HONEST = "section 5.2.2: tracks at least as well as the covariance predicts"
_SUITE = (
    "on every surface that bends no sharper than observer.smallest_radius; the 95 % band is 2.80 "
    "standard deviations, that of a vector with three axes (4-9)"
)
_WALLS = (
    "the thesis proposes this run (section 6.3); the limits are those of section 5.3's Cartesian "
    "manipulator; gripper, gains and wall are this project's"
)
_GAINS = "mass, damping, gains and periods are not published"

# fmt: off
OBSERVER: Final[tuple[Published, ...]] = (
    *of("surface-estimation",
        near("band.equilibrium", 6.0, 0.3, "deg", "section 5.2.2, Fig. 5-3", _CALIBRATED),
        at_least("coverage", 99.0, "%",
                 "section 5.2.2, Fig. 5-3: tracks at least as well as the covariance predicts",
                 "the limit is 99 % of the errors within 3 standard deviations; their mean is not "
                 "zero: weights that depend on the sample bias the estimate by 2 degrees"),
        near("breakaway_time", 0.5, 0.05, "s",
             "section 5.2.2, Fig. 5-3: approximately 0.5 seconds",
             "until then the contact point sticks: K 0.2 t = mu K 0.1 at 0.5 s; the force is 10 "
             "N, not small", kind="predicted"),
        at_most("drift_after_halt", 0.5, "deg",
                "sections 4.4.1 and 5.2.2: the estimate stagnates when the contact point rests",
                "with noise the measured velocity is not zero, and the filter follows the noise;"
                " observer.kind=gated stagnates", otherwise="does_not_hold")),
    *of("surface-estimation-smooth",
        near("band.mean", 3.0, 0.3, "deg", "section 5.2.2, Fig. 5-4", _CALIBRATED),
        at_least("coverage", 99.0, "%", "section 5.2.2: has improved the accuracy significantly",
                 "the band is halved, the error is not. Q grows with the square of the sample time"
                 " as if the surface turned at random, so the band is narrower than the lag",
                 otherwise="does_not_hold")),
    *of("surface-estimation-noise-free",
        near("error.max", 0.0, 1e-06, "deg",
             "section 5.2.2, Fig. 5-5: exactly equal to the actual value", kind="predicted"),
        near("band.mean", 0.0, 1e-06, "deg",
             "section 5.2.2, Fig. 5-5: the uncertainty converges to zero", kind="predicted")),
    *of("surface-estimation-large-noise",
        near("band.final", 20.0, 0.5, "deg", "section 5.2.2, Fig. 5-6", _CALIBRATED),
        near("estimate.change", 0.0, 0.01, "deg",
             "section 5.2.2, Fig. 5-6: the data are never used",
             "true if the observer assumes a thousand times the true noise, not if the noise "
             "is large: velocity and normal force grow with it")),
    *of("unknown-surface-control",
        near("force.min", 4.5, 0.2, "N", "section 5.3.4, Fig. 5-8: between 4.5 and 5.2 Newtons",
             _GAINS),
        near("force.max", 5.2, 0.2, "N", "section 5.3.4, Fig. 5-8: between 4.5 and 5.2 Newtons",
             "an error e of the normal changes the force by mu e; the thesis shows one run only"),
        at_least("force.within_10", 100.0, "%",
                 "section 5.3.4: the force error is kept less than 10 %",
                 "share of the seeds; errors of the normal and the end of the transient count"),
        near("band.mean", 6.0, 0.5, "deg", "section 5.3.4, Fig. 5-8: approximately 6 degrees",
             "the scan may also be read as u_Fdot = 3 N/s, which gives 6.2 degrees")),
    *of("unknown-surface-control-noise-free",
        at_most("force.settling_time_10", 1.0, "s", "section 5.3.4, Fig. 5-9: within one second",
                _GAINS),
        near("force.final", 5.0, 0.05, "N", "section 5.3.4, Fig. 5-9: almost exactly 5 Newtons",
             "integral action, with a selection that turns with the surface", kind="predicted")),
    *of("unknown-surface-control-adaptive",
        at_least("force.within_10", 100.0, "%",
                 "section 5.3.4: the force error is kept less than 10 %",
                 "share of the seeds; the observer uses means of the force over its period")),
    *of("observer-comparison",
        at_most("adaptive.rms_ratio.worst", 1.0, "",
                "section 4.5: a nonlinear estimator can be more accurate with the same "
                "information",
                "rms error over that of the thesis' filter, on the worst of all surfaces"),
        at_most("adaptive.rms_ratio.worst_constant", 0.667, "",
                "section 4.5: a nonlinear estimator can be more accurate with the same "
                "information", "the same where friction is constant; the limit is two thirds"),
        at_least("adaptive.coverage.worst", 99.0, "%",
                 "section 5.2.2: tracks at least as well as the covariance predicts",
                 "share of the errors within 3 standard deviations, on the worst of all surfaces"),
        at_least("adaptive.coverage.whole_run", 98.0, "%", _HONEST, _SUITE),
        at_least("adaptive.coverage.worst_instant", 85.0, "%", _HONEST, _SUITE),
        at_least("adaptive.nees.least", 0.1, "", _HONEST,
                 f"{_SUITE}; a more cautious band is useless"),
        at_most("adaptive.nees", 1.6, "", _HONEST, _SUITE),
        at_most("adaptive.rms_ratio.mixture", 1.2, "", _HONEST,
                "cost of the band on the slides of all observers, over the mixture alone"),
        at_most("adaptive.cost", 100.0, "us", "section 4.3: recursive, in real time",
                "the limit is 100 us of processor time for each update"),
        at_most("vision.rms_ratio.worst", 1.0, "",
                "section 4.5: a predicted surface decreases Q and helps convergence",
                "the thesis' filter, gated and weighted by the prior, with a camera that sees 80"
                " % of the curvature")),
    # The limits of the manipulator of section 5.3, for each arm.
    *(row for arm in ("adept", "puma", "planar") for row in of(f"{arm}-unknown-wall",
            at_least("force.min", FIG_5_8_FORCE.low, "N", "section 5.3.4, Fig. 5-8", _WALLS),
            at_most("force.max", FIG_5_8_FORCE.high, "N", "section 5.3.4, Fig. 5-8",
                    f"{_WALLS}. Counted again from a second after the return; "
                    "the Puma's integral then still swings"),
            at_most("force.settling_time_10", 1.0, "s", "section 5.3.4, Figs. 5-8 and 5-9",
                    _WALLS),
            at_most("band.mean", FIG_5_8_BAND, "deg", "section 5.3.4, Fig. 5-8", _WALLS),
            at_least("coverage", 99.0, "%",
                     "section 5.2.2: tracks at least as well as the covariance predicts",
                     f"{_WALLS}. Errors within 3 standard deviations"))
    ),
)
