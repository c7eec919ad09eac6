"""What the parameters of all blocks, parts and loops refuse alike: what is no number."""

import importlib
import math
import pkgutil
import re
from dataclasses import fields, is_dataclass, replace
from itertools import chain
from typing import Any, Literal, get_args, get_origin, get_type_hints

import pytest

import chamfer.diagrams
import chamfer.models
import chamfer.systems
from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.scenario.experiment import load
from chamfer.diagrams.skills.vision_servo import NAMES, VisionServoScenario
from chamfer.models.arms.arm import JointFrictionParams
from chamfer.models.connectors.d_connector import DConnector
from chamfer.models.surfaces.planes import RippledPlane
from chamfer.models.validation import ParameterError
from chamfer.systems.contact.arm_in_contact import ArmInContactParams
from chamfer.systems.force.hybrid_law import HybridControllerParams
from chamfer.systems.primitives.position_primitives import Centre
from chamfer.systems.primitives.trajectory_primitives import Dither
from chamfer.systems.servo.compensator_law import AxisParams, CompensatorParams
from chamfer.systems.servo.divergence_law import DivergenceParams, Watched
from chamfer.systems.servo.pid_law import PidGains, SampledPidParams
from chamfer.systems.vision.part_appearance import PEG

# By the class: whoever holds it checks.
UNCHECKED = {
    *("ContactArmSettings.contact_offset", "ArmInContactParams.contact_offset"),
    *("ControllerSettings.computation_delay", "ControllerSettings.computation_jitter"),
    *(f"HybridStabilityScenario.{name}" for name in ("viscous", "start", "direction")),
    "ViewFrames",
    "FsmRule",
}

# For no bound, or for as long as it takes.
INFINITE = {
    *(f"{kind}.limit" for kind in ("OpenAxis", "OpenGains", "FsmParams", "PidGains")),
    *(f"{kind}.limit" for kind in ("AxisParams", "OpenAxisParams", "OpenPidGains")),
    *("CompensatorParams.end_time", "DivergenceParams.factor"),
    *("Held.time", "Stick.threshold", "Way.most"),
    *("Place.acceleration", "Place.threshold"),
}

# Class and fields that may be 0, and those that may also be -1; all others are to be above 0.
MAY_BE_ZERO = """
    AlignmentComparisonScenario: tuning_trials; Appearance: hue hue_width
    saturation; AxisSensorParams: noise;
    AccuracyScenario: gap; AlignmentScenario: gap; CellErrorParams: gap; ConditionsScenario: gap;
    BaseCompensationParams: rest_speed; BlindFeedScenario: tilt; BoardPoses: roll tilt;
    CameraErrorParams: latency noise resolution; CameraErrorsScenario: drawn off_axis points;
    CartesianManipulatorParams: damping; CellArmSettings: payload_error; CellErrorParams:
    most_misses; ChannelParams: bandwidth delay drift full_scale noise resolution tare;
    ComparedLoopScenario: friction; ContactDetectionParams: release; ContactMaterial:
    dissipation friction; ContactParams: damping friction_noise; ContinuityParams: most_jumps;
    CorrelatorParams: amplitude_threshold threshold; CrucibleWallSettings: lean; DConnector:
    pin_funnel side_angle; DConnectorSkillParams: push_dither settle_amplitude twist_amplitude;
    DSection: side_angle; Disturbances: friction lost noise plant; DrawnCameras: aspect k3
    principal_point tangential; DrawnDesignsScenario: unchamfered; EncoderParams: bandwidth;
    FaultParams: delay item;
    FedCellScenario: rest; FeedScenario: rest; FixedPointRotation: moved;
    ForceRateSensorParams: force_noise force_rate_noise; FrameGrabberParams: latency miss noise
    offset; GraspAndTransportParams: weight; GripperCompliance: damping; GuardedMotionParams:
    amplitude; GuardedMove: sure; Held: wait weight; HybridGains: damping force_damping
    force_integral integral stiffness; HybridScenario: measure_after;
    ImpedanceControllerParams: null_stiffness smallest_singular_value; InsertParams: pause
    rest; InsertionScenario: peg_excess; LaidContact: slip_friction; LayerSettings: slip_friction
    tilt; LeadSettings: depth hover press; Level: sure time; MeasuredSlideScenario:
    settle; ModelErrorParams: bias delay delay_deviation friction position position_length press
    stiffness tare; ModelErrorScenario: bias stiffness_error; ModelErrors:
    joint_friction link_mass payload; ObserverComparisonScenario: vision_error; Obstructed:
    amplitude_threshold threshold; OpenPidGains: derivative integral proportional; PegHoleGeometry:
    chamfer_width; PegInsertionScenario: tilt; PictureQuality: blur noise; Reach: angle distance;
    ScenarioSpread: camera_turn focal force_bias friction lateral obstacle_short obstacles
    rotational sensor_origin tight torque_bias wrist_centre wrist_stiffness; SceneStyle: blur;
    Seat: harder; SensorParams: exposure vignetting; ServoCameraParams: lost; ServoPlantParams:
    dead_time; Spread: joint_friction lateral link_mass payload rotational; SpreadParams: aside
    believed_mass bias joint_friction lying_tilt normal place size slip_friction surface_friction;
    SpringConstraintParams: index stiffness; SprungConnector: spring_dissipation; StepSpread: step;
    SurfaceFriction: coefficient ripple;
    SurfaceObserverParams: force_noise force_rate_noise halt_speed initial_deviation rate_lag;
    SurfaceScenario: force_delay; TouchDetectionParams: release; TouchedSettings: damping;
    TrackingTask: depth; Unevenness: ripple; UnknownWallSettings: roll tilt; UnknownWallTask: wait;
    VisionPrimitivesScenario: focal_error orientation_error; WristParams: centre_of_mass;
    _Compared: moved; ContactLoop: bandwidth delay step; ServoParams: delay repeatability;
    HoleSettings: position_error angle_error; HandMount: angle_deviation position_deviation;
    CalibrationScenario: reach arm_shift arm_turn; SearchParams: widen; CentreScenario: farthest;
    PlateStyle: face bore chamfer shading blur; WristSensorParams: tool_mass
"""
MAY_BE_NEGATIVE = """
    AxisSensorParams: bias; BlindFeedScenario: lateral; CameraModel: roll; CameraSettings:
    most_misses; CameraStand: roll; CellErrorParams: begin; Centre: offset;
    ChargingParams: lean; ControllerSettings: computation_delay computation_jitter;
    ConvergenceScenario: stuck_tilt; DecisionParams: margin; DivergenceParams: size;
    FixedPointRotation: angle; FsmRule: dead_zone divider period; InitialErrors: lateral
    rotation; InsertParams: freeze_depth; LeadSettings: sideways; ObserverSettings: average;
    OpenSupport: centre_distance; PegInsertionScenario: lateral; PidParams: derivative integral
    proportional; PlanItem: azimuth tilt tilt_azimuth; Seat: distance; Sinusoid: amplitude;
    SpringConstraintParams: stop_at; StationLayout: bed_height; Step: amplitude; Support:
    centre_distance; SurfaceFriction: jump jump_at; SurfaceMotionParams: speed; Unevenness:
    tilt; CentreScenario: nearest; ComplianceParams: centre_distance; PlateStyle: light;
    WristSensorParams: bias; ViewFrames: latency miss noise offset period; VisGrasp: angle;
    VisionServoSetup:
    angle; Way: least; WristParams: centre
"""
# Bounds: at them, a number is allowed or not, and beyond them it is not.
BOUNDS = """
    AccuracyCameras: noise<=60; AccuracyScenario: poses<=10000; AlignmentComparisonScenario:
    trials<=10000 tuning_trials<=1000; AlignmentScenario: compensation_time<=3600; Appearance:
    hue<=255 hue_width<=127 saturation<=255 value<=255 end_ratio<=1 band<=1 seen<=1 area>=2
    length>=2; AxisParams: divider>=1; BlindFeedScenario: tilt<pi/4 feed>0.046; BncConnector:
    overlap>0.00485 spring_travel<0.00846 spring_radius<0.0038; CalibrationScenario:
    pictures>=5; CameraPlacement: width<=10000 height<=10000 pixel_size<=0.01;
    ChargingCampaignScenario: trials<=1000; ChargingParams: approach_speed<=0.1 lean<=pi/3
    near<0.03; ColouredParts: chamfer_angle<pi/2 peg_chamfer_angle<pi/2; ConditionsCameras:
    noise<=60; ConditionsScenario: pictures<=10000; ContactMaterial: friction<=2;
    CorrelatorParams: samples>=4; CrucibleWallSettings: lean<=0.2; DConnector: side_angle<pi/4
    lead_in<0.00259 pin_depth<0.0056; DConnectorSkillParams: limit_share>=1 free_share<=3;
    DecisionParams: margin<1 frames>=2 frames<=1000; DivergenceParams: factor>1; DrawnCameras:
    aspect<=0.5; DrawnCells: draws<=10000; FixedPointRotation: angle<pi/2; FrameGrabberParams:
    latency<=100 noise<=60 miss<=1 period>=0.0001 period<=1; GuardedMove: speed<=3;
    HybridStabilityScenario: points>=2 points<=1000; InsertParams: attempts<=100 push<15
    pull<15; InsertionMapScenario: points<=101 largest_tilt<pi/4; JointFrictionParams:
    breakaway>=1; LayerSettings: tilt<=0.5; MapParams: points>=2; ModelErrorParams:
    stiffness<1; ModelErrorScenario: trials<=1000 stiffness_error<1 latest<=10;
    ObserverComparisonScenario: trials<=10000 vision_error<1; PegAndHole: peg_chamfer_share<=1
    peg_radius<0.010035 outer_radius>0.012035; PegHoleGeometry: friction<=2;
    PegInsertionScenario: depth<=0.06; Place: speed<=3; RippledPlane: tilt<pi/2; Rj45Connector:
    travel<0.0215 latch_deflection<0.0012 latch_angle<pi/4 contact_deflection<0.0005;
    Rj45ConnectorSkillParams: push_growth>1; RoundPeg: depth<0.024 hole_length>0.015;
    ScenarioSpread: friction<1 obstacles<=1 mating_force>=1 tight<=1 focal<1 wrist_stiffness<1;
    SceneStyle: face<=1 bore<=1; Seat: growth>1; SensorParams: vignetting<=1; Servoing: gain<1;
    SightSettings: pixel_size<=0.01; Spiral: speed<=3; Spread: payload<1 joint_friction<1
    link_mass<1; StationLayout: rim_height>0.36; SurfaceFriction: coefficient<=2;
    SurfaceScenario: trials<=1000; TiltSearchParams: angle<pi/6; UnknownWallSettings:
    tilt<=pi/4; VisionPrimitivesScenario: focal_error<1; VisionServoSetup: pixel_size<=0.01;
    WedgingScenario: points>=2 points<=100000
"""
# Series of numbers that may not be empty, and what each of them is.
SERIES = """
    AccommodationParams: damping>0 stiffness>=0; AdmittanceParams: inertia>=0 spring>=0;
    AlignmentComparisonScenario:
    closed_loop>0 small_lateral>0 small_rotational>0; AlignmentScenario: initial_error; Circle:
    centre; ConnectorScenario: initial_error; JointFrictionParams: coulomb>=0 viscous>=0;
    LissajousScenario: repeats>0; MoveDx: displacement; Obstructed: cycle>0; Parabola:
    coefficients; PlantFamily: stiffness>0; Sphere: centre; VisionPrimitivesScenario:
    map_focal>0 map_angle>=0; VisionServoScenario: start target; Wave: amplitudes wavelengths>0;
    WristParams: stiffness>0
"""
# Whose sign is a matter of the class or of another field.
OPEN = {"large_error", "peg_chamfer_share"}
OPEN |= {"Appearance.front", "Dither.amplitude", "LeadSettings.speed", "WorkCellScenario.gap"}
# Tuples whose length the file's reader checks, or that may be of several.
OF_ANY_LENGTH = UNCHECKED | {
    *("Appearance", "BoardPoses", "DrawnCameras", "DrawnDesignsScenario", "MapParams"),
    *("Camera", "ForceSensorParams", "LoadCellParams", "Seat", "WrenchSensorParams"),
    "WristSensorParams",
}


def named(text: str) -> set[tuple[str, str]]:
    """Return class and field of a table's entries."""
    entries = (entry.split(":") for entry in text.split(";"))
    return {(kind.strip(), name) for kind, names in entries for name in names.split()}


ZERO, NEGATIVE = named(MAY_BE_ZERO), named(MAY_BE_NEGATIVE)


def inside(example: Any) -> dict[type, Any]:
    """Return the dataclasses in an example, each by its class."""
    found = {type(example): example}
    for one in fields(example):
        value = getattr(example, one.name)
        if is_dataclass(value):
            found |= inside(value)
    return found


def examples() -> dict[type, Any]:
    """Return one of each class: with its defaults, else out of a scenario."""
    found: dict[type, Any] = {}
    packages = (chamfer.models, chamfer.systems, chamfer.diagrams)
    for module in chain(*(pkgutil.walk_packages(p.__path__, p.__name__ + ".") for p in packages)):
        for kind in vars(importlib.import_module(module.name)).values():
            if is_dataclass(kind) and isinstance(kind, type) and hasattr(kind, "__post_init__"):
                try:
                    found[kind] = kind()
                except (TypeError, ParameterError):  # has no defaults
                    continue
    axis = AxisParams(dead_zone=0.125, large_error=1.0, increment=0.5)
    gains = PidGains(proportional=1.0, integral=1.0)
    friction = JointFrictionParams(coulomb=(0.0,), viscous=(0.0,))
    given = [Centre(dither=Dither()), DConnector().plug_section, PEG, axis, gains]
    given += [RippledPlane(point=(0.0, 0.0, 0.0)), ArmInContactParams(joint_friction=friction)]
    given += [CompensatorParams(axes=(axis,)), SampledPidParams(axes=(gains,))]
    given += [DivergenceParams(watched=(Watched((0, 1), 2.0),), size=3)]
    law = {"stiffness": 1.0, "integral": 1.0, "damping": 1.0, "force_integral": 3.0}
    given += [HybridControllerParams(**law, feedforward_torque=())]
    given += [VisionServoScenario(primitive=name).parameters for name in NAMES]
    given += [load(entry).default for entry in CATALOGUE.entries]
    for one in given:
        found = inside(one) | found
    return {kind: one for kind, one in found.items() if kind.__name__[0] != "_"}


EXAMPLES = examples()


def refused(example: Any, name: str, value: object) -> bool:
    try:
        replace(example, **{name: value})
    except ParameterError as error:
        return name in error.name
    return False


@pytest.mark.parametrize("kind", EXAMPLES, ids=lambda kind: kind.__qualname__)
def test_what_is_no_finite_number_is_named(kind: type) -> None:
    example = EXAMPLES[kind]
    for one in fields(example):
        value, key = getattr(example, one.name), f"{kind.__name__}.{one.name}"
        if not UNCHECKED.isdisjoint((kind.__name__, key)):
            continue
        if isinstance(value, tuple) and value and isinstance(value[0], float):
            assert refused(example, one.name, (math.nan, *value[1:])), one.name
        elif isinstance(value, float) or str(one.type) == "float | None":
            found = [refused(example, one.name, probe) for probe in (math.nan, math.inf)]
            assert found == [True, key not in INFINITE], one.name


@pytest.mark.parametrize("kind", EXAMPLES, ids=lambda kind: kind.__qualname__)
def test_numbers_have_the_sign_that_they_may_have(kind: type) -> None:
    example = EXAMPLES[kind]
    for one in fields(example):
        value, name = getattr(example, one.name), one.name
        is_number = isinstance(value, float | int) and not isinstance(value, bool)
        if {name, f"{kind.__name__}.{name}"} & OPEN or not (
            is_number or "float | None" in str(one.type)
        ):
            continue
        owners = {(base.__qualname__, name) for base in kind.__mro__}
        found = [refused(example, name, probe) for probe in (-1, 0)]
        expected = [owners.isdisjoint(NEGATIVE), owners.isdisjoint(ZERO | NEGATIVE)]
        assert found == expected, name


@pytest.mark.parametrize("kind", EXAMPLES, ids=lambda kind: kind.__qualname__)
def test_choices_and_lengths_are_those_of_the_annotation(kind: type) -> None:
    example, hints = EXAMPLES[kind], get_type_hints(kind)
    for name in (one.name for one in fields(example)):
        for hint in (hints[name], *get_args(hints[name])):
            if get_origin(hint) is Literal and get_origin(hints[name]) is not tuple:
                assert refused(example, name, "other"), name
            if get_origin(hint) is not tuple or set(get_args(hint)) != {float}:
                continue
            if OF_ANY_LENGTH.isdisjoint((kind.__name__, f"{kind.__name__}.{name}")):
                count = len(get_args(hint))
                for wrong in (count - 1, count + 1):
                    assert refused(example, name, (1.0,) * wrong), name


def example_of(name: str) -> Any:
    return next(one for kind, one in EXAMPLES.items() if kind.__name__ == name.strip())


@pytest.mark.parametrize("entry", SERIES.split(";"))
def test_series_are_of_numbers_that_they_may_have(entry: str) -> None:
    kind, _, terms = entry.partition(":")
    example = example_of(kind)
    for name, sign in re.findall(r"(\w+)(>=?|)", re.sub("0", "", terms)):
        first, *rest = getattr(example, name)
        tried = [(), (-1 - abs(first), *rest), (0 * first, *rest)]
        found = [refused(example, name, value) for value in tried]
        assert found == [True, sign != "", sign == ">"], name


@pytest.mark.parametrize("entry", BOUNDS.split(";"))
def test_numbers_are_within_their_bounds(entry: str) -> None:
    named_kind, _, terms = entry.partition(":")
    example = example_of(named_kind)
    for name, side, may_be, text in re.findall(r"(\w+)([<>])(=?)(\S+)", terms):
        bound = math.pi / int(text[3:]) if text.startswith("pi/") else float(text)
        kind = float if isinstance(getattr(example, name), float) else int
        step = (1.0 if kind is int else 1e-6 * bound) * (1 if side == "<" else -1)
        found = [refused(example, name, kind(bound + beyond)) for beyond in (-step, 0.0, step)]
        assert found == [False, not may_be, True], name
