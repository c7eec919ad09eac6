"""What the thesis on hybrid position/force control prints about its runs."""

from typing import Final

from chamfer.analysis.published.hybrid_force_position_charging import CHARGING
from chamfer.analysis.published.hybrid_force_position_observer import OBSERVER
from chamfer.analysis.report.checks import Published

TITLE: Final = (
    "J. A. Calzaretta: Delicate manipulation of irregularly-shaped rigid objects in a stiff, "
    "fragile environment (thesis, MIT, 1998), on hybrid position/force control"
)

_ASSUMED_PUMA = "masses, friction, contact and gains of the Puma are not published"
_ASSUMED_ADEPT = "masses, friction, contact and gains of the Adept are not published"
_LATE = (
    "the arm lags in the approach: its gains are those that give two centimeters of error in "
    "motion, and stiffer ones that are in time give a few millimeters"
)
_ASSUMED_PLANAR = "gains, friction and contact stiffness are not published"


def _contact(
    experiment: str, time: float, tolerance: float, source: str, note: str = ""
) -> Published:
    return Published(
        experiment=experiment,
        metric="contact_time",
        relation="near",
        value=time,
        tolerance=tolerance,
        unit="s",
        kind="predicted" if experiment.startswith("planar") else "calibrated",
        source=source,
        note=note,
    )


def _force(experiment: str, force: float, tolerance: float, source: str) -> Published:
    return Published(
        experiment=experiment,
        metric="force.final",
        relation="near",
        value=force,
        tolerance=tolerance,
        unit="N",
        kind="predicted" if experiment.startswith("planar") else "calibrated",
        source=source,
        note="integral action",
    )


def _near(
    experiment: str,
    metric: str,
    value: float,
    tolerance: float,
    unit: str,
    source: str,
    note: str,
) -> Published:
    return Published(
        experiment=experiment,
        metric=metric,
        relation="near",
        value=value,
        tolerance=tolerance,
        unit=unit,
        kind="calibrated",
        source=source,
        note=note,
    )


def _keeps_contact(experiment: str, source: str, note: str) -> Published:
    return Published(
        experiment=experiment,
        metric="force.min",
        relation="at_least",
        value=0.0,
        unit="N",
        kind="calibrated",
        source=source,
        note=note,
    )


PUBLISHED: Final[tuple[Published, ...]] = (
    _contact("planar-hold", 4.5, 0.1, "section 2.2, Fig. 2-5", "1.5 m at 0.33 m/s"),
    _force("planar-hold", 15.0, 0.05, "section 2.2, Fig. 2-5"),
    Published(
        experiment="planar-hold",
        metric="force.peak",
        relation="at_least",
        value=30.0,
        unit="N",
        kind="calibrated",
        source="section 2.2, Fig. 2-5: a large initial force spike",
        note="asked for is twice the desired force; it grows with the root of the stiffness",
    ),
    _contact("planar-slide", 4.5, 0.1, "section 2.2, Fig. 2-6", "1.5 m at 0.33 m/s"),
    _near(
        "planar-slide",
        "force.deviation",
        0.5,
        0.1,
        "N",
        "section 2.2, Fig. 2-6: approximately 0.5",
        _ASSUMED_PLANAR,
    ),
    _near(
        "planar-slide-late",
        "force.deviation",
        0.5,
        0.1,
        "N",
        "section 2.2, Fig. 2-6: approximately 0.5",
        "of a torque in time; here it is one sample late, with other gains",
    ),
    Published(
        experiment="planar-slide-late",
        metric="position.lag_error",
        relation="at_most",
        value=0.003,
        unit="m",
        kind="calibrated",
        source="section 2.2, Fig. 2-6: about 0.003",
        note="of a torque in time; here it is one sample late, with other gains",
    ),
    _near(
        "planar-slide",
        "position.lag_error",
        0.003,
        0.0005,
        "m",
        "section 2.2, Fig. 2-6: about 0.003",
        "lag of Kd/Kp; the gains are not published",
    ),
    Published(
        experiment="planar-slide",
        metric="force.deviation",
        relation="at_most",
        value=0.75,
        unit="N",
        kind="calibrated",
        source="section 2.3: force errors below 5 %",
        note=_ASSUMED_PLANAR,
    ),
    Published(
        experiment="contact-recovery",
        metric="without_loss_mode.growth_at_5",
        relation="at_least",
        value=1.0,
        unit="",
        kind="calibrated",
        source="section 2.1.4: retreats faster than before",
        note="true of force integrals above growth_threshold only",
    ),
    Published(
        experiment="contact-recovery",
        metric="without_loss_mode.growth_at_2",
        relation="at_least",
        value=1.0,
        unit="",
        kind="calibrated",
        source="section 2.1.4: retreats faster than before",
        note="below growth_threshold the bounces decay by themselves",
        otherwise="does_not_hold",
    ),
    Published(
        experiment="contact-recovery",
        metric="recontact.speed",
        relation="at_most",
        value=0.2,
        unit="m/s",
        kind="calibrated",
        source="section 2.1.4: brings the manipulator back slowly; appendix C: 20 cm/s",
    ),
    Published(
        experiment="contact-recovery",
        metric="impact.speed",
        relation="at_most",
        value=0.2,
        unit="m/s",
        kind="predicted",
        source="appendix C: 20 cm/s",
        note="section 2.2 approaches at 0.33 m/s, beyond the thesis' own limit",
        otherwise="does_not_hold",
    ),
    _contact("puma-roller-hold", 1.5, 0.1, "section 3.1.3, Fig. 3-5", _ASSUMED_PUMA),
    _force("puma-roller-hold", 5.0, 0.25, "section 3.1.3, Fig. 3-5"),
    _contact("puma-roller-motion", 1.5, 0.1, "section 3.1.3, Fig. 3-6", _ASSUMED_PUMA),
    _force("puma-roller-motion", 5.0, 0.5, "section 3.1.3, Fig. 3-6"),
    _near(
        "puma-roller-motion",
        "force.deviation",
        5.0,
        1.0,
        "N",
        "section 3.1.3, Fig. 3-6: nearly 5 N",
        _ASSUMED_PUMA,
    ),
    _keeps_contact("puma-roller-motion", "section 3.1.3, Fig. 3-6: always nonzero", _ASSUMED_PUMA),
    Published(
        experiment="puma-roller-motion",
        metric="position.lag_error",
        relation="between",
        low=0.002,
        high=0.01,
        unit="m",
        kind="calibrated",
        source="section 3.1.3, Fig. 3-6: several millimeters",
        note=_ASSUMED_PUMA,
    ),
    _contact("puma-nugget-hold", 0.5, 0.1, "section 3.1.3, Fig. 3-7", _LATE),
    _force("puma-nugget-hold", 5.0, 0.25, "section 3.1.3, Fig. 3-7"),
    _contact("puma-nugget-motion", 1.0, 0.1, "section 3.1.3, Fig. 3-8", _LATE),
    _force("puma-nugget-motion", 5.0, 0.5, "section 3.1.3, Fig. 3-8"),
    _near(
        "puma-nugget-motion",
        "force.above",
        7.0,
        1.5,
        "N",
        "section 3.1.3, Fig. 3-8",
        _ASSUMED_PUMA,
    ),
    _near(
        "puma-nugget-motion",
        "force.below",
        -5.0,
        1.0,
        "N",
        "section 3.1.3, Fig. 3-8",
        _ASSUMED_PUMA,
    ),
    _near(
        "puma-nugget-motion",
        "position.lag_error",
        0.02,
        0.005,
        "m",
        "section 3.1.3, Fig. 3-8: up to two centimeters",
        "with softer gains than the roller test: no one set gives both errors",
    ),
    _contact("adept-roller-hold", 6.0, 0.1, "section 3.2.3, Fig. 3-11", _ASSUMED_ADEPT),
    _force("adept-roller-hold", 20.0, 0.5, "section 3.2.3, Fig. 3-11"),
    _contact("adept-roller-motion", 1.8, 0.1, "section 3.2.3, Fig. 3-12", _ASSUMED_ADEPT),
    _force("adept-roller-motion", 20.0, 0.5, "section 3.2.3, Fig. 3-12"),
    _near(
        "adept-roller-motion",
        "force.deviation",
        15.0,
        1.5,
        "N",
        "section 3.2.3, Fig. 3-12: up to 15 N",
        "stiction of the quill on a plate that is assumed to be tilted by 0.011 rad",
    ),
    _keeps_contact(
        "adept-roller-motion", "section 3.2.3, Fig. 3-12: always nonzero", _ASSUMED_ADEPT
    ),
    _near(
        "adept-roller-motion",
        "position.lag_error",
        0.005,
        0.001,
        "m",
        "section 3.2.3, Fig. 3-12: about 5 millimeters",
        _ASSUMED_ADEPT,
    ),
    _force("adept-nugget-hold", 5.0, 0.25, "section 3.2.3, Fig. 3-13"),
    _near(
        "adept-nugget-hold",
        "force.deviation",
        0.5,
        0.15,
        "N",
        "section 3.2.3, Fig. 3-13: approximately 0.5 N of sensor noise",
        _ASSUMED_ADEPT,
    ),
    Published(
        experiment="adept-nugget-hold",
        metric="position.lag_error",
        relation="at_most",
        value=2e-5,
        unit="m",
        kind="calibrated",
        source="section 3.2.3, Fig. 3-13: less than 0.02 millimeters",
        note="z is a regulator, decoupled from the other joints",
    ),
    _contact("adept-nugget-motion", 1.0, 0.1, "section 3.2.3, Fig. 3-14", _ASSUMED_ADEPT),
    _force("adept-nugget-motion", 5.0, 0.25, "section 3.2.3, Fig. 3-14"),
    _near(
        "adept-nugget-motion",
        "force.above",
        1.0,
        0.5,
        "N",
        "section 3.2.3, Fig. 3-14",
        "0.5 N of it is the sensor's noise; stick-slip of quill and arm makes up the rest",
    ),
    _near(
        "adept-nugget-motion",
        "force.below",
        -2.5,
        0.5,
        "N",
        "section 3.2.3, Fig. 3-14",
        _ASSUMED_ADEPT,
    ),
    _near(
        "adept-nugget-motion",
        "position.lag_error",
        0.002,
        0.0005,
        "m",
        "section 3.2.3, Fig. 3-14: within 2 mm",
        _ASSUMED_ADEPT,
    ),
    Published(
        experiment="wrist-contention",
        metric="force.deviation_ratio",
        relation="at_least",
        value=1.1,
        unit="",
        kind="calibrated",
        source="section 3.2.4, Fig. 3-15: the force suffers while the orientation is corrected",
        note="asked for is 10 % more deviation; contact beside the wrist's axis is assumed",
    ),
    Published(
        experiment="friction-remedies",
        metric="roller.rubber_ratio",
        relation="between",
        low=0.5,
        high=2.0,
        unit="",
        kind="calibrated",
        source="section 3.2.4: qualitatively similar on a rubber-covered plate",
        note="here the deviation is stiction times tilt and stiffness, and rubber yields; the "
        "thesis' disturbance must have other causes too",
    ),
    Published(
        experiment="friction-remedies",
        metric="roller.gain_without_friction",
        relation="at_least",
        value=2.0,
        unit="",
        kind="calibrated",
        source="section 3.3: performance degrades largely by joint friction",
        note="asked for is half the deviation without it",
    ),
    Published(
        experiment="friction-remedies",
        metric="nugget.gain_without_friction",
        relation="at_least",
        value=2.0,
        unit="",
        kind="calibrated",
        source="section 3.3: performance degrades largely by joint friction",
        note="asked for is half the deviation without it",
    ),
    Published(
        experiment="hybrid-stability",
        metric="positive.inverse.growth",
        relation="at_most",
        value=0.01,
        unit="1/s",
        kind="calibrated",
        source="section 2.1.3: both schemes can be shown to be stable under PD control",
        note="true of position control alone; with a selection the Jacobian inverse can turn "
        "feedback around (An and Hollerbach, 1987)",
        otherwise="does_not_hold",
    ),
    Published(
        experiment="hybrid-stability",
        metric="positive.transpose.growth",
        relation="at_most",
        value=0.01,
        unit="1/s",
        kind="calibrated",
        source="section 2.1.3: both schemes can be shown to be stable under PD control",
    ),
    *OBSERVER,
    *CHARGING,
)
