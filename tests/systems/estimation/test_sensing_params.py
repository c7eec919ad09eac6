"""What the observers' parameters may be."""

import math
from typing import Any

import numpy as np
import pytest

from chamfer.models.validation import ParameterError
from chamfer.systems.estimation.contact_frame_filter import ContactFrameFilterParams
from chamfer.systems.estimation.normal_filter import ConstrainedFilterParams, SensingParams
from chamfer.systems.estimation.surface_observer import (
    KINDS,
    SurfaceObserver,
    SurfaceObserverParams,
    make_filter,
)

NOT_SQUARE = "2 x 2 or 3 x 3 finite numbers"
NOT_DEFINITE = "symmetric and positive definite"
EVERY = [SensingParams, ConstrainedFilterParams, ContactFrameFilterParams, SurfaceObserverParams]


@pytest.mark.parametrize("params", EVERY)
@pytest.mark.parametrize(
    ("rows", "allowed"),
    [
        ((), NOT_SQUARE),
        (((100.0,),), NOT_SQUARE),
        (((100.0, 0.0),), NOT_SQUARE),
        (((100.0, 0.0), (100.0,)), NOT_SQUARE),
        (((100.0, 0.0), (0.0, 100.0, 0.0)), NOT_SQUARE),
        (((100.0, 0.0, 0.0), (0.0, 100.0, 0.0)), NOT_SQUARE),
        (tuple(map(tuple, np.eye(4).tolist())), NOT_SQUARE),
        (((math.nan, 0.0), (0.0, 100.0)), NOT_SQUARE),
        (((math.inf, 0.0), (0.0, 100.0)), NOT_SQUARE),
        (((100.0, 1.0), (0.0, 100.0)), NOT_DEFINITE),
        (((0.0, 0.0), (0.0, 0.0)), NOT_DEFINITE),
        (((100.0, 0.0), (0.0, 0.0)), NOT_DEFINITE),
        (((100.0, 0.0), (0.0, -1.0)), NOT_DEFINITE),
        (((1.0, 2.0), (2.0, 1.0)), NOT_DEFINITE),
        (((1.0, 0.0, 0.0), (0.0, 1.0, 2.0), (0.0, 2.0, 1.0)), NOT_DEFINITE),
    ],
)
def test_stiffness(params: Any, rows: Any, allowed: str) -> None:
    with pytest.raises(ParameterError) as caught:
        params(stiffness=rows)
    assert str(caught.value) == f"stiffness is {rows!r}, allowed: {allowed}"


@pytest.mark.parametrize("params", EVERY)
@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"force_noise": -1.0}, "force_noise is -1.0, allowed: a finite number >= 0"),
        ({"force_noise": math.inf}, "force_noise is inf, allowed: a finite number >= 0"),
        ({"force_rate_noise": math.nan}, "force_rate_noise is nan, allowed: a finite number >= 0"),
        ({"force_rate_noise": -5.0}, "force_rate_noise is -5.0, allowed: a finite number >= 0"),
        ({"initial_deviation": -0.1}, "initial_deviation is -0.1, allowed: a finite number >= 0"),
        ({"halt_speed": -1e-3}, "halt_speed is -0.001, allowed: a finite number >= 0"),
        ({"smallest_radius": 0.0}, "smallest_radius is 0.0, allowed: a finite number > 0"),
        ({"smallest_radius": math.inf}, "smallest_radius is inf, allowed: a finite number > 0"),
        ({"period": 0.0}, "period is 0.0, allowed: a finite number > 0"),
        ({"period": math.nan}, "period is nan, allowed: a finite number > 0"),
    ],
)
def test_sensing(params: Any, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError) as caught:
        params(**changes)
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("params", "changes", "message"),
    [
        (
            ConstrainedFilterParams,
            {"weights": "posterior"},
            "weights is 'posterior', allowed: sample, prior",
        ),
        (
            ConstrainedFilterParams,
            {"solver": "bisection"},
            "solver is 'bisection', allowed: closed_form, newton",
        ),
        (
            SurfaceObserverParams,
            {"kind": "best"},
            "kind is 'best', allowed: adaptive, thesis, gated, prior_weights, curvature, friction",
        ),
        (ContactFrameFilterParams, {"models": 0}, "models is 0, allowed: 1 to 10"),
        (ContactFrameFilterParams, {"models": 11}, "models is 11, allowed: 1 to 10"),
        (
            ContactFrameFilterParams,
            {"friction_drift": -1e-3},
            "friction_drift is -0.001, allowed: a finite number >= 0",
        ),
        (
            ContactFrameFilterParams,
            {"path_radius": 0.0},
            "path_radius is 0.0, allowed: a finite number > 0",
        ),
        (
            ContactFrameFilterParams,
            {"smoothest_radius": math.nan},
            "smoothest_radius is nan, allowed: a finite number > 0",
        ),
        (
            ContactFrameFilterParams,
            {"switching": 1.0},
            "switching is 1.0, allowed: a probability below 1",
        ),
        (
            ContactFrameFilterParams,
            {"switching": -0.1},
            "switching is -0.1, allowed: a probability below 1",
        ),
        (
            ContactFrameFilterParams,
            {"switching": math.nan},
            "switching is nan, allowed: a probability below 1",
        ),
    ],
)
def test_filters(params: Any, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError) as caught:
        params(**changes)
    assert str(caught.value) == message


def test_what_is_allowed() -> None:
    for kind in KINDS:
        SurfaceObserverParams(
            kind=kind, force_noise=0.0, force_rate_noise=0.0, initial_deviation=0.0, halt_speed=0.0
        )
    ContactFrameFilterParams(models=10, switching=0.0, friction_drift=0.0)
    # Rounding of a product such as R K R^T is no asymmetry.
    SensingParams(stiffness=((100.0, 1e-8), (0.0, 100.0)))


def test_the_default_bound_is_that_of_section_5_2() -> None:
    assert SurfaceObserverParams().smallest_radius == 0.75


TOLD: dict[str, Any] = {
    "stiffness": ((150.0, 40.0), (40.0, 80.0)),
    "force_noise": 0.5,
    "force_rate_noise": 3.0,
}


def test_softest_direction_decides_the_velocity_noise() -> None:
    sensing = SensingParams(**TOLD).sensing
    softest = 115 - math.hypot(35, 40)
    assert sensing.velocity_noise == pytest.approx(3 / softest, rel=1e-12)
    assert (sensing.force_noise, sensing.force_rate_noise) == (0.5, 3.0)
    np.testing.assert_allclose(sensing.compliance @ sensing.stiffness, np.eye(2), atol=1e-15)


@pytest.mark.parametrize("name", [*TOLD, "rate_lag"])
def test_what_a_scenario_leaves_open_is_refused(name: str) -> None:
    params = SurfaceObserverParams(**{**TOLD, "rate_lag": 0.0, name: None})
    for use in (make_filter, lambda left: SurfaceObserver(left, np.array([0.0, 1.0]))):
        with pytest.raises(ParameterError, match=rf"^{name} is None, allowed: a value"):
            use(params)
