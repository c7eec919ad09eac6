"""The visual grasp on ideal cross-sections of a pinhole camera that moves with the carriage."""

import math
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from chamfer.models.cameras.camera import CameraPlacement
from chamfer.systems.primitives.primitive import STILL, Observation
from chamfer.systems.primitives.vision_primitives import VisGrasp
from chamfer.systems.primitives.visual_servoing import Servoing
from chamfer.systems.vision.detections import CrossSection, Status, pack_cross_section

Array = np.ndarray
FRAME = 0.03  # s, three ticks
DEPTH = 0.2  # m
CAMERA = CameraPlacement(view="xy", distance=DEPTH, roll=0.0).camera


def seen(carriage: Array, centre: Array, angle: float, shift: float = 0.0) -> CrossSection:
    """A section 60 px long and 20 wide; its edges ahead and back differ by twice the shift."""
    turn = Rotation.from_rotvec(carriage[:3]).as_matrix()
    camera = CAMERA.placed(turn @ CAMERA.R_WC, carriage[3:] + turn @ [0, 0, DEPTH])
    ahead = centre + 1e-4 * np.array([math.cos(angle), math.sin(angle), 0.0])
    pixel, other = camera.project(np.array([centre, ahead]))
    u, v = pixel.tolist()
    way = math.remainder(math.atan2(*(other - pixel)[::-1]), math.pi)
    edges = (30.0 + shift, 30.0 - shift, 10.0, 10.0)
    return CrossSection(status=Status.VALID, centroid=(u, v), angle=way, edges=edges)


def run(primitive: Any, start: Any, *, angle: float = 0.3, shift: float = 0.0) -> tuple[Any, Any]:
    """Return event and path of a carriage that obeys at once; frames arrive one period late."""
    carriage, memory, event = np.array(start, dtype=float), None, None
    blank = tuple(pack_cross_section(CrossSection(status=Status.NO_IMAGE)).tolist())
    underway, arrived, path = blank, blank, []
    for k in range(400):
        if k % 3 == 0:
            section = seen(carriage, np.array([0.002, -0.003, 0.0]), angle, shift)
            arrived, underway = underway, tuple(pack_cross_section(section).tolist())
            path.append(carriage.copy())
        sensed = Observation(tuple(carriage.tolist()), STILL, STILL, cross_section=arrived)
        if memory is None:
            memory = primitive.begin(sensed)
        memory, velocity, event = primitive.step(sensed, memory, k * 0.01)
        if event is not None:
            break
        carriage += 0.01 * np.array(velocity)
    return event, np.array(path)


SERVOING = Servoing(period=FRAME)
START = (0, 0, -0.4, 0.02, 0.015, 0.0)


@pytest.mark.parametrize("turned", [0.0, 0.5, -1.0])
def test_jacobian_is_the_derivative_of_what_is_seen(turned: float) -> None:
    carriage = np.array([0, 0, turned, 0.01, -0.005, 0.0])
    primitive = VisGrasp(camera=CAMERA, depth=DEPTH)
    centre = np.array([0.002, -0.003, 0.0])

    def features(at: Array) -> Array:
        section = seen(at, centre, 0.3)
        return np.array([*section.centroid, section.angle])

    step, columns = 1e-6, []
    for k in (3, 4, 2):
        way = step * np.eye(6)[k]
        columns.append((features(carriage + way) - features(carriage - way)) / (2 * step))
    found = primitive.jacobian(features(carriage)[:2], (0.0, 0.0, turned))
    np.testing.assert_allclose(found, np.transpose(columns), rtol=1e-4, atol=1e-2)


@pytest.mark.parametrize("focal_factor", [0.8, 1.2])
@pytest.mark.parametrize("turn", [(0.175, 0, 0), (0, -0.175, 0), (0, 0, 0.175), (0.1, 0.1, -0.1)])
def test_it_settles_with_a_wrong_camera(focal_factor: float, turn: Any) -> None:
    wrong = CAMERA.miscalibrated(focal_factor=focal_factor, turn=turn)
    event, path = run(VisGrasp(camera=wrong, depth=DEPTH, servoing=SERVOING), START)
    assert event == "done"
    np.testing.assert_allclose(path[-1][3:5], [0.002, -0.003], atol=2.6e-4)  # 0.5 px
    assert path[-1][2] == pytest.approx(0.3, abs=0.006)
    assert not path[:, [0, 1, 5]].any()  # nothing but x, y and the turn about z


def test_it_goes_the_short_way_round() -> None:
    primitive = VisGrasp(camera=CAMERA, depth=DEPTH, servoing=SERVOING)
    _, path = run(primitive, (0, 0, 0, 0, 0, 0), angle=2.8)
    # A line at 2.8 rad is one at 2.8 - pi.
    assert path[-1][2] == pytest.approx(2.8 - math.pi, abs=0.006)


def test_between_the_edges() -> None:
    primitive = VisGrasp(camera=CAMERA, depth=DEPTH, centre="edges", servoing=SERVOING)
    event, path = run(primitive, START, angle=0.0, shift=4.0)
    assert event == "done"
    # The middle is 4 px, 2 mm, ahead of the centroid, on whichever side that is.
    assert abs(path[-1][3] - 0.002) == pytest.approx(0.002, abs=2.6e-4)
    assert path[-1][4] == pytest.approx(-0.003, abs=2.6e-4)


def test_a_round_section_is_centred_only() -> None:
    section = CrossSection(status=Status.VALID, centroid=(170.0, 110.0), edges=(9.0,) * 4)
    packed = tuple(pack_cross_section(section).tolist())
    sensed = Observation(STILL, STILL, STILL, cross_section=packed)
    aligning, centring = (VisGrasp(camera=CAMERA, align=align) for align in (True, False))
    assert centring.label == "vis_centre"
    stepped = aligning.step(sensed, aligning.begin(sensed), 0.0)
    assert stepped.velocity == STILL  # it has no direction
    velocity = centring.step(sensed, centring.begin(sensed), 0.0).velocity
    assert velocity[:3] == (0.0, 0.0, 0.0)
    # It is seen to the right and above: along X and along Y.
    assert velocity[3] > 0
    assert velocity[4] > 0


@pytest.mark.parametrize("status", [None, Status.NO_IMAGE, Status.AT_BORDER])
def test_without_a_section_it_stands_still_and_is_lost(status: Status | None) -> None:
    vector = None
    if status is not None:
        vector = tuple(pack_cross_section(CrossSection(status=status)).tolist())
    sensed = Observation(STILL, STILL, STILL, cross_section=vector)
    primitive = VisGrasp(camera=CAMERA, servoing=SERVOING)
    memory, event, k = primitive.begin(sensed), None, 0
    while event is None:
        memory, velocity, event = primitive.step(sensed, memory, k * 0.01)
        assert velocity == STILL
        k += 1
    assert (event, k) == ("lost", 31)
