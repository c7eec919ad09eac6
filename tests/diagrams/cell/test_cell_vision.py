"""The cell's cameras, what is measured in their images, and where parts at rest look aligned."""

import math
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from chamfer.analysis.linear.simulate import simulate
from chamfer.diagrams.cell import cell_vision
from chamfer.diagrams.cell.alignment import make_alignment_diagram, resolve
from chamfer.diagrams.cell.alignment_scenario import AlignmentScenario
from chamfer.diagrams.cell.cell_vision import (
    VIEWS,
    CameraSettings,
    Measured,
    ViewFrames,
    ViewSettings,
    add_cell_vision,
    camera_placement,
    resolved_cameras,
    true_camera,
)
from chamfer.diagrams.cell.still_vision import StillVision
from chamfer.diagrams.cell.work_cell import ArmName, WorkCellScenario
from chamfer.models.cameras.camera import View
from chamfer.models.cameras.camera_file import CalibratedCamera, CameraFile, camera_text
from chamfer.models.cameras.camera_model import CameraModel
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.models.validation import ParameterError
from chamfer.systems.cameras.camera_image import FrameGrabberParams, Image, SensorParams
from chamfer.systems.force.desired_pose import StoppableMotion
from chamfer.systems.pose import pose_from_vector, pose_vector
from chamfer.systems.vision.detections import Detection, Status, unpack_detections

Array = np.ndarray

PERIOD = 1 / 80
CELL = WorkCellScenario()
STILL = FrameGrabberParams(noise=0.0)


Outputs = dict[str, Array]
Poses = dict[ArmName, RigidTransform]

METHODS: tuple[Measured, ...] = ("image", "metric")


def off(x: float, y: float, z: float, pitch: float, yaw: float) -> Poses:
    p_WT = CELL.nominal_pose("peg").translation() + np.array([x, y, z])
    peg = RigidTransform(RollPitchYaw(0.0, pitch, yaw), p_WT)
    return {"peg": peg, "hole": CELL.nominal_pose("hole")}


PLACES = off(0.0, 0.002, -0.003, -0.04, 0.03)


def seen(
    settings: CameraSettings, places: Poses = PLACES, cell: WorkCellScenario = CELL
) -> Diagram:
    """The cameras around parts that rest."""
    builder = DiagramBuilder()
    ports: dict[ArmName, Any] = {
        arm: builder.AddSystem(ConstantVectorSource(pose_vector(X))).get_output_port()
        for arm, X in places.items()
    }
    error = add_cell_vision(builder, cell, settings, poses=ports, begin=0.02)
    for name in ("error", "valid", "age"):
        builder.ExportOutput(error.GetOutputPort(name), name)
    return builder.Build()


def read(settings: CameraSettings, *around: Any, duration: float = 0.1) -> Outputs:
    """What a controller reads at its ticks: logged before the instant's updates."""
    return dict(simulate(seen(settings, *around), duration=duration, step=PERIOD).outputs)


NEAR = {
    "x": (0.003, 0.0, 0.0, 0.0, 0.0),
    "y": (0.0, 0.003, 0.0, 0.0, 0.0),
    "z": (0.0, 0.0, 0.003, 0.0, 0.0),
    "pitch": (0.0, 0.0, 0.0, 0.05, 0.0),
    "yaw": (0.0, 0.0, 0.0, 0.0, 0.05),
    "all": (-0.002, 0.002, -0.003, -0.04, 0.03),
}


@pytest.mark.parametrize("by", METHODS)
def test_other_parts_are_drawn_and_found(by: Measured) -> None:
    parts = ColouredParts(
        peg_radius=0.006,
        hole_radius=0.0065,
        peg_chamfer_share=0.7,
        peg_colour=(40, 205, 40),
        hole_colour=(205, 40, 205),
    )
    found = read(settings(by), off(*NEAR["y"]), replace(CELL, parts=parts))
    assert found["valid"][-1]
    lacks = [0.0, -6.0, 0.0, 0.0, 0.0, 0.0]
    np.testing.assert_allclose(found["error"][-1], lacks, rtol=0, atol=0.25)


@pytest.mark.parametrize("by", METHODS)
@pytest.mark.parametrize("name", NEAR)
def test_both_measurements_are_what_the_peg_lacks(by: Measured, name: str) -> None:
    x, y, z, pitch, yaw = NEAR[name]
    true = np.array([-x / 0.0005, -y / 0.0005, -z / 0.0005, 0.0, -pitch, -yaw])
    found = read(settings(by), off(*NEAR[name]))
    assert found["valid"][-1]
    error = found["error"][-1]
    # To one image 3 mm towards the camera are 0.6 % more of 30 pixels, from the middle to the tip.
    near = 0.06 if by == "metric" else 0.25
    np.testing.assert_allclose(error[:3], true[:3], rtol=0, atol=near)
    np.testing.assert_allclose(error[3:], true[3:], rtol=0, atol=3e-4)


@pytest.mark.parametrize("by", METHODS)
def test_a_hidden_tip_leaves_all_but_the_way_along(by: Measured) -> None:
    # 5 mm in the hole part: the tip is not seen, the axis passes the mouth 5 mm behind it.
    pitch, yaw, inside = 0.03, -0.02, 0.005
    found = read(settings(by), off(CELL.gap + inside, 0.001, -0.002, pitch, yaw))
    assert found["valid"][-1]
    error = found["error"][-1]
    y, z = 0.001 - inside * yaw, -0.002 + inside * pitch
    assert error[0] == 0.0
    np.testing.assert_allclose(error[1:3], [-y / 0.0005, -z / 0.0005], rtol=0, atol=0.1)
    np.testing.assert_allclose(error[3:], [0.0, -pitch, -yaw], rtol=0, atol=5e-4)


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("gap", [0.03, 0.1])
def test_cameras_look_at_the_middle_of_the_gap(view: Any, gap: float) -> None:
    scenario = WorkCellScenario(gap=gap, meeting_point=(0.01, 0.02, 0.2))
    settings = CameraSettings(distance=0.6, pixel_size=0.0004, roll=0.2)
    camera = camera_placement(settings, scenario, view).camera
    tip, mouth = (scenario.nominal_pose(arm).translation() for arm in ("peg", "hole"))
    np.testing.assert_allclose(camera.project((tip + mouth) / 2), [159.5, 119.5], atol=1e-9)
    way = camera.project(mouth) - camera.project(tip)
    assert np.hypot(*way) == pytest.approx(gap / 0.0004)
    assert math.atan2(way[1], way[0]) == pytest.approx(-0.2)
    assert np.linalg.norm(camera.p_WC - (tip + mouth) / 2) == pytest.approx(0.6)


def test_vtk_without_graphics_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cell_vision, "missing_graphics", lambda: "VTK can't draw here (why)")
    with pytest.raises(ParameterError) as caught:
        read(CameraSettings(renderer="vtk"))
    assert str(caught.value) == (
        "cameras.renderer is 'vtk', allowed: software here: VTK can't draw here (why)"
    )


WRONG = CameraModel(
    focal_length=(1080.0, 1050.0),
    principal_point=(150.0, 128.0),
    distortion=(-0.4, 0.1, 0.01, -0.01, 0.05),
    position=(0.004, -0.003, 0.02),
    tilt=(0.01, -0.02),
    roll=0.05,
)
FIELDS = [one.name for one in fields(CameraModel) if one.name not in ("file", "camera")]


def detected(settings: CameraSettings) -> dict[View, tuple[Detection, ...]]:
    """Peg and hole part in both images, once they are there."""
    diagram = seen(settings)
    simulator = Simulator(diagram)
    simulator.AdvanceTo(0.1)
    found: dict[View, tuple[Detection, ...]] = {}
    for view in VIEWS:
        detector = diagram.GetSubsystemByName(f"{view} detection")
        context = detector.GetMyContextFromRoot(simulator.get_context())
        found[view] = unpack_detections(detector.GetOutputPort("detections").Eval(context))
    return found


def both(**changes: Any) -> dict[str, ViewSettings]:
    return {view: ViewSettings(**changes) for view in VIEWS}


def settings(measured: Measured = "image", **views: ViewSettings) -> CameraSettings:
    return CameraSettings(measured=measured, frames=STILL, **views)  # type: ignore[arg-type]


def test_resolved_cameras_are_all_given_and_stay_as_they_are() -> None:
    plain = replace(settings(), xz=ViewSettings(believed=WRONG), xy=ViewSettings(true=WRONG))
    given = resolved_cameras(plain, CELL)
    for view in VIEWS:
        one = given.view(view)
        for model in (one.believed, one.true):
            assert None not in [getattr(model, name) for name in FIELDS]
        assert one.frames == ViewFrames(**vars(STILL))
    assert given.xz.believed == given.xz.true == WRONG
    assert given.xy.believed != given.xy.true == WRONG
    assert resolved_cameras(given, CELL) == given


@pytest.mark.parametrize("measured", METHODS)
def test_what_is_known_of_a_camera_is_no_error(measured: Measured) -> None:
    plain, known = (
        read(settings(measured, **views))["error"][-1] for views in ({}, both(believed=WRONG))
    )
    # The two see the parts from other places, and know that; images are not measured in depth.
    metric = measured == "metric"
    np.testing.assert_allclose(known[:3], plain[:3], rtol=0, atol=0.1 if metric else 0.5)
    np.testing.assert_allclose(known[3:], plain[3:], rtol=0, atol=5e-4 if metric else 4e-3)


def test_pixels_of_other_sizes_are_made_alike() -> None:
    plain = read(settings())["error"][-1]
    views = {
        "xz": ViewSettings(believed=CameraModel(focal_length=(1200.0, 1200.0))),
        "xy": ViewSettings(believed=CameraModel(position=(0.0, 0.0, 0.1))),
    }
    scaled = settings(**views)
    assert scaled.pixel_scale("xz") == pytest.approx(1 / 1.2)
    assert scaled.pixel_scale("xy") == pytest.approx(0.8)
    np.testing.assert_allclose(read(scaled)["error"][-1][:3], plain[:3], rtol=0, atol=0.2)
    # Believed alone they are wrong by that much.
    wrong = settings(**{view: replace(one, true=_STANDS) for view, one in views.items()})
    error = read(wrong)["error"][-1]
    np.testing.assert_allclose(error[[1, 2]], plain[[1, 2]] * [0.8, 1 / 1.2], rtol=0, atol=1e-9)


@pytest.mark.parametrize("measured", METHODS)
def test_pixels_that_are_no_squares_bias_no_angle_of_a_rolled_camera(measured: Measured) -> None:
    oblong = ViewSettings(believed=CameraModel(focal_length=(1000.0, 1150.0)))
    plain, known = (
        read(replace(settings(measured, **views), roll=0.6))["error"][-1]
        for views in (dict[str, ViewSettings](), {"xz": oblong, "xy": oblong})
    )
    np.testing.assert_allclose(known[:3], plain[:3], rtol=0, atol=0.5)
    np.testing.assert_allclose(known[3:], plain[3:], rtol=0, atol=2e-3)


_STANDS = CameraModel(
    focal_length=(1000.0, 1000.0),
    principal_point=(159.5, 119.5),
    distortion=(0.0, 0.0, 0.0, 0.0, 0.0),
    position=(0.0, 0.0, 0.0),
    tilt=(0.0, 0.0),
    roll=0.0,
)


@pytest.mark.parametrize("view", VIEWS)
def test_images_are_of_the_true_camera(view: View) -> None:
    found = detected(settings(**{view: ViewSettings(true=WRONG)}))
    before = detected(settings())
    expected = WRONG.of(true_camera(settings(), CELL, view))
    for k, (arm, X) in enumerate(PLACES.items()):
        assert found[view][k].status == Status.VALID, arm
        tip = expected.project(X.translation())
        np.testing.assert_allclose(found[view][k].tip, tip, rtol=0, atol=0.15)
    other: View = "xy" if view == "xz" else "xz"
    assert found[other] == before[other]


def moving(cameras: CameraSettings, start: Array, duration: float = 0.5) -> tuple[Outputs, Array]:
    """Errors of a peg that moves as it is desired to, and its velocity, m/s, at the ticks."""
    builder = DiagramBuilder()
    hole = builder.AddSystem(ConstantVectorSource(pose_vector(CELL.nominal_pose("hole"))))
    goal = CELL.nominal_pose("peg")
    begin = goal.translation() + start
    motion = builder.AddSystem(StoppableMotion(begin, goal, duration, PERIOD))
    ports: dict[ArmName, Any] = {
        "peg": motion.GetOutputPort("desired_pose"),
        "hole": hole.get_output_port(),
    }
    error = add_cell_vision(builder, CELL, cameras, poses=ports, begin=0.0, desired=ports)
    for name in ("error", "valid", "age"):
        builder.ExportOutput(error.GetOutputPort(name), name)
    builder.ExportOutput(motion.GetOutputPort("desired_velocity"), "velocity")
    outputs = dict(simulate(builder.Build(), duration=duration, step=PERIOD).outputs)
    return outputs, outputs["velocity"]


# In the image of each camera, not in depth: nearer is larger.
WAYS: dict[View, Array] = {"xz": np.array([0.0, 0.0, -0.03]), "xy": np.array([0.0, 0.02, 0.0])}


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize(
    "frames", [ViewFrames(latency=4), ViewFrames(period=0.02, offset=0.007, latency=2)]
)
def test_what_is_desired_is_as_old_as_the_image_of_each_camera(
    frames: ViewFrames, view: View
) -> None:
    outputs, _ = moving(settings(**{view: ViewSettings(frames=frames)}), WAYS[view])
    valid = outputs["valid"] > 0
    assert valid.sum() > 25
    assert np.abs(outputs["error"][valid][:, 1:3]).max() < 0.06
    assert np.abs(outputs["error"][valid][:, 3:]).max() < 4e-4


def test_dropped_frames_of_a_slow_camera_count_for_all_its_period() -> None:
    slow = ViewFrames(period=2 * PERIOD, miss=0.5, latency=0)
    outputs = read(settings(xy=ViewSettings(frames=slow)), duration=0.6)
    valid, age = outputs["valid"] > 0, outputs["age"] / PERIOD
    assert 0.2 < valid[2:].mean() < 0.8
    for k in range(3, len(age)):
        # Read before the tick's update, an age tells of the tick before.
        if not valid[k - 1]:
            assert age[k] == pytest.approx(age[k - 1] + 1)
        else:
            assert age[k] <= 1 + 1e-9


@pytest.mark.parametrize(("exposure", "offset"), [(0.01, 0.0), (PERIOD, 0.003)])
def test_an_exposure_shows_the_middle_of_its_way(exposure: float, offset: float) -> None:
    frames = ViewFrames(offset=offset)
    way = WAYS["xz"] + WAYS["xy"]
    blurred, _ = moving(
        settings(**both(frames=frames, sensor=SensorParams(exposure=exposure))), way
    )
    sharp, velocity = moving(settings(**both(frames=frames)), way)
    ticks = np.arange(8, 38)
    # What is expected is as old as the middle, half an exposure before its end.
    lag = (blurred["error"] - sharp["error"])[ticks, 1:3] * 0.0005
    np.testing.assert_allclose(lag, 0.0, rtol=0, atol=6e-5)
    assert np.abs(velocity[ticks - 2]).max() * exposure / 2 > 3e-4


def test_a_shutter_that_never_closes_does_not_open_too_early() -> None:
    # By rounding alone it might, and what opens before the exposure ends shows no motion.
    assert (0.003 - PERIOD) % PERIOD < 0.003
    open_ = both(frames=ViewFrames(offset=0.003), sensor=SensorParams(exposure=PERIOD))
    hold = seen(settings(**open_)).GetSubsystemByName("peg as the xz shutter opens")
    assert hold.offset() == 0.003


def test_a_file_is_what_is_believed(tmp_path: Path) -> None:
    path = tmp_path / "camera.yaml"
    calibrated = CalibratedCamera(
        width=320,
        height=240,
        focal_length=(1080.0, 1050.0),
        principal_point=(150.0, 128.0),
        distortion=(-0.4, 0.1, 0.01, -0.01, 0.05),
    )
    path.write_text(camera_text(CameraFile(left=calibrated)))
    cameras = settings(xz=ViewSettings(believed=CameraModel(file=str(path))))
    resolved = resolve(AlignmentScenario(cameras=cameras)).cameras.xz
    expected = replace(WRONG, position=(0.0, 0.0, 0.0), tilt=(0.0, 0.0), roll=0.0)
    assert resolved.believed == resolved.true == expected
    path.write_text("width: 3")
    with pytest.raises(ParameterError, match=r"camera\.yaml: height is None"):
        resolve(AlignmentScenario(cameras=cameras))


def test_a_believed_camera_beyond_the_parts_is_refused() -> None:
    cameras = settings(xz=ViewSettings(believed=CameraModel(position=(0.0, 0.0, 0.6))))
    with pytest.raises(ParameterError, match=r"^cameras\.xz\.believed\.position is .* ahead$"):
        resolved_cameras(cameras, CELL)


def test_parts_that_the_true_camera_does_not_see_are_refused() -> None:
    for name, value in (("tilt", (0.2, 0.0)), ("position", (0.0, 0.2, 0.0))):
        away = settings(xz=ViewSettings(true=CameraModel(**{name: value})))
        said = rf"^cameras\.xz\.true\.{name} is .*; in that of xz, 320 x 240 pixels"
        with pytest.raises(ParameterError, match=said):
            resolve(AlignmentScenario(cameras=away))
    believed = settings(
        xz=ViewSettings(believed=CameraModel(tilt=(0.2, 0.0)), true=CameraModel(tilt=(0.0, 0.0)))
    )
    assert resolve(AlignmentScenario(cameras=believed)).cameras.xz.true.tilt == (0.0, 0.0)


STANDS = resolve(AlignmentScenario())
MOUTH = STANDS.nominal_pose("hole")


def with_true(scenario: AlignmentScenario, **changed: Any) -> AlignmentScenario:
    cameras = scenario.cameras
    for view in VIEWS:
        of = cameras.view(view)
        cameras = cameras.with_view(view, replace(of, true=replace(of.true, **changed)))
    return replace(scenario, cameras=cameras)


def measuring(measured: Measured, scenario: AlignmentScenario = STANDS) -> AlignmentScenario:
    return replace(scenario, cameras=replace(scenario.cameras, measured=measured))


def distance_of(X_WT: RigidTransform | None) -> tuple[float, float, float]:
    """How far a pose is from the aligned one: along and across the axis, m, and turned, rad."""
    assert X_WT is not None
    way = X_WT.translation() - STANDS.nominal_pose("peg").translation()
    axis = X_WT.rotation().matrix()[:, 0]
    return float(way[0]), math.hypot(way[1], way[2]), math.hypot(axis[1], axis[2])


@pytest.mark.parametrize("measured", METHODS)
def test_cameras_without_error_take_aligned_parts_to_be_aligned(measured: Measured) -> None:
    along, across, turned = distance_of(StillVision(measuring(measured)).aligned())
    assert abs(along) < 1e-4
    assert across < 2e-5
    assert turned < 2e-4


@pytest.mark.parametrize("measured", METHODS)
def test_the_error_is_that_of_the_diagram(measured: Measured) -> None:
    frames = FrameGrabberParams(noise=0.0)
    cameras = CameraSettings(measured=measured, frames=frames)
    scenario = resolve(AlignmentScenario(begin=0.1, compensation_time=0.05, cameras=cameras))
    scenario = with_true(scenario, focal_length=(1010.0, 1010.0), roll=0.02)
    outputs = simulate(
        make_alignment_diagram(scenario), duration=scenario.duration, step=1 / 80
    ).outputs
    first = int(np.flatnonzero(outputs["valid"])[0])
    # Of the frame that has arrived a period before, when it was a period old.
    X_WT, X_WM = (
        pose_from_vector(outputs[f"{arm}.true_pose"][first - 2]) for arm in ("peg", "hole")
    )
    expected = StillVision(scenario).error(X_WT, X_WM)
    scale = np.array([scenario.cameras.pixel_size] * 3 + [1.0] * 3)
    found = outputs["error"][first] * scale
    np.testing.assert_allclose(found, expected, rtol=0, atol=2e-5)


def test_coinciding_axes_coincide_in_space_whatever_the_pinhole_camera() -> None:
    for change in (
        {"focal_length": (1200.0, 1200.0)},
        {"principal_point": (175.0, 110.0)},
        {"roll": 0.1},
        {"tilt": (0.03, -0.03)},
        {"position": (0.01, -0.01, 0.1)},
    ):
        _, across, turned = distance_of(StillVision(with_true(STANDS, **change)).aligned())
        assert across < 5e-5, change
        assert turned < 3e-4, change


@pytest.mark.parametrize("offset", [-0.02, 0.01])
def test_distortion_turns_parts_that_are_off_the_axis(offset: float) -> None:
    """By about 0.94 |k1| d in each of the two planes together, d the distance in m."""
    known = replace(STANDS.cameras.xz.believed, position=(0.0, offset, 0.0))
    bent = replace(known, distortion=(-1.0, 0.0, 0.0, 0.0, 0.0))
    found = []
    for believed in (known, bent):  # what is believed of the lens too is straightened
        views = both(believed=believed, true=bent)
        scenario = replace(STANDS, cameras=replace(STANDS.cameras, **views))
        found.append(distance_of(StillVision(scenario).aligned()))
    (_, across, turned), (*_, straightened) = found
    assert turned == pytest.approx(0.94 * abs(offset), rel=0.06)
    assert across < 0.015 * abs(offset)
    assert straightened < 1e-3


def test_parts_that_are_not_found_are_nowhere() -> None:
    def black(image: Image) -> Image:
        return np.zeros_like(image)

    assert StillVision(STANDS, black).aligned() is None
    away = with_true(STANDS, tilt=(0.3, 0.3))
    assert StillVision(away).aligned() is None
    assert not np.isfinite(StillVision(away).error(STANDS.nominal_pose("peg"), MOUTH)).all()


@pytest.mark.parametrize("radius", [0.004, 0.010035])
def test_square_parts_are_measured_like_round_ones_but_for_the_gap(radius: float) -> None:
    names = ("chamfer_width", "peg_length", "hole_length", "outer_radius")
    lengths = {name: getattr(STANDS.parts, name) * radius / 0.010035 for name in names}
    parts = replace(
        STANDS.parts, section="square", hole_radius=radius, peg_radius=0.98 * radius, **lengths
    )
    sight = StillVision(resolve(AlignmentScenario(parts=parts)))
    X_WT = RigidTransform(RollPitchYaw(0.0, 0.02, -0.03), [-0.03, 0.002, 0.157])
    _, y, z, _, pitch, yaw = sight.error(X_WT, MOUTH)
    assert [y, z] == pytest.approx([-0.002, 0.001], abs=6e-5)
    assert [pitch, yaw] == pytest.approx([-0.02, 0.03], abs=5e-4)
    # What is seen of an end face is its far edge: the gap looks narrower by r over the distance.
    along = sight.error(STANDS.nominal_pose("peg"), MOUTH)[0]
    assert along == pytest.approx(-STANDS.gap * radius / STANDS.cameras.distance, abs=1e-4)
