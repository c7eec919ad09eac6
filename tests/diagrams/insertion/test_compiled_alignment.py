from dataclasses import replace

import numpy as np
import pytest

from chamfer.analysis.insertion.cell_runs import run_cell_insertion
from chamfer.diagrams.cell.controller_design import _ControlledArm
from chamfer.diagrams.insertion.compiled_alignment import (
    Alignments,
    Draws,
    arms_alone,
    friction_torque,
    growth,
    run_alignments,
    sure_errors,
)
from chamfer.diagrams.insertion.insertion import (
    InsertionScenario,
    ResolvedInsertionScenario,
    resolve,
)
from chamfer.systems.strategies.insertion_decision import measured_errors
from chamfer.systems.vision.cell_error import AXES

ACROSS = ("y", "z", "pitch", "yaw")
USUAL = InsertionScenario(initial_error=(0.0,) * 6)
CELL = resolve(USUAL)
FIXTURE = resolve(replace(USUAL, hole=replace(USUAL.hole, kind="fixture"), compensated="peg"))


def drawn(cell: ResolvedInsertionScenario, error: tuple[float, ...] = (0.0,) * 6) -> Draws:
    ones = np.ones((1, len(cell.arms)))
    payload = ones * cell.peg.payload_error
    return Draws(np.array([error]), payload, ones, ones, np.zeros((1, 6)))


def aligned(cell: ResolvedInsertionScenario, draws: Draws) -> Alignments:
    return run_alignments(cell, draws, start=np.zeros(6), spread=np.zeros(6))


@pytest.mark.parametrize(("kind", "uneven"), [("fsm", 0.0), ("pid", 0.0), ("fsm", 0.9)])
def test_a_start_goes_as_in_the_diagram(kind: str, uneven: float) -> None:
    error = (0.0, 0.006, -0.004, 0.0, 0.05, -0.03)
    peg = replace(USUAL.peg, friction_asymmetry=(uneven,) * 7)
    cell = resolve(replace(USUAL, peg=peg, controller=replace(USUAL.controller, kind=kind)))  # type: ignore[arg-type]
    found = aligned(cell, drawn(cell, error))
    traces = run_cell_insertion(replace(cell, initial_error=error), 0, until_advance=True).traces
    tick = cell.cameras.frames.period
    count = int((traces["time"][-1] - cell.begin) / tick)
    rows = np.searchsorted(traces["time"], cell.begin + tick * np.arange(count) - 1e-9)
    true = np.column_stack([traces[f"true_{axis}"][rows] for axis in ACROSS])
    off = np.abs(found.course[0, :count][:, [AXES.index(axis) for axis in ACROSS]] - true)
    assert off[:, :2].max() < 4e-4  # m, of 7 mm
    assert off[:, 2:].max() < 4e-3  # rad, of 60 mrad
    assert found.decided[0] == pytest.approx(traces["time"][-1] - cell.begin, abs=0.05)


def test_the_loop_grows_as_the_simulated_one_does() -> None:
    for damping in (0.7, 0.1):
        impedance = replace(CELL.impedance, damping_ratio=damping)
        cell = replace(FIXTURE, impedance=impedance)
        smooth = replace(cell.peg, joint_friction=(0.0,) * 7, payload_error=0.0)
        alone = replace(arms_alone(cell), peg=smooth)
        sizes = np.abs(np.linalg.eigvals(_ControlledArm(alone, "peg").rest()[1]))
        draws = drawn(cell)._replace(payload=np.zeros((1, 1)))
        assert growth(cell, draws) == pytest.approx(sizes[sizes < 1 - 1e-7].max(), abs=1e-5)


def test_stiff_wrists_grow_with_torques_that_come_late() -> None:
    stiff = replace(CELL.impedance, rotational_stiffness=(40.0,) * 3)
    cell = replace(CELL, impedance=stiff)
    assert growth(cell, drawn(cell)) < 1 < growth(cell, drawn(cell), late=True)


def test_an_unknown_payload_sags_by_its_weight_over_the_stiffness() -> None:
    still = replace(FIXTURE, compensated="none")
    smooth = drawn(still)._replace(friction=np.zeros((1, 1)))
    sag = aligned(still, smooth).course[0, 0]
    weight = 9.81 * CELL.peg.payload_error
    assert sag[AXES.index("z")] == pytest.approx(weight / 400, rel=0.01)
    # Behind the tip, it tips the peg up: about -Y by 0.07 m times its weight.
    assert sag[AXES.index("pitch")] == pytest.approx(0.07 * weight / 5, rel=0.01)


def test_dry_friction_holds_up_to_its_torque_and_then_slides() -> None:
    for push, left in ((0.05, 0.0), (0.3, 0.2)):  # N m, of 0.1 N m on 1 kg m^2
        speed, torque = np.array([0.0]), np.zeros(1)
        for _ in range(100):
            speed += 0.002 * push
            friction_torque(speed, torque, np.eye(1), np.array([0.1]), 1e4, 0.002)
        assert speed[0] == pytest.approx(0.2 * left, abs=1e-4)


def test_the_rule_decides_by_the_chart_s_errors() -> None:
    generator = np.random.default_rng(0)
    frames = generator.normal(size=(8, 6))
    found = measured_errors(frames[:, [1, 2, 4, 5]].tolist(), 1.0)
    expected = (
        found.lateral + found.lateral_uncertainty,
        found.rotational + found.rotational_uncertainty,
    )
    assert sure_errors(frames) == pytest.approx(expected)


def test_a_joint_at_its_limit_too_long_ends_it() -> None:
    weak = replace(CELL.impedance, torque_limits=(77.0, 160.0, 95.0, 4.5, 11.0, 11.0, 2.0))
    cell = replace(CELL, impedance=weak)
    found = aligned(cell, drawn(cell))
    assert found.saturated[0] > 0.5
    assert np.isinf(found.decided[0])
    assert np.isnan(found.touch).all()


def test_a_pid_that_makes_the_error_grow_is_stopped() -> None:
    cell = resolve(replace(USUAL, controller=replace(USUAL.controller, kind="pid")))
    draws = drawn(cell, (0.0, 0.006, -0.004, 0.0, 0.05, -0.03))
    lateral, gains = cell.pid.lateral, cell.pid.lateral.closed
    hard = replace(lateral, proportional=20 * gains.proportional, integral=20 * gains.integral)
    found = aligned(replace(cell, pid=replace(cell.pid, lateral=hard)), draws)
    assert np.isfinite(aligned(cell, draws).decided[0])
    assert np.isinf(found.decided[0])
    # Stopped, and not only at the end of the time to decide.
    assert np.isnan(found.course[0, int(2.0 / cell.cameras.frames.period) :]).all()
