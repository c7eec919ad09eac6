"""The task along an estimated surface, by hand and by what holds whatever the axes are."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pydrake.systems.analysis import Simulator
from scipy.spatial.transform import Rotation

from chamfer.models.validation import ParameterError
from chamfer.systems.force.contact_detection import APPROACH, CONTACT, LOST
from chamfer.systems.force.selection import require_projection
from chamfer.systems.force.surface_motion import SurfaceMotion, SurfaceMotionParams

PERIOD = 0.25  # binary, so that the ticks' times are exact
OUTPUTS = ("selection", "desired_force", "desired_position")

angles = st.floats(-math.pi, math.pi)
points = arrays(float, 2, elements=st.floats(-2, 2))
spatial = arrays(float, 3, elements=st.floats(-2, 2))
seeds = st.integers(0, 10_000)


class Driven:
    """The block, ticked with one pair of inputs after the other."""

    def __init__(
        self, start: tuple[float, ...] = (0.0, 0.0), period: float = PERIOD, **changes: Any
    ) -> None:
        axis = {"axis": changes.pop("axis")} if "axis" in changes else {}
        params = SurfaceMotionParams(**changes)
        self.block = SurfaceMotion(params, start=start, period=period, **axis)
        self.d, self.period = len(start), period
        self.simulator = Simulator(self.block)
        self.context: Any = self.simulator.get_mutable_context()
        self.ticks = 0

    def feed(self, position: Any, normal: Any, velocity: Any = None) -> None:
        rate = np.full(self.d, 77.0) if velocity is None else velocity
        self.block.GetInputPort("endpoint_motion").FixValue(
            self.context, np.hstack([position, rate])
        )
        self.block.GetInputPort("normal").FixValue(self.context, normal)

    def read(self, name: str) -> np.ndarray:
        found: np.ndarray = self.block.GetOutputPort(name).Eval(self.context).copy()
        return found

    def tick(self, position: Any, normal: Any) -> np.ndarray:
        """Return the desired position of this instant and let the block store it."""
        self.feed(position, normal)
        if self.ticks > 0:  # advancing to 0 would tick already
            self.simulator.AdvanceTo(self.ticks * self.period)
        found = self.read("desired_position")
        self.simulator.AdvancePendingEvents()
        self.ticks += 1
        return found


def direction(angle: float) -> np.ndarray:
    return np.array([math.cos(angle), math.sin(angle)])


def scaled(vector: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(vector)
    assume(length > 0.1)
    unit: np.ndarray = vector / length
    return unit


# By hand


def test_on_a_level_surface() -> None:
    driven = Driven(start=(0.3, -0.1))
    driven.feed((0.3, -0.1), (0.0, 1.0))
    np.testing.assert_array_equal(driven.read("selection"), [1, 0, 0, 0])
    np.testing.assert_array_equal(driven.read("desired_force"), [0, -5])  # pushes down
    # n x z is +x: 0.5 m/s for 0.25 s.
    np.testing.assert_array_equal(driven.read("desired_position"), [0.425, -0.1])


def test_on_a_slope() -> None:
    driven = Driven(start=(1.0, 2.0), force=10.0, speed=2.0)
    driven.feed((1.0, 2.0), (0.6, 0.8))
    expected = [0.64, -0.48, -0.48, 0.36]
    np.testing.assert_allclose(driven.read("selection"), expected, rtol=0, atol=1e-15)
    np.testing.assert_allclose(driven.read("desired_force"), [-6, -8], rtol=0, atol=1e-15)
    found = driven.read("desired_position")
    np.testing.assert_allclose(found, [1 + 0.5 * 0.8, 2 - 0.5 * 0.6], rtol=0, atol=1e-15)


def test_in_space() -> None:
    # z x x is y; the axis' length and its part along the normal do not count.
    for axis in ((1.0, 0.0, 0.0), (1e9, 0.0, 0.0), (1e-9, 0.0, 0.0), (0.3, 0.0, -9.0)):
        driven = Driven(start=(1.0, 2.0, 3.0), axis=axis)
        driven.feed((1.0, 2.0, 3.0), (0.0, 0.0, 1.0))
        np.testing.assert_array_equal(driven.read("selection"), [1, 0, 0, 0, 1, 0, 0, 0, 0])
        np.testing.assert_array_equal(driven.read("desired_force"), [0, 0, -5])
        found = driven.read("desired_position")
        np.testing.assert_allclose(found, [1, 2.125, 3], rtol=0, atol=1e-15)


def test_published_numbers_are_the_defaults() -> None:
    params = SurfaceMotionParams()
    assert (params.force, params.speed) == (5.0, 0.5)


# The integral


def reference(
    held: np.ndarray, x: np.ndarray, n: np.ndarray, speed: float, axis: Any = (0, 0, 1)
) -> np.ndarray:
    """Return the next desired position, in steps: move, take the error, drop its normal part."""
    across = np.cross(np.append(n, 0.0)[:3], axis)
    along = across[: len(n)] / np.linalg.norm(across)
    error = held + speed * PERIOD * along - x
    found: np.ndarray = x + along * (along @ error)
    if len(n) == 3:
        side = np.cross(n, along)
        found = found + side * (side @ error)
    return found


@given(seed=seeds, speed=st.floats(-3, 3))
def test_any_course_in_the_plane(seed: int, speed: float) -> None:
    rng = np.random.default_rng(seed)
    driven = Driven(start=(0.5, -0.25), speed=speed)
    held = np.array([0.5, -0.25])
    for _ in range(6):
        x, n = rng.normal(size=2), direction(rng.uniform(-4, 4))
        found = driven.tick(x, n)
        held = reference(held, x, n, speed)
        np.testing.assert_allclose(found, held, rtol=0, atol=1e-13)


@given(seed=seeds, axis=spatial)
def test_any_course_in_space(seed: int, axis: np.ndarray) -> None:
    scaled(axis)
    rng = np.random.default_rng(seed)
    driven = Driven(start=(0.5, -0.25, 2.0), axis=tuple(axis.tolist()))
    held = np.array([0.5, -0.25, 2.0])
    for _ in range(6):
        x, n = rng.normal(size=3), scaled(rng.normal(size=3))
        assume(np.linalg.norm(np.cross(n, axis)) > 1e-3)
        found = driven.tick(x, n)
        held = reference(held, x, n, 0.5, axis)
        np.testing.assert_allclose(found, held, rtol=0, atol=1e-12)


@pytest.mark.parametrize("dimension", [2, 3])
@given(seed=seeds)
def test_never_asks_for_motion_along_the_normal(dimension: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    driven = Driven(start=(1.0, 2.0, 3.0)[:dimension])
    for _ in range(5):
        x, n = rng.normal(size=dimension), scaled(rng.normal(size=dimension))
        assert abs(n @ (driven.tick(x, n) - x)) < 1e-14


@given(angle=angles, speed=st.floats(-2, 2))
def test_speed_along_a_plane_if_the_arm_follows(angle: float, speed: float) -> None:
    n = direction(angle)
    along = np.array([n[1], -n[0]])
    driven = Driven(start=(0.3, -0.1), speed=speed)
    x = np.array([0.3, -0.1])
    for tick in range(1, 9):
        x = driven.tick(x, n)
        expected = np.array([0.3, -0.1]) + tick * PERIOD * speed * along
        np.testing.assert_allclose(x, expected, rtol=0, atol=1e-14)


def test_arm_that_lags_or_sinks_in() -> None:
    # Along the surface the desired position goes on by itself, into it it follows the arm.
    driven = Driven(start=(0.0, 0.0))
    found = [driven.tick((0.01 * k, -0.2 * k), (0.0, 1.0)) for k in range(5)]
    expected = [[0.125 * (k + 1), -0.2 * k] for k in range(5)]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-14)


def test_without_speed_the_place_is_held() -> None:
    driven = Driven(start=(0.5, 0.0), speed=0.0)
    for k in range(4):
        found = driven.tick((0.1 * k, -0.3), (0.0, -1.0))
        np.testing.assert_allclose(found, [0.5, -0.3], rtol=0, atol=1e-15)


def test_velocity_is_not_used() -> None:
    driven = Driven()
    found = []
    for velocity in ((0.0, 0.0), (9.0, -9.0)):
        driven.feed((1.0, 2.0), (0.6, 0.8), velocity)
        found.append(driven.read("desired_position"))
    np.testing.assert_array_equal(*found)


# Axes


@given(turn=angles, angle=angles, x=points, start=points)
def test_turned_axes_in_the_plane(
    turn: float, angle: float, x: np.ndarray, start: np.ndarray
) -> None:
    c, s = direction(turn)
    R = np.array([[c, -s], [s, c]])
    plain, turned = Driven(start=tuple(start)), Driven(start=tuple(R @ start))
    for driven, position, normal in (
        (plain, x, direction(angle)),
        (turned, R @ x, R @ direction(angle)),
    ):
        driven.tick(position, normal)
        driven.feed(position + normal, normal)
    for name in ("desired_force", "desired_position"):
        np.testing.assert_allclose(turned.read(name), R @ plain.read(name), rtol=0, atol=1e-13)
    P = plain.read("selection").reshape(2, 2)
    np.testing.assert_allclose(
        turned.read("selection").reshape(2, 2), R @ P @ R.T, rtol=0, atol=1e-14
    )


@given(seed=seeds)
def test_turned_axes_in_space(seed: int) -> None:
    rng = np.random.default_rng(seed)
    R = Rotation.random(rng=rng).as_matrix()
    n, axis, x, start = scaled(rng.normal(size=3)), *rng.normal(size=(3, 3))
    plain = Driven(start=tuple(start), axis=tuple(axis))
    turned = Driven(start=tuple(R @ start), axis=tuple(R @ axis))
    plain.feed(x, n)
    turned.feed(R @ x, R @ n)
    for name in ("desired_force", "desired_position"):
        np.testing.assert_allclose(turned.read(name), R @ plain.read(name), rtol=0, atol=1e-12)
    P = plain.read("selection").reshape(3, 3)
    np.testing.assert_allclose(
        turned.read("selection").reshape(3, 3), R @ P @ R.T, rtol=0, atol=1e-14
    )


@given(angle=angles, x=points, start=points, up=st.sampled_from([1.0, -2.0]))
def test_plane_is_a_plane_in_space(
    angle: float, x: np.ndarray, start: np.ndarray, up: float
) -> None:
    flat = Driven(start=tuple(start), axis=(0.0, 0.0, up))
    deep = Driven(start=(*start, 0.5), axis=(0.0, 0.0, up))
    for _ in range(3):
        found = flat.tick(x, direction(angle))
        expected = deep.tick([*x, 7.0], [*direction(angle), 0.0])
        np.testing.assert_allclose([*found, 0.5], expected, rtol=0, atol=1e-14)
    np.testing.assert_array_equal([*flat.read("desired_force"), 0.0], deep.read("desired_force"))
    P = deep.read("selection").reshape(3, 3)
    np.testing.assert_array_equal(flat.read("selection").reshape(2, 2), P[:2, :2])
    np.testing.assert_array_equal(P[2], [0, 0, 1])


# The block


@pytest.mark.parametrize("dimension", [2, 3])
def test_ports(dimension: int) -> None:
    block = Driven(start=(0.0,) * dimension).block
    inputs = {name: block.GetInputPort(name).size() for name in ("endpoint_motion", "normal")}
    assert inputs == {"endpoint_motion": 2 * dimension, "normal": dimension}
    sizes = [block.get_output_port(i).size() for i in range(3)]
    assert sizes == [dimension**2, dimension, dimension]
    assert [block.get_output_port(i).get_name() for i in range(3)] == list(OUTPUTS)
    passes = [[block.HasDirectFeedthrough(i, j) for j in range(3)] for i in range(2)]
    assert passes == [[False, False, True], [True, True, True]]


def test_between_the_ticks_it_looks_ahead() -> None:
    driven = Driven()
    now = driven.tick((0.0, 0.0), (0.0, 1.0))
    np.testing.assert_array_equal(now, [0.125, 0.0])
    for time in (0.1, 0.2, 0.25):  # at 0.25 s before the tick
        driven.simulator.AdvanceTo(time)
        np.testing.assert_array_equal(driven.read("desired_position"), [0.25, 0.0])


@pytest.mark.parametrize("period", [0.005, 0.125])
def test_ticks_at_its_period(period: float) -> None:
    driven = Driven(period=period)
    driven.feed((0.0, 0.0), (0.0, 1.0))
    driven.simulator.AdvanceTo(10.5 * period)
    # Eleven ticks, and the one that comes.
    np.testing.assert_allclose(driven.read("desired_position"), [6 * period, 0.0], rtol=1e-12)


def test_contexts_are_apart() -> None:
    driven = Driven(start=(0.25, 0.5))
    driven.tick((0.25, 0.5), (0.0, 1.0))
    fresh = Simulator(driven.block).get_mutable_context()
    for name, value in (("endpoint_motion", [0.25, 0.5, 0.0, 0.0]), ("normal", [0.0, 1.0])):
        driven.block.GetInputPort(name).FixValue(fresh, value)
    found = driven.block.GetOutputPort("desired_position").Eval(fresh)
    np.testing.assert_array_equal(found, [0.375, 0.5])


# What is refused


@pytest.mark.parametrize("bad", [math.nan, math.inf])
@pytest.mark.parametrize(
    ("port", "index"), [("endpoint_motion", 0), ("endpoint_motion", 3), ("normal", 1)]
)
def test_inputs_have_to_be_finite(port: str, index: int, bad: float) -> None:
    driven = Driven()
    driven.tick((1.0, 2.0), (0.0, 1.0))
    value = driven.block.GetInputPort(port).Eval(driven.context).copy()
    value[index] = bad
    driven.block.GetInputPort(port).FixValue(driven.context, value)
    for name in OUTPUTS if port == "normal" else ("desired_position",):
        with pytest.raises(ParameterError) as caught:
            driven.read(name)
        assert str(caught.value) == f"{port} is {value.tolist()}, allowed: finite numbers"


@pytest.mark.parametrize("name", OUTPUTS)
@pytest.mark.parametrize("normal", [(0.0, 0.0), (0.0, 1.00001), (0.6, 0.79998), (1.0, 1.0)])
def test_normal_has_to_be_of_unit_length(normal: tuple[float, float], name: str) -> None:
    driven = Driven()
    driven.feed((0.0, 0.0), normal)
    with pytest.raises(ParameterError) as caught:
        driven.read(name)
    allowed = "a vector of length 1 within 1e-06"
    assert str(caught.value) == f"normal is {list(normal)}, allowed: {allowed}"


@pytest.mark.parametrize("off", [-9e-7, 9e-7])
def test_rounding_of_the_normal_is_forgiven(off: float) -> None:
    driven, exact = Driven(), Driven()
    driven.feed((0.1, 0.2), np.array([0.6, 0.8]) * (1 + off))
    exact.feed((0.1, 0.2), (0.6, 0.8))
    require_projection(driven.read("selection").reshape(2, 2))
    for name in OUTPUTS:
        np.testing.assert_allclose(driven.read(name), exact.read(name), rtol=0, atol=1e-14)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_normal_along_the_axis_gives_no_direction(sign: float) -> None:
    driven = Driven(start=(0.0, 0.0, 0.0), axis=(0.0, 3.0, 4.0))
    normal = [0.0, sign * 0.6, sign * 0.8]
    with pytest.raises(ParameterError) as caught:
        driven.tick((0.0, 0.0, 0.0), normal)
    allowed = "a direction other than that of the axis (0.0, 3.0, 4.0)"
    assert str(caught.value) == f"normal is {normal}, allowed: {allowed}"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"force": 0.0}, "force is 0.0, allowed: a finite number > 0"),
        ({"force": -5.0}, "force is -5.0, allowed: a finite number > 0"),
        ({"force": math.nan}, "force is nan, allowed: a finite number > 0"),
        ({"speed": math.inf}, "speed is inf, allowed: a finite number"),
    ],
)
def test_parameters(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError) as caught:
        SurfaceMotionParams(**changes)
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"start": (0.0,)}, "start is (0.0,), allowed: 2 or 3 finite numbers"),
        ({"start": (0.0,) * 4}, "start is (0.0, 0.0, 0.0, 0.0), allowed: 2 or 3 finite numbers"),
        ({"start": (0.0, math.nan)}, "start is (0.0, nan), allowed: 2 or 3 finite numbers"),
        (
            {"axis": (0.0, 0.0, 0.0)},
            "axis is [0.0, 0.0, 0.0], allowed: a finite vector other than zero",
        ),
        (
            {"axis": (0.0, 0.0, math.nan)},
            "axis is [0.0, 0.0, nan], allowed: a finite vector other than zero",
        ),
        (
            {"axis": (0.1, 0.0, 1.0)},
            "axis is (0.1, 0.0, 1.0), allowed: along z in two dimensions",
        ),
        (
            {"axis": (0.0, 1.0, 0.0)},
            "axis is (0.0, 1.0, 0.0), allowed: along z in two dimensions",
        ),
    ],
)
def test_start_and_axis(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError) as caught:
        Driven(**changes)
    assert str(caught.value) == message


# Before contact, in it, and when it is lost


class Guarded(Driven):
    """The block with the mode of contact detection and an approach to follow."""

    def guard(self, mode: int, approach: Any) -> None:
        self.block.GetInputPort("mode").FixValue(self.context, float(mode))
        self.block.GetInputPort("approach").FixValue(self.context, approach)


def test_the_approach_is_followed_in_every_direction() -> None:
    guarded = Guarded(start=(0.0, 1.0))
    guarded.guard(APPROACH, (0.0, 0.75))
    np.testing.assert_array_equal(guarded.tick((0.1, 0.9), (0.0, 1.0)), [0.0, 0.75])
    np.testing.assert_array_equal(guarded.read("selection"), [1, 0, 0, 1])
    # At the contact the motion along the surface goes on from there.
    guarded.guard(CONTACT, (9.0, 9.0))
    np.testing.assert_array_equal(guarded.tick((0.1, 0.7), (0.0, 1.0)), [0.125, 0.7])
    np.testing.assert_array_equal(guarded.read("selection"), [1, 0, 0, 0])
    np.testing.assert_array_equal(guarded.read("desired_force"), [0, -5])


def test_it_waits_for_lost_contact_and_begins_again_with_its_ramp() -> None:
    guarded = Guarded(acceleration=1.0)  # 0.25 m/s a period, up to 0.5
    travelled = []
    for mode in (CONTACT, CONTACT, CONTACT, LOST, CONTACT, CONTACT):
        guarded.guard(mode, (9.0, 9.0))
        travelled.append(guarded.tick((0.0, 0.0), (0.0, 1.0))[0])
    np.testing.assert_allclose(np.diff([0, *travelled]), PERIOD * np.array([1, 2, 2, 0, 1, 2]) / 4)
    np.testing.assert_array_equal(guarded.read("selection"), [1, 0, 0, 0])


def test_the_ramp_has_the_sign_of_the_speed() -> None:
    guarded = Driven(acceleration=1.0, speed=-0.5)
    travelled = [guarded.tick((0.0, 0.0), (0.0, 1.0))[0] for _ in range(3)]
    np.testing.assert_allclose(np.diff([0, *travelled]), -PERIOD * np.array([1, 2, 2]) / 4)


def test_coordinates_beyond_the_normal_are_held() -> None:
    block = SurfaceMotion(
        SurfaceMotionParams(),
        start=(0.0, 0.0, 0.0, 0.7),
        axis=(0.0, -1.0, 0.0),
        dimension=3,
        period=PERIOD,
    )
    context = block.CreateDefaultContext()
    block.GetInputPort("endpoint_motion").FixValue(context, [0.1, 0.2, 0.3, 0.4, *(77.0,) * 4])
    block.GetInputPort("normal").FixValue(context, [0.0, 0.0, 1.0])
    desired, selection, force = (
        block.GetOutputPort(name).Eval(context)
        for name in ("desired_position", "selection", "desired_force")
    )
    np.testing.assert_allclose(desired, [0.125, 0.0, 0.3, 0.7], atol=1e-15)
    np.testing.assert_array_equal(selection.reshape(4, 4), np.diag([1.0, 1.0, 0.0, 1.0]))
    np.testing.assert_array_equal(force, [0, 0, -5, 0])
