"""The unknown wall's place and shape, what is told of it, and the loop's wiring."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from chamfer.diagrams.surface.surface_scenario import SurfaceShape
from chamfer.diagrams.surface.unknown_wall_loop import (
    ADEPT_WALL,
    PLANAR_WALL,
    PUMA_WALL,
    UnknownWallScenario,
    UnknownWallSettings,
    make_unknown_wall_diagram,
    resolve_wall,
)
from chamfer.models.surfaces.surface import locate
from chamfer.models.validation import ParameterError

SCENARIOS = [ADEPT_WALL, PUMA_WALL, PLANAR_WALL]
each = pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda one: one.ARM.name)
ALONG, UP = np.array([0.0, 1.0, 0.0]), np.array([-1.0, 0.0, 0.0])


@pytest.mark.parametrize("shape", ["parabola", "circle", "wave", "paraboloid", "sphere"])
def test_the_wall_rises_along_and_sideways_as_it_is_told(shape: SurfaceShape) -> None:
    point = np.array([0.5, -0.2, 0.3])
    level = {"amplitudes": (0.0,)} if shape == "wave" else {}

    def away(**turned: float) -> np.ndarray:
        settings = UnknownWallSettings(shape=shape, **level, **turned)  # type: ignore[arg-type]
        gap, normal = locate(settings.placed(point, along=ALONG, up=UP), point)
        assert gap == pytest.approx(0, abs=1e-12)
        return normal

    np.testing.assert_allclose(away(), UP, atol=1e-12)
    # A wall that rises along the motion leans back from it.
    np.testing.assert_allclose(
        away(tilt=0.2), math.cos(0.2) * UP - math.sin(0.2) * ALONG, atol=1e-12
    )
    sideways = np.cross(UP, ALONG)
    np.testing.assert_allclose(
        away(roll=0.2), math.cos(0.2) * UP - math.sin(0.2) * sideways, atol=1e-12
    )


def test_a_curve_is_drawn_out_sideways_and_bends_along() -> None:
    wall = UnknownWallSettings(shape="parabola", coefficients=(0.5,))
    placed = wall.placed(np.zeros(3), along=ALONG, up=UP)
    sideways = np.cross(UP, ALONG)
    for far in (-2.0, 3.0):
        at = 0.1 * ALONG + 0.5 * 0.1**2 * UP + far * sideways
        assert placed.level(at) == pytest.approx(0, abs=1e-12)


@each
def test_the_arm_would_touch_where_it_believes(scenario: UnknownWallScenario) -> None:
    q = scenario.joint_positions(scenario.touching)
    tip = scenario.dynamics().evaluate(q, np.zeros(len(q))).p_WC
    gap, normal = locate(scenario.make_surface(), tip)
    assert gap == pytest.approx(0, abs=1e-12)
    off = math.acos(normal @ scenario.spatial_up)
    assert off == pytest.approx(math.hypot(scenario.surface.tilt, scenario.surface.roll), abs=1e-9)
    # With the believed normal the motion is along ``along`` (5-6).
    np.testing.assert_allclose(
        np.cross(scenario.spatial_up, scenario.axis), scenario.spatial_along, atol=1e-12
    )


def test_what_the_observer_is_told() -> None:
    observer = resolve_wall(ADEPT_WALL).observer
    np.testing.assert_allclose(observer.stiffness, 1e3 * np.eye(3), atol=1e-9)
    # The sensor's noise is uniform, of a half-width of 0.5 N, and decoupled: C = 0.9 I + 0.1.
    undone = np.linalg.inv(0.9 * np.eye(3) + 0.1)
    assert observer.force_noise == pytest.approx(0.5 / math.sqrt(3) * np.linalg.norm(undone))
    assert observer.rate_lag == 0.1
    own = replace(ADEPT_WALL.observer, force_noise=2.0, kind="gated")
    told = resolve_wall(replace(ADEPT_WALL, observer=own)).observer
    assert told.force_noise == 2.0
    assert told.rate_lag is None
    assert told.force_rate_noise == pytest.approx(
        2.0 * observer.force_rate_noise / observer.force_noise  # type: ignore[operator]
    )


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"surface": {"roll": 0.1}}, "surface.shape is 'circle', allowed: one of the plane"),
        ({"surface": {"shape": "sphere"}}, "surface.shape is 'sphere', allowed: one of the plane"),
        ({"task": {"along": (1.0, 0.1)}}, "task.along is (1.0, 0.1), allowed: at right angles"),
        ({"observer": {"period": 0.012}}, "controller.period is 0.005, allowed: a whole part"),
    ],
)
def test_refusals(changes: dict[str, dict[str, Any]], message: str) -> None:
    scenario = PLANAR_WALL
    parts = {name: replace(getattr(scenario, name), **values) for name, values in changes.items()}
    with pytest.raises(ParameterError) as caught:
        replace(scenario, **parts)
    assert str(caught.value).startswith(message)


@each
@pytest.mark.parametrize("sensing", ["ideal", "realistic"])
def test_controller_and_observer_know_sensors_only(
    wires: Any, known_to: Any, scenario: UnknownWallScenario, sensing: Any
) -> None:
    found = wires(make_unknown_wall_diagram(resolve_wall(replace(scenario, sensing=sensing))))
    arm = "manipulator and contact"
    for block in ("surface estimator", "task", "hybrid control", arm):
        assert arm in known_to(found, block)
    sensors = {"force sensor", "encoders", "friction compensation"}  # that has one of its own
    if sensing == "realistic":
        assert {wire[2] for wire in found if wire[0] == arm} <= sensors
