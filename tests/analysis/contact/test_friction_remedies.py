from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from chamfer.analysis.campaign.trial_metrics import trial_seed
from chamfer.analysis.contact.contact_runs import measure, run_contact
from chamfer.analysis.contact.friction_remedies import (
    REMEDIES,
    TESTS,
    RemediesScenario,
    resolve_friction_remedies,
    run_remedies,
)
from chamfer.analysis.scenario.experiment import quiet
from chamfer.diagrams.contact.contact_scenarios import AdeptLoop
from chamfer.models.validation import ParameterError
from chamfer.systems.force.friction_compensation import FrictionCompensationParams


def short() -> RemediesScenario:
    """Both tests near the surface and for 0.6 s, one seed."""
    default = RemediesScenario()
    roller, nugget = (
        replace(
            test,
            duration=0.6,
            measure_after=0.4,
            task=replace(test.task, start=start, distance=0.001, speed=0.01),
        )
        for test, start in (
            (default.roller, (0.5, -0.3, 0.3, 0.0)),
            (default.nugget, (0.499, -0.3, 0.3, 0.0)),
        )
    )
    with pytest.warns(UserWarning, match="unstable in contact, sliding ahead"):  # on rubber
        return resolve_friction_remedies(
            replace(default, roller=roller, nugget=nugget, trials=1)  # type: ignore[arg-type]
        )


SCENARIO = short()


def test_a_remedys_row_is_its_run() -> None:
    outcome = run_remedies(SCENARIO, 5, quiet)
    remedied = replace(
        SCENARIO.nugget,
        sensor=replace(SCENARIO.nugget.sensor, decoupling=True),
        friction_compensation=FrictionCompensationParams(bandwidth=20.0),
    )
    traces = run_contact(remedied, trial_seed(5, 0))
    values = measure(remedied, traces)
    name = "nugget.compensation_decoupling"
    after = traces["time"] >= 0.4
    for metric, expected in (
        ("force.deviation", values["force.deviation"]),
        ("position.lag_error", values["position.lag_error"]),
        ("force.true_deviation", np.abs(traces["force"][after] - 5.0).max()),
    ):
        assert outcome.metrics[f"{name}.{metric}"].value == expected


def applied(remedy: str, test: AdeptLoop) -> AdeptLoop:
    for change in REMEDIES[remedy]:
        test = change(test, SCENARIO)
    return test


def test_each_remedy_changes_what_its_name_says() -> None:
    test = SCENARIO.roller
    assert applied("none", test) == test

    def only(remedy: str, **values: Any) -> None:
        assert applied(remedy, test) == replace(test, **values), remedy

    arm, sensor, controller = test.arm, test.sensor, test.controller
    decoupled = replace(sensor, decoupling=True)
    full = replace(controller, full_dynamics=True)
    fed = FrictionCompensationParams(bandwidth=20.0)
    friction = arm.joint_friction
    smooth = replace(arm, joint_friction=replace(friction, coulomb=(0.0, 0.0, 0.0, 0.0)))
    less = tuple(value / 2 for value in friction.coulomb)
    half = replace(arm, joint_friction=replace(friction, coulomb=less))
    soft = replace(test.surface, stiffness=3e3, damping=15.0)
    swings = replace(controller, allow_unstable=True)
    only("rubber_cover", surface=soft, controller=swings)
    only("decoupling", sensor=decoupled)
    only("full_dynamics", controller=full)
    only("half_friction", arm=half)
    only("compensation", friction_compensation=fed)
    only("compensation_decoupling", friction_compensation=fed, sensor=decoupled)
    only("all", friction_compensation=fed, sensor=decoupled, controller=full)
    only("no_friction", arm=smooth)
    only("no_friction_decoupling", arm=smooth, sensor=decoupled)


def test_both_tests_are_resolved() -> None:
    for name in TESTS:
        test = getattr(SCENARIO, name)
        far = replace(test, task=replace(test.task, distance=2.0, direction=(1.0, 0.0, 0.0, 0.0)))
        with pytest.raises(ParameterError, match="endpoint is"):
            resolve_friction_remedies(replace(SCENARIO, **{name: far}))
