"""The errors that the cell's cameras may have, and alignments with them: at rest, and in runs."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from chamfer.analysis.campaign.trial_metrics import trial_seed
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.cell.alignment_runs import (
    LATE,
    AlignmentTrialsScenario,
    ResolvedAlignmentTrialsScenario,
    Traces,
    drawn,
    row_before,
    run_alignment,
    true_errors,
    vision_errors,
)
from chamfer.diagrams.cell.alignment_scenario import (
    AlignmentScenario,
    ControllerChoice,
    ControllerKind,
    require_in_view,
    require_start_apart,
)
from chamfer.diagrams.cell.cell_vision import VIEWS, CameraSettings, Measured, ViewSettings
from chamfer.diagrams.cell.still_vision import StillVision
from chamfer.models.cameras.camera import View
from chamfer.models.validation import ParameterError, known, require_not_negative, require_positive
from chamfer.systems.cameras.camera_image import Image
from chamfer.systems.pose import POSE_NAMES, pose_vector

Change = Callable[[ViewSettings, float, CameraSettings], ViewSettings]
Views = Sequence[View]
ScenarioT = TypeVar("ScenarioT", bound=AlignmentScenario)

_WARM: Final = (1.0, 0.0, -1.0)  # of red, green and blue: a lamp instead of daylight


class AssumedCameraError(NamedTuple):
    """An error of cameras that the controller does not know."""

    name: str
    unit: str
    most: float  # how large it may well be without calibration; assumed
    says: str  # in a few words
    change: Change | None = None  # of one camera
    views: Views = VIEWS  # cameras that have it
    off_axis: bool = False  # with the parts beside the optical axes
    moving: bool = False  # it shows in motion, or in many frames, only
    signed: bool = True  # it may also be of the other sign
    picture: Callable[[float], Callable[[Image], Image]] | None = None  # of parts at rest alone


def with_error(
    scenario: ScenarioT, error: AssumedCameraError, size: float, off_axis: float
) -> ScenarioT:
    """Return a resolved scenario whose cameras have an error, with unchanged controllers.

    The size is in the error's unit, with its sign; parts off the axes are ``off_axis`` off, m.
    """
    if error.off_axis:
        scenario = beside(scenario, off_axis)
    cameras, change = scenario.cameras, error.change
    if change is not None:
        for view in error.views:
            cameras = cameras.with_view(view, change(cameras.view(view), size, cameras))
    return replace(scenario, cameras=cameras)


def beside(scenario: ScenarioT, off_axis: float) -> ScenarioT:
    """Return a scenario with cameras shifted down in their images, known to the controller."""
    cameras = scenario.cameras
    for view in VIEWS:
        place = {"position": (0.0, off_axis, 0.0)}
        moved = _changed(_changed(cameras.view(view), "believed", **place), "true", **place)
        cameras = cameras.with_view(view, moved)
    return replace(scenario, cameras=cameras)


def brightness_ramp(size: float) -> Callable[[Image], Image]:
    """Return the change that brightens a picture downwards, by a share from border to border."""

    def change(image: Image) -> Image:
        ramp = 1 + size * np.linspace(-0.5, 0.5, len(image))[:, np.newaxis, np.newaxis]
        return np.clip(np.rint(image * ramp), 0, 255).astype(np.uint8)

    return change


def _changed(of: ViewSettings, part: str, **values: Any) -> ViewSettings:
    changes: dict[str, Any] = {part: replace(getattr(of, part), **values)}
    return replace(of, **changes)


def _more(part: str, name: str, *shares: float) -> Change:
    """Add the size, or shares of it to its elements, to a field of one of a view's settings."""

    def change(of: ViewSettings, size: float, cameras: CameraSettings) -> ViewSettings:
        was = getattr(getattr(of, part), name)
        if shares:
            now: Any = tuple(one + share * size for one, share in zip(was, shares, strict=True))
        else:
            now = round(was + size) if isinstance(was, int) else was + size
        return _changed(of, part, **{name: now})

    return change


def _focal(along_u: float, along_v: float) -> Change:
    def change(of: ViewSettings, size: float, cameras: CameraSettings) -> ViewSettings:
        fu, fv = known("focal_length", of.true.focal_length)
        longer = fu * (1 + along_u * size), fv * (1 + along_v * size)
        return _changed(of, "true", focal_length=longer)

    return change


def _aim(of: ViewSettings, size: float, cameras: CameraSettings) -> ViewSettings:
    """Turn the camera about what it looks at, about its v axis."""
    about_u, about_v = known("tilt", of.true.tilt)
    right, down, ahead = known("position", of.true.position)
    sin, cos = math.sin(size), math.cos(size)
    place = (right - cameras.distance * sin, down, ahead + cameras.distance * (1 - cos))
    return _changed(of, "true", tilt=(about_u, about_v + size), position=place)


def _coarse(of: ViewSettings, size: float, cameras: CameraSettings) -> ViewSettings:
    """Make a pixel larger, as is known."""
    fu, fv = known("focal_length", of.true.focal_length)
    share = cameras.pixel_size / (cameras.pixel_size + size)
    of = _changed(of, "believed", focal_length=(fu * share, fv * share))
    return _changed(of, "true", focal_length=(fu * share, fv * share))


def _warm(of: ViewSettings, size: float, cameras: CameraSettings) -> ViewSettings:
    gains = np.multiply(of.sensor.white_balance, 1 + size * np.array(_WARM))
    return _changed(of, "sensor", white_balance=tuple(gains.tolist()))


_OFF_AXIS: Final = partial(AssumedCameraError, off_axis=True)
_IN_MOTION: Final = partial(AssumedCameraError, moving=True, signed=False)
_OF_ONE: Final = partial(_IN_MOTION, views=VIEWS[1:])
_K1, _K2, _P1 = (_more("true", "distortion", *np.eye(5)[k].tolist()) for k in range(3))
_RIGHT, _DOWN, _AHEAD = (_more("true", "position", *np.eye(3)[k].tolist()) for k in range(3))
_LONGER: Final = 1 / 30 - 1 / 80  # s

ERRORS: Final[tuple[AssumedCameraError, ...]] = (
    AssumedCameraError("focal_length", "", 0.3, "focal length", _focal(1.0, 1.0)),
    AssumedCameraError("pixel_aspect", "", 0.02, "aspect of the pixels", _focal(0.5, -0.5)),
    AssumedCameraError(
        *("principal_point", "pixels", 20.0, "principal point"),
        _more("true", "principal_point", 1.0, 1.0),
    ),
    AssumedCameraError("distortion", "", -1.25, "distortion k1 of parts on the axis", _K1),
    _OFF_AXIS("distortion_off_axis", "", -1.25, "distortion k1 of parts off the axis", _K1),
    _OFF_AXIS("higher_distortion_off_axis", "", -30.0, "distortion k2 of parts off the axis", _K2),
    _OFF_AXIS("decentring_off_axis", "", 0.02, "distortion p1 of parts off the axis", _P1),
    AssumedCameraError("position_along", "m", 0.15, "a place nearer to the parts", _AHEAD),
    AssumedCameraError("position_across", "m", 0.03, "a place to the right", _RIGHT),
    AssumedCameraError("position_down", "m", 0.02, "a place further down", _DOWN),
    AssumedCameraError("tilt_in_place", "rad", 0.05, "tilt in place", _more("true", "tilt", 1, 1)),
    AssumedCameraError("tilt_aimed", "rad", 0.3, "tilt with the aim kept", _aim),
    AssumedCameraError("roll", "rad", 0.15, "roll", _more("true", "roll")),
    AssumedCameraError(
        "vignetting", "", 0.5, "vignetting", _more("sensor", "vignetting"), signed=False
    ),
    AssumedCameraError("white_balance", "", 0.2, "warm light", _warm),
    AssumedCameraError("shading", "", 0.5, "light from one side", picture=brightness_ramp),
    _IN_MOTION("pixel_size", "m", 5e-4, "larger pixels", _coarse),
    _IN_MOTION("exposure", "s", 1 / 80, "an open shutter", _more("sensor", "exposure")),
    _IN_MOTION("latency", "periods", 6.0, "later images", _more("frames", "latency")),
    _OF_ONE(
        "latency_of_one", "periods", 5.0, "later images of one camera", _more("frames", "latency")
    ),
    _IN_MOTION("period", "s", _LONGER, "a longer period", _more("frames", "period")),
    _OF_ONE(
        "period_of_one", "s", _LONGER, "a longer period of one camera", _more("frames", "period")
    ),
    _OF_ONE("clock_offset", "s", 1 / 160, "one camera's clock", _more("frames", "offset")),
    _IN_MOTION("dropped_frames", "", 0.1, "dropped frames", _more("frames", "miss")),
    _IN_MOTION("noise", "grey levels", 8.0, "more noise", _more("frames", "noise")),
)


Array = NDArray[np.float64]

NONE: Final = "none"  # no error
DRAWN: Final = "drawn"  # all of them at once
BY_NAME: Final = {error.name: error for error in ERRORS}
DRAWN_ERRORS: Final = tuple(error for error in ERRORS if error.change is not None)
NOT_DRAWN: Final = tuple(error for error in ERRORS if error.change is None)  # at rest alone
# What is left, by name: of the tip, of the axes, and of the peg's axis some way behind the tip.
LEFT: Final = {"lateral_error": "m", "rotational_error": "rad", "behind_error": "m"}
MOMENTS: Final = ("soon", "late")


@dataclass(frozen=True, kw_only=True)
class CameraErrorsScenario(AlignmentTrialsScenario):
    """The alignment with errors of its cameras; its controllers know nothing of them.

    Parts at rest tell where an error alone makes the cameras take them to be aligned, without
    noise and dead zones, at many sizes. Runs of the loop tell what is left in the end at one.
    """

    initial_error: tuple[float, ...] = AlignmentScenario.initial_error
    trials: int = 4  # runs with drawn errors and starts, each with and without the errors
    compensation_time: float = 6.0  # s, the end; the error left then is bias, the rest was slow
    soon: float = 2.5  # s, time of the compensation for an earlier evaluation; section 5
    behind: float = 0.1  # m, from the tip, where the peg's axis is evaluated too
    off_axis: float = 0.02  # m, distance of off-axis parts from the optical axes; assumed
    points: int = 3  # sizes of an error with parts at rest, up to the largest; 0: none at rest
    largest: float = 1.0  # largest error tried, over its realistic size
    drawn: float = 0.5  # largest drawn error, over its realistic size
    errors: tuple[str, ...] = ()  # names of the errors to try alone; none: all
    controllers: tuple[ControllerKind, ...] = ("fsm",)  # of the loop: fsm, pid
    measurements: tuple[Measured, ...] = ("image",)  # image, metric

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "soon", "behind", "largest")
        require_not_negative(self, "off_axis", "drawn")
        if not self.soon <= self.compensation_time:
            allowed = f"at most compensation_time, {self.compensation_time:g} s"
            raise ParameterError("soon", self.soon, allowed)
        if not 0 <= self.points <= 100:
            raise ParameterError("points", self.points, "0 to 100")
        for name in self.errors:
            if name not in BY_NAME:
                raise ParameterError("errors", name, ", ".join(BY_NAME))
        for field in ("controllers", "measurements"):
            if not getattr(self, field):
                raise ParameterError(field, (), "one or more")

    @property
    def alone(self) -> tuple[AssumedCameraError, ...]:
        """The errors that are tried alone."""
        return tuple(one for one in ERRORS if not self.errors or one.name in self.errors)


@dataclass(frozen=True, kw_only=True)
class ResolvedCameraErrorsScenario(ResolvedAlignmentTrialsScenario, CameraErrorsScenario):
    """The scenario with no field left open."""


class ErrorAtRest(NamedTuple):
    """One error at some sizes, of parts at rest."""

    error: str
    sizes: tuple[float, ...]
    measured: Measured


class ErrorRun(NamedTuple):
    """One run of the loop, with an error or with drawn ones."""

    error: str  # or NONE, or DRAWN
    size: float  # of the drawn ones: of each a share
    controller: ControllerKind
    measured: Measured
    trial: int | None = None  # by which its start is drawn too; None: the scenario's own start


def left(study: ResolvedCameraErrorsScenario, pose: Array, hole: Array) -> dict[str, Array]:
    """Return the errors of :data:`LEFT`, shape (n,), of poses of peg and hole, shape (n, 7)."""
    found = true_errors(pose, hole)
    back = Rotation.from_quat(pose[:, :4], scalar_first=True).apply([-study.behind, 0.0, 0.0])
    moved = pose.copy()
    moved[:, 4:] += back
    behind = true_errors(moved, hole).lateral
    return {
        "lateral_error": found.lateral,
        "rotational_error": found.rotational,
        "behind_error": behind,
    }


def at_rest(study: ResolvedCameraErrorsScenario, task: ErrorAtRest) -> Row:
    """Return the true errors of parts that look aligned, shape (n,); NaN where one is not seen."""
    error = BY_NAME[task.error]
    values: dict[str, list[float]] = {name: [] for name in (*LEFT, "gap_error")}
    hole = pose_vector(study.nominal_pose("hole"))[np.newaxis]
    for size in task.sizes:
        scenario = with_error(_of(study, task.measured), error, size, study.off_axis)
        picture = None if error.picture is None else error.picture(size)
        found = dict.fromkeys(values, math.nan)
        if (X_WT := StillVision(scenario, picture).aligned()) is not None:
            pose = pose_vector(X_WT)[np.newaxis]
            found = {name: float(of[0]) for name, of in left(study, pose, hole).items()}
            found["gap_error"] = float(true_errors(pose, hole).gap[0]) - scenario.gap
        for name, value in found.items():
            values[name].append(value)
    return {"size": np.array(task.sizes), **{name: np.array(of) for name, of in values.items()}}


def reached(size: Array, left: Array, wanted: float) -> float | None:
    """Return the size at which an error is as large as wanted, None if it never is.

    Straight between sizes, and from nothing to the first one.
    """
    size, left = np.concatenate([[0.0], size]), np.concatenate([[0.0], left])
    beyond = np.flatnonzero(left >= wanted)
    if not len(beyond):
        return None
    k = int(beyond[0])
    share = (wanted - left[k - 1]) / (left[k] - left[k - 1])
    return float(size[k - 1] + share * (size[k] - size[k - 1]))


def run_once(study: ResolvedCameraErrorsScenario, seed: int, task: ErrorRun) -> Row:
    """Run the loop, and return the early and late errors; it depends on its arguments alone.

    ``seen`` is 0 where nothing was measured in the end: what is left then is of the start, or of
    where the parts were lost. No run is made where they are not in view to begin with.
    """
    scenario, trial = _of(study, task.measured, task.controller), task.trial or 0
    if task.trial is not None:
        middle = replace(scenario, initial_error=(0.0,) * len(scenario.initial_error))
        scenario = drawn(middle, scenario.spread, seed, trial)
    if task.error == DRAWN:
        scenario = with_drawn_errors(scenario, seed, trial, task.size, study.off_axis)
    elif task.error != NONE:
        scenario = with_error(scenario, BY_NAME[task.error], task.size, study.off_axis)
    try:
        require_in_view(scenario)
        require_start_apart(scenario)
    except ParameterError:
        return {"seen": 0.0, "diverged": 0.0, **dict.fromkeys(_names(), None)}
    traces = run_alignment(scenario, trial_seed(seed, trial))
    late = row_before(traces["time"], traces["time"][-1] - LATE)
    return {
        "seen": float(traces["valid"][late:].any()),
        "diverged": float(traces["diverged"].max()),
        **_measured(study, traces),
    }


def with_drawn_errors(
    scenario: ScenarioT, seed: int, trial: int, share: float, off_axis: float
) -> ScenarioT:
    """Return a resolved scenario whose cameras each have all errors, up to a share of their most.

    How far the parts are off the optical axes, m, up to that share of ``off_axis``, is drawn too.
    """
    generator = np.random.default_rng([seed, trial, len(ERRORS)])  # no start is drawn of it
    scenario = beside(scenario, share * off_axis * float(generator.uniform(-1.0, 1.0)))
    for error in DRAWN_ERRORS:
        for view in error.views:
            size = float(generator.uniform(-1.0 if error.signed else 0.0, 1.0)) * error.most
            alone = error._replace(views=(view,), off_axis=False)
            scenario = with_error(scenario, alone, share * size, 0.0)
    return scenario


def _names() -> list[str]:
    seen = ("vision.lateral_error", "vision.rotational_error")
    return [f"{moment}.{name}" for moment in MOMENTS for name in (*LEFT, *seen)]


def _measured(study: ResolvedCameraErrorsScenario, traces: Traces) -> dict[str, float | None]:
    """Return what is left, and what the cameras are off, soon and late."""
    poses = [
        np.column_stack([traces[f"{arm}_true_{name}"] for name in POSE_NAMES])
        for arm in ("peg", "hole")
    ]
    found = left(study, *poses)
    last = len(traces["time"]) - 1
    soon = min(row_before(traces["time"], study.begin + study.soon) + 1, last)
    values: dict[str, float | None] = {}
    for moment, row in (("soon", soon), ("late", last)):
        values |= {f"{moment}.{name}": float(of[row]) for name, of in found.items()}
        seen = vision_errors(traces, row, study.cameras.pixel_size)
        values |= {f"{moment}.{name}": value for name, value in seen.items()}
    return values


def _of(
    study: ResolvedCameraErrorsScenario, measured: Measured, controller: ControllerKind = "fsm"
) -> ResolvedCameraErrorsScenario:
    cameras = replace(study.cameras, measured=measured)
    return replace(study, controller=ControllerChoice(kind=controller), cameras=cameras)
