"""The loop of a position-controlled arm in contact: bounds of the literature, design, refusals."""

import math
from dataclasses import replace
from typing import Any, Final

import numpy as np
import pytest

from chamfer.analysis.insertion.admittance_stability import computed_border, delayed_border
from chamfer.diagrams.contact.hybrid_loop_stability import stability_of
from chamfer.diagrams.insertion.contact_loop import (
    ContactLoop,
    designed_damping,
    remedies,
    require_stable,
)
from chamfer.models.arms.position_arm import ServoParams
from chamfer.models.arms.wrist import WristParams
from chamfer.models.validation import ParameterError
from chamfer.systems.force.contact_admittance import ContactAdmittanceParams

X: Final = 3  # into the hole, of the six
NONE: Final = (0.0,) * 6
K: Final = 1e4  # N/m, of springs and contact in series
TOOL: Final = WristParams(
    stiffness=(2e3, 2e3, 2e3, 3e5, 3e5, 1e6),
    damping_ratio=0.3,
    mass=1.0,
    inertia=4e-3,
    centre_of_mass=0.03,
)


class Rigid(ServoParams):
    """Joints that are where they are told to be."""

    frequency = 1e5  # rad/s


def bare(
    delay: int, *, mass: float = 0.0, spring: float = 0.0, rate: float = 500.0
) -> ContactLoop:
    """Return a loop of nothing but the law, a delay in samples and springs of a light tool."""
    return ContactLoop(
        servo=Rigid(rate=rate, delay=delay),
        admittance=ContactAdmittanceParams(
            inertia=(0.0,) * 3 + (mass,) * 3,
            spring=(1.0,) * 3 + (max(spring, 1e-6),) * 3,
            damping=(1e3,) * 6,
        ),
        wrist=WristParams(
            stiffness=(10.0,) * 3 + (2 * K,) * 3, mass=1e-5, inertia=1e-8, centre_of_mass=0.0
        ),
        contact=(10.0,) * 3 + (2 * K,) * 3,
    )


def with_tool(**changes: Any) -> ContactLoop:
    parts: dict[str, Any] = {
        "servo": ServoParams(),
        "admittance": ContactAdmittanceParams(),
        "wrist": TOOL,
        "contact": (200.0,) * 3 + (1e6,) * 3,
        "bandwidth": 100.0,
    }
    return ContactLoop(**parts | changes)


def least(loop: ContactLoop) -> float:
    """Return the D of x at which the loop's stability in contact ends, N s/m."""
    return loop.damping[X] * computed_border(loop, X)


@pytest.mark.parametrize(("mass", "spring"), [(0.0, 0.0), (2.0, 0.0), (0.0, 2e3), (5.0, 1e3)])
def test_sampled_bounds(mass: float, spring: float) -> None:
    T = 1 / 500
    # Without a delay f' = (1 - kappa) f, stable below 2; the mass apart.
    if not mass:
        assert least(bare(0, spring=spring)) == pytest.approx(K * T / 2 - spring * T / 2, rel=0.01)
    # With one sample kappa < 1 - mu, whatever the mass.
    assert least(bare(1, mass=mass, spring=spring)) == pytest.approx((K - spring) * T, rel=0.01)


@pytest.mark.parametrize(("mass", "spring"), [(0.0, 0.0), (2.0, 0.0), (0.0, 2e3), (5.0, 1e3)])
def test_long_delay_is_that_of_continuous_time(mass: float, spring: float) -> None:
    loop = bare(20, mass=mass, spring=spring, rate=1000.0)
    # Held over a sample and read before it, as long as summed backwards: nothing is added.
    expected = delayed_border(K, 0.02, mass, spring)
    assert least(loop) == pytest.approx(expected, rel=0.03)
    if not (mass or spring):
        assert expected == pytest.approx(2 * K * 0.02 / math.pi)


def test_designed_against_a_pure_delay_is_twice_k_tau() -> None:
    loop = bare(20, rate=1000.0)
    loop = replace(loop, admittance=replace(loop.admittance, damping=None))
    assert designed_damping(loop)[X] == pytest.approx(2 * K * 0.02, rel=0.03)


REMOTE: Final = replace(TOOL, centre=0.08, stiffness=(300.0, 300.0, 200.0, 5e4, 5e4, 1e5))


@pytest.mark.parametrize("tool", [TOOL, REMOTE], ids=["tool", "rcc"])
def test_designed_bears_every_softer_contact(tool: WristParams) -> None:
    loop = with_tool(wrist=tool)
    names = [one.name for one in loop.loops()][::2]
    assert names == ["rx in contact", "ry, z in contact", "rz, y in contact", "x in contact"]
    assert (stability_of(loop.loops()).gain_margin or 0) > 3
    given = replace(loop.admittance, damping=loop.damping)
    for share in np.geomspace(1e-4, 1.0, 9).tolist():
        softer = tuple(share * k for k in loop.contact)
        assert not replace(loop, admittance=given, contact=softer).unstable, share


def test_axes_are_the_holes() -> None:
    # The wrist's z is the hole's -x, its x the hole's z.
    tool = replace(TOOL, stiffness=(1e3, 2e3, 3e3, 1e5, 2e5, 3e5))
    assert np.diag(with_tool(wrist=tool).springs) == pytest.approx((3e3, 2e3, 1e3, 3e5, 2e5, 1e5))
    remote = np.diag(with_tool(wrist=replace(tool, centre=0.1)).springs)
    # A turn about the hole's y moves the centre along its z.
    assert remote == pytest.approx((3e3, 2e3 + 1e3, 1e3 + 2e3, 3e5, 2e5, 1e5))


def test_each_remedy_is_where_stability_begins() -> None:
    damping = (5.0, 5.0, 5.0, 2000.0, 1e4, 1e4)
    loop = with_tool(admittance=ContactAdmittanceParams(damping=damping))
    found = remedies(loop)
    assert None not in found
    assert list(found.damping or ()) == ["x"]
    for off, stable in ((0.99, False), (1.01, True)):
        more = (*damping[:X], off * (found.damping or {})["x"], *damping[X + 1 :])
        changed = with_tool(admittance=ContactAdmittanceParams(damping=more))
        assert (not changed.unstable) is stable
        softer = tuple(k * (found.softer or 0) / off for k in TOOL.stiffness)
        changed = replace(loop, wrist=replace(TOOL, stiffness=softer))
        assert (not changed.unstable) is stable
        times = (found.faster or 0) * off
        servo = ServoParams(rate=500 * times, bandwidth=20 * times)
        assert (not replace(loop, servo=servo).unstable) is stable
    with pytest.raises(ParameterError) as refused:
        require_stable(loop)
    assert str(refused.value) == (
        "admittance.damping is (5.0, 5.0, 5.0, 2000.0, 10000.0, 10000.0), allowed: at least "
        "2.68e+03 N s/m of x or a compliance at most 0.62 times as stiff or servos "
        "1.42 times as fast, in rate and bandwidth: the loop of x in contact grows at 11.6 1/s"
    )


def test_a_heavy_tool_shakes_in_the_air() -> None:
    damping = (5.0, 5.0, 5.0, 20.0, 1e4, 1e4)
    loop = with_tool(admittance=ContactAdmittanceParams(damping=damping), contact=NONE)
    with pytest.raises(ParameterError, match=r"59.7 N s/m of x or a compliance .* of x .* grows"):
        require_stable(loop)
    light = replace(TOOL, mass=0.1)
    require_stable(replace(loop, wrist=light))
