"""For every published value and every specification, what breaks it.

In one of three ways: a *scenario*, small as the entry's ``reduced`` is, with another setting; a
*fault*, the same with a wrong part of the program; *spoilt* arrays, given to the function that
measures them, where a run would take longer. What is undefined breaks nothing here: a check counts
as broken by a number alone.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, Final

import numpy as np
import pytest

from chamfer.analysis.campaign.campaign import Trials
from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.cell.alignment_runs import arm_limits
from chamfer.analysis.charging import charging_campaign
from chamfer.analysis.charging.charging_runs import LIMITS, Item, item_limits
from chamfer.analysis.charging.crucible_charging import placed
from chamfer.analysis.command.running import prepare
from chamfer.analysis.contact import friction_remedies
from chamfer.analysis.contact.contact_metrics import contact_metrics
from chamfer.analysis.insertion.insertion_map import FeedOutcome, confusion
from chamfer.analysis.measured import measured_slide
from chamfer.analysis.report.checks import check, load_paper
from chamfer.analysis.scenario.experiment import Entry, Metric, quiet, select
from chamfer.analysis.servo import fsm_stability
from chamfer.analysis.skills import lissajous
from chamfer.analysis.skills.connector_campaign import success_metrics
from chamfer.analysis.skills.insertion_metrics import INSERTION, insertion_metrics
from chamfer.analysis.surface import observer_comparison
from chamfer.analysis.surface.normal_metrics import tracking_metrics
from chamfer.analysis.surface.observer_band import BandSuite, band_metrics
from chamfer.analysis.surface.unknown_wall import wall_metrics
from chamfer.diagrams.cell.alignment_scenario import BY_SIGHT
from chamfer.models.arms.adept_wrist import ADEPT_WRIST
from chamfer.models.charging.packing import nugget_of
from chamfer.models.charging.station import Station
from chamfer.models.connectors.d_connector import DConnector
from chamfer.models.peg_theory.fed_insertion import FeedVerdict
from chamfer.systems.servo.compensator_law import make_compensator_chart

PUBLISHED: Final = tuple(
    one
    for paper in sorted({entry.paper for entry in CATALOGUE.entries})
    for one in load_paper(paper, CATALOGUE).published
)
ALL: Final = "all"  # checks of the experiment
_ARMS: Final = "saturated joints.margin"
_WEAK: Final = "impedance.torque_limits=[3, 3, 3, 3, 1, 1, 1]"
_FEW: Final = "trials=1; lead.halt=15; duration=20"

# fmt: off
# Experiment, settings beside the reduced ones, and the metrics whose checks they break.
SCENARIOS: Final = (
    ("wedging-diagram",
     "alignment=null; parts.peg_radius=0.00995; published_worst.lateral=0.01", ALL),
    ("step-response", "pid.integral=2e5; fsm.increment=0.5",
     "pid.rise_time pid.overshoot pid.steady_state_error fsm.overshoot fsm.error_max "
     "fsm_velocity.error_max fsm_velocity.overshoot"),
    ("step-response", "fsm.feedforward=true; plant.stiffness=1e5; plant.damping=500",
     "fsm.rise_time fsm.slope_ratio"),
    ("sinusoid-response", "desired.frequency=0.3", "transient_error_ratio"),
    ("sinusoid-response", "desired.frequency=20",
     "error_rms_ratio error_rms_ratio_compensation error_rms_ratio_velocity"),
    ("camera-accuracy",
     "cameras.distance=0.2; wide.peg.distance=0.02; wide.hole.distance=0.02", ALL),
    ("vertical-tracking", "peg.payload_error=0.5; motion_time=1; begin=1",
     "uncompensated.height_error compensated.height_error"),
    ("alignment", "initial_error=[0, 0.03, 0.02, 0, 0.09, 0.08]",
     "lateral_error rotational_error compensation.late_lateral_share "
     "compensation.late_rotational_share"),
    ("repeatability", "trials=1; begin=0.1; spread.lateral=0.04; spread.rotational=0.08",
     "lateral_error.mean lateral_error.max rotational_error.mean rotational_error.max"),
    ("camera-errors", "largest=0.3", ALL),
    ("insertion",
     f"decide.kind=at_once; initial_error=[0, 0, 0, 0, 0.09, 0.09]; begin=0.1; {_WEAK}",
     f"seated touch.rotational_error touch.margin {_ARMS}"),
    ("insertion-repeatability", "duration=0.3", "success_rate frozen.success_rate"),
    *((name, "cell=scara-rcc; insert.speed=0.002; compliance.most_axial=1e-5; duration=0.3",
       "compliance.deflection")
      for name in ("insertion", "insertion-repeatability")),
    ("planar-hold", "task.start=[1.0, -1.3]; task.speed=0.1; controller.force_integral=1",
     "contact_time force.final force.deviation force.peak contact.losses"),
    ("planar-slide", "controller.force_integral=1; task.amplitude=0.01",
     "contact_time force.deviation position.lag_error"),
    ("planar-slide-late",
     "controller.damping=20; controller.force_integral=1; task.amplitude=0.04",
     "force.deviation position.lag_error"),
    ("puma-roller-hold",
     "task.speed=0.1; task.force=8; controller.force_integral=0.2; surface.ripple=0.0005", ALL),
    ("puma-roller-motion",
     "task.speed=0.1; task.force=8; task.frequency=3; task.amplitude=0.1; surface.ripple=0.002",
     ALL),
    ("puma-roller-motion-soft", "task.amplitude=0.001", "force.deviation"),
    ("puma-nugget-hold", "task.speed=0.3; task.force=8", ALL),
    ("puma-nugget-motion", "task.speed=0.3; task.force=8; surface.friction.coefficient=0", ALL),
    ("adept-roller-hold", "task.speed=0.3; surface.stiffness=3e5; surface.damping=10", ALL),
    ("adept-roller-motion",
     "task.force=10; task.frequency=4; surface.tilt=0.05; surface.ripple=0.0005", ALL),
    ("adept-nugget-hold", "task.speed=0.4; task.force=8; task.amplitude=0.01", ALL),
    ("adept-nugget-motion", "task.speed=0.4; task.force=8", ALL),
    ("wrist-contention", "arm.contact_offset=[0, 0, 0]; duration=2.2", ALL),
    ("hybrid-stability", "controller.integral=1e5", ALL),
    ("contact-recovery",
     "task.start=[1.0, -1.4]; task.speed=0.33; task.kick_time=1.5; duration=1.8; "
     "measure_after=1; controller.loss_mode=false",
     "without_loss_mode.growth_at_5 without_loss_mode.growth_at_2 recontact.speed"),
    ("surface-estimation",
     f"{_FEW}; observer.smallest_radius=5; friction.coefficient=0.5", ALL),
    ("surface-estimation-smooth",
     f"{_FEW}; sensor.force_noise=3; sensor.force_rate_noise=30", ALL),
    ("surface-estimation-noise-free", "sensor.force_noise=1; sensor.force_rate_noise=5", ALL),
    ("surface-estimation-large-noise", "observer.force_noise=1; observer.force_rate_noise=5", ALL),
    ("unknown-surface-control", "trials=1; task.speed=2; controller.force_integral=0.2",
     "force.min force.max force.within_10 band.mean damage.scratch_time"),
    ("unknown-surface-control-noise-free",
     "task.depth=0.2; duration=3; controller.force_integral=0.6",
     "force.settling_time_10 force.final"),
    *((f"{arm}-unknown-wall",
       "observer.kind=thesis; sensor.noise=5; task.speed=0.3; task.slide_speed=0.2; "
       "task.kick_time=null; duration=3; measure_after=1",
       "force.min force.max band.mean damage.safe_speed_share")
      for arm in ("adept", "puma", "planar")),
    ("correlation", "dither.frequency=5", ALL),
    ("vision-primitives", "focal_error=0.9; orientation_error=1.5; duration=0.5", ALL),
    *((f"{name}-connector", "duration=1", "success") for name in ("d", "bnc")),
    *((f"{name}-success", "duration=1", "success_rate")
      for name in ("d-connector", "bnc-connector", "rj45-connector", "peg-skill")),
    ("measured-toss", "friction=0.6; tosses=6", "similar.same_face " + " ".join(
        f"{one}.travel {one}.position" for one in
        ("drake", "insertion", "connectors", "similar", "similar.fitted"))),
    ("measured-toss", "friction=0.1; settings=[connectors]", "connectors.rebound"),
)
# fmt: on


def named(experiment: str, breaks: str) -> set[str]:
    """Return the metrics of an experiment's checks that are told."""
    every = {one.metric for one in PUBLISHED if one.experiment == experiment}
    return every if breaks == ALL else set(breaks.split())


def broken(entry: Entry, metrics: Mapping[str, Metric]) -> set[str]:
    """Return the metrics that have a number which breaks one of their checks, and none else."""
    asked = [one for one in PUBLISHED if one.experiment == entry.name and one.metric in metrics]
    judged = check(asked, metrics)
    kept = {one.published.metric for one in judged if one.ok or one.measured is None}
    return {one.published.metric for one in judged} - kept


def measured(entry: Entry, told: str) -> Mapping[str, Metric]:
    """Return what the reduced run measures with settings, which go before its own."""
    settings = told.split("; ")
    paths = tuple(f"{one.partition('=')[0]}." for one in settings)
    reduced = [one for one in entry.reduced if not one.replace("=", ".").startswith(paths)]
    (job,) = prepare([entry], settings=[*reduced, *settings])
    return job.experiment.run(job.scenario, 0, quiet).metrics


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # what is broken is warned of
@pytest.mark.parametrize(("name", "settings", "breaks"), SCENARIOS)
def test_a_scenario_breaks_checks(name: str, settings: str, breaks: str) -> None:
    (entry,) = select(CATALOGUE.entries, [name])
    assert named(name, breaks) <= broken(entry, measured(entry, settings))


def stuck_compensator(patch: pytest.MonkeyPatch) -> None:
    """The increment depends on the compensation, and Fig. 3 is left within a lap."""
    whole = fsm_stability.axis_machine
    patch.setattr(fsm_stability, "axis_machine", lambda axis, **_: whole(axis, accumulated=True))
    patch.setattr(fsm_stability, "lap_chart", make_compensator_chart)


def wrong_ratio(patch: pytest.MonkeyPatch) -> None:
    """The faster dither is 1 % too fast."""
    right = lissajous.lissajous

    def wrong(**given: Any) -> Any:
        slow, fast = right(**given)
        return slow, replace(fast, frequency=1.01 * fast.frequency)

    patch.setattr(lissajous, "lissajous", wrong)


# fmt: off
FAULTS: Final = (
    ("fsm-stability", stuck_compensator, "pid.proportional=-600", ALL),
    ("lissajous", wrong_ratio, "frequency=1", ALL),
)
# fmt: on


@pytest.mark.slow
@pytest.mark.parametrize(("name", "fault", "setting", "breaks"), FAULTS)
def test_a_fault_breaks_checks(
    name: str,
    fault: Callable[[pytest.MonkeyPatch], None],
    setting: str,
    breaks: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    (entry,) = select(CATALOGUE.entries, [name])
    fault(monkeypatch)
    assert named(name, breaks) <= broken(entry, measured(entry, setting))


Values = Mapping[str, float | None]
TIME: Final = 0.01 * np.arange(1001)  # s


# fmt: off
def lost_contact() -> dict[str, np.ndarray]:
    """Return a slow rise to 9 N that ends in the air, and an estimate that is sure and wrong."""
    off, one = TIME > 9.5, np.ones_like(TIME)
    force = np.where(off, 0.0, np.minimum(TIME, 9.0) + 0.1)
    return {
        "time": TIME, "force": force, "measured_force": force, "peak_force": force,
        "mode": 1 + off, "impact_speed": 1.0 * (TIME == 0), "position_error": one, "travel": TIME,
        "error": 9 * one, "band": one, "nees": one, "curvature": one,
    }
# fmt: on


def spoilt_contact() -> Values:
    """Return what :func:`lost_contact` is, of the arms that touch."""
    limits = {"force": 5.0, "after": 1.0, "impact_limit": 0.4}
    return contact_metrics(lost_contact(), period=None, kick=None, **limits)  # type: ignore[arg-type]


def spoilt_wall() -> Values:
    """Return the same on a wall; the force settles at 9 N, late."""
    return wall_metrics(lost_contact(), force=9.0, after=1.0, kick=9.5, impact_limit=0.4)


def spoilt_tracking() -> Values:
    """Return the same of the point mass."""
    return tracking_metrics(lost_contact(), force=5.0, every=1)


def spoilt_remedies() -> Mapping[str, Metric]:
    """Return what remedies buy that change nothing, but for rubber, which makes it worse."""
    names = list(friction_remedies.REMEDIES)
    rows = np.array([(test, remedy) for test in (0, 1) for remedy in range(len(names))])
    rubber = rows[:, 1] == names.index("rubber_cover")
    same = ("measured", "true", "position", "impact_share", "scratch_time")
    columns = {name: np.where(rubber, 3.0, 1.0) for name in same}
    return friction_remedies._metrics({"test": rows[:, 0], "remedy": rows[:, 1], **columns})


class Ones(dict[str, Any]):
    """Columns of a table; those that are not told are ones."""

    def __missing__(self, name: str) -> Any:
        return np.ones_like(self["case"], dtype=float)


def spoilt_observers() -> Mapping[str, Metric]:
    """Return what observers are that are worse than others, wrong, slow and sure or timid."""
    cases, observers = range(len(observer_comparison.CASES)), len(observer_comparison.OBSERVERS)
    case, observer = np.array([(i, j) for i in cases for j in range(observers)]).T
    columns = {"rms": 1.0 + observer, "coverage": 50.0 + 0 * case}
    compared = observer_comparison._metrics(Ones(case=case, observer=observer, **columns))
    suite = BandSuite(surfaces=("flat", "constant"))
    surface, seed, observer = np.indices((2, 2, 4)).reshape(3, -1)
    nees, rms = np.where(seed, 9.0, 0.01), 1.0 + observer
    rows = Ones(case=surface, surface=surface, observer=observer, rms=rms, nees=nees)
    band = band_metrics(suite, rows)
    return {**compared, **band, "adaptive.cost": Metric(value=150.0, unit="us")}


def spoilt_cycles() -> Mapping[str, Metric]:
    """Return what a campaign is of cycles that end before they begin."""
    scenario = replace(
        charging_campaign.CHARGING_CAMPAIGN, remedies=tuple(charging_campaign.REMEDIES)
    )
    row = {**dict.fromkeys(LIMITS), "finished": 0.0, "reason": "stopped"}
    tasks = tuple(charging_campaign.RemedyTrial(one, 0) for one in scenario.remedies)
    return charging_campaign._metrics(scenario, Trials(tasks=tasks, rows=(row,) * len(tasks)))


def spoilt_map() -> Mapping[str, Metric]:
    """Return what a map is in which what is said to be safe wedges."""
    ones = np.ones(3)
    said = {f"predicted_{name}": ones for name in ("may_sit_on_edge", "inside")}
    verdict, outcome = FeedVerdict.SAFE * ones, FeedOutcome.WEDGED * ones
    return confusion({"predicted_verdict": verdict, "outcome": outcome, **said})


def spoilt_arms() -> Values:
    """Return the limits of arms that are out of their travel, at their torque limits."""
    arms = {}
    for name in ("peg", "hole"):
        arms |= {f"{name}_saturated": np.ones(2)}
        arms |= {f"{name}_q{i + 1}": np.full(2, 9.0) for i in range(7)}
    limits = {**arm_limits(arms, BY_SIGHT), "force.share": 101.0}
    return {f"{way}{name}": value for way in _WAYS for name, value in limits.items()}


def spoilt_plug() -> dict[str, Any]:
    """Return what a plug is that was pushed with 300 N and 9 N m."""
    names = ("time", "depth", "turn", "tilt", "true_wrench_z", "retries")
    traces = {name: np.ones(2) for name in names}
    peaks, ended = np.array([9.0, 0, 0, 0, 0, 300.0]), {"outcome": "running", "state": "push"}
    done = SimpleNamespace(traces=traces, peaks=peaks, wall_seconds=1.0, **ended)
    return dict(insertion_metrics(done, DConnector()))  # type: ignore[arg-type]


def spoilt_plugs() -> Mapping[str, Metric]:
    """Return what a campaign is of such plugs that are said to be mated."""
    wrong = {"reason": "", "hindered": 0, "false_hindered": 0, "false_reason": 0, "false_done": 1}
    row = {**dict.fromkeys(INSERTION, 0.0), **spoilt_plug(), **wrong, "obstacle": np.nan}
    return success_metrics(Trials(tasks=(0,), rows=(row,)))


def spoilt_charging() -> Values:
    """Return what items are that are rushed, pressed, hit, lost and let go in the wall."""
    station, found = Station(), {}
    for kind in ("wall", "crown", "bulk"):
        names = ("acquire.descend", "acquire.grip", "acquire.lift", "scan.pass", "slew.over")
        names += (f"{kind}.approach", f"{kind}.slide", f"{kind}.set_down", "bulk.pour")
        state = np.repeat(np.arange(len(names)), 10)
        time, zero = 0.1 * np.arange(len(state)), np.zeros(len(state))
        x, y = station.place(0.0, station.crucible_radius + station.crucible_thickness / 2)
        at = {"x": x + 0.5 * (time - 4.5), "y": zero + y, "z": station.bed_height - 0.5 * time}
        at["y"][state == 3] = station.scanner[1]
        rows = {f"nugget_{axis}": at[axis] for axis in "xyz"}
        spaces = ("desired", "normal", "true_normal")
        rows |= {f"{name}_{axis}": zero + 1.0 for name in spaces for axis in "xyz"}
        rows |= dict.fromkeys(ADEPT_WRIST.coordinates, zero)
        for place in ("feeder", "wall", "layer"):
            rows |= {f"{place}_peak_force": zero + 30.0, f"{place}_impact_speed": zero + 1.0}
        rows |= {"time": time, "state": state, "item": zero, "layer_shift": zero + 0.01}
        rows |= {"wall_force": np.where(time % 0.4 < 0.2, 1.0, 0.0)}
        item = Item(kind, nugget_of(0.14), (0.0, 0.0, 0.0), 0.0)
        found |= item_limits(rows, names, item, 0, station)
    return {**found, "cycle.placed_share": 100.0 * placed((found,))}


def spoilt_slides() -> Mapping[str, Metric]:
    """Return what recordings show that touch too late to observers that are sure and wrong."""
    rows = np.ones(20)
    on = measured_slide.Recorded(
        time=np.arange(20.0), force=np.ones((20, 3)), force_rate=np.zeros((20, 3)),
        position=np.zeros((20, 3)), velocity=np.zeros((20, 3)),
        contact=rows > 0, normal=np.array([0.0, 0.0, 1.0]), plane="",
        detected=(np.array([3.0]), np.zeros(0)),
    )  # fmt: skip
    thesis = {"error": rows, "band": 9 * rows, "nees": rows, "push": rows, "status": 0 * rows}
    wrong = {"error": 9 * rows, "band": rows, "push": -rows, "status": 6 * rows}
    made = {"thesis": thesis, "adaptive": thesis | wrong}
    found = {
        **measured_slide._of_recording(on),
        **measured_slide._of_observers(made, on, rows > 0),  # type: ignore[arg-type]
    }
    air = measured_slide._of_recording(on._replace(contact=rows < 0))
    metrics = {
        f"{name}.{key}": one
        for name in ("table_a", "table_b", "table_press", "free")
        for key, one in (air if name == "free" else found).items()
    }
    return metrics | measured_slide._of_all(metrics)


_WAYS: Final = ("", "wait.", "frozen.", "frozen_wait.")
# fmt: off
SPOILT: Final = (
    ("planar-hold planar-slide planar-slide-late contact-recovery", spoilt_contact,
     "contact.losses damage.scratch_time damage.safe_speed_share"),
    ("puma-roller-motion-soft", spoilt_contact, "contact.losses"),
    ("adept-unknown-wall puma-unknown-wall planar-unknown-wall", spoilt_wall,
     "contact.losses damage.scratch_time force.settling_time_10 coverage"),
    ("unknown-surface-control unknown-surface-control-noise-free "
     "unknown-surface-control-adaptive", spoilt_tracking, "contact.losses damage.scratch_time"),
    ("unknown-surface-control-adaptive", spoilt_tracking, "force.within_10"),
    ("friction-remedies", spoilt_remedies, ALL),
    ("observer-comparison", spoilt_observers, ALL),
    ("charging-campaign", spoilt_cycles, ALL),
    ("measured-slide", spoilt_slides, ALL),
    ("insertion-map", spoilt_map, ALL),
    ("insertion", spoilt_arms, "force.share"),
    ("vertical-tracking alignment repeatability", spoilt_arms, _ARMS),
    ("insertion-repeatability", spoilt_arms,
     " ".join(f"{way}{name}" for way in _WAYS for name in (*_ARMS.split(), "force.share"))),
    ("skill peg-skill d-connector bnc-connector rj45-connector", spoilt_plug,
     "force.share torque.share"),
    ("peg-skill-success d-connector-success bnc-connector-success rj45-connector-success",
     spoilt_plugs, "force.share torque.share force.peak_share false_done"),
    ("crucible-charging", spoilt_charging, ALL),
)
# fmt: on


@pytest.mark.parametrize(("names", "spoil", "breaks"), SPOILT)
def test_spoilt_arrays_break_checks(
    names: str, spoil: Callable[[], Mapping[str, Any]], breaks: str
) -> None:
    found = {
        key: one if isinstance(one, Metric) else Metric(value=one, unit="")
        for key, one in spoil().items()
    }
    for entry in select(CATALOGUE.entries, names.split()):
        assert named(entry.name, breaks) <= broken(entry, found), entry.name


def test_each_check_is_broken_by_something() -> None:
    known = {
        (name, metric)
        for names, *_, breaks in (*SCENARIOS, *FAULTS, *SPOILT)
        for name in names.split()
        for metric in named(name, breaks)
    }
    asked = {(one.experiment, one.metric) for one in PUBLISHED}
    assert asked - known == set(), "say here what breaks these checks"
    assert known - asked == set(), "these checks are no more"
