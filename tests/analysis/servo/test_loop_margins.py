import control
import numpy as np
import pytest

from chamfer.analysis.linear.to_control import to_control
from chamfer.analysis.servo.loop_margins import loop_margins
from chamfer.analysis.servo.servo_response import eq_2_delay_margin
from chamfer.diagrams.servo.servo_loops import make_pid_loop
from chamfer.diagrams.servo.servo_scenario import StepScenario, resolve
from chamfer.systems.servo.pid import PidParams


def test_margins_of_eq_2() -> None:
    loop = make_pid_loop(StepScenario(), "velocity")
    margins = loop_margins(to_control(loop, input="controller PID"))
    # At the crossover |C G| = 1, by the transfer functions written out.
    s = 1j * margins.crossover
    controller = 341 + 21903 / s - 0.00853 * 39971 / (1 + 39971 / s)
    response = controller * s / (2.14708 * s**2 + 53.896 * s + 700)
    assert abs(response) == pytest.approx(1, rel=1e-6)
    assert margins.phase_margin == pytest.approx(180 + np.degrees(np.angle(response)), abs=1e-4)
    assert margins.as_metrics("pid")["pid.gain_margin"].value is None
    assert margins.as_metrics("pid")["pid.gain_margin"].note == "infinite"


@pytest.mark.parametrize("integral", [21903.0, 100.0])  # the latter crosses over twice
def test_the_delay_margin_of_eq_2_is_python_controls(integral: float) -> None:
    scenario = StepScenario(pid=PidParams(integral=integral))
    loop = to_control(make_pid_loop(scenario, "velocity"), input="controller PID")
    _, phases, _, _, crossovers, _ = control.stability_margins(loop, returnall=True)
    expected = (np.radians(np.mod(phases, 360)) / crossovers).min()
    assert eq_2_delay_margin(resolve(scenario)) == pytest.approx(expected, rel=1e-6)


def test_margins_of_three_lags() -> None:
    # 4/(s+1)^3: phase crossover at sqrt(3), where the gain is 4/8.
    a = np.array([[-1.0, 0.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, -1.0]])
    margins = loop_margins(control.ss(a, [[4.0], [0], [0]], [[0, 0, 1.0]], 0))
    assert margins.gain_margin == pytest.approx(2.0, rel=1e-6)
    frequencies = np.geomspace(0.01, 100, 100_001)
    response = 4 / (1j * frequencies + 1) ** 3
    assert margins.sensitivity_peak == pytest.approx(np.abs(1 / (1 + response)).max(), rel=1e-3)


def test_margins_of_a_sampled_integrator_a_sample_late() -> None:
    # k/(z (z - 1)): at its phase crossover, a third of the Nyquist frequency, the gain is k.
    loop = control.tf([0.25], [1, -1, 0], 0.1)
    margins = loop_margins(loop)
    assert margins.gain_margin == pytest.approx(4.0, rel=1e-3)
    assert abs(loop(np.exp(0.1j * margins.crossover))) == pytest.approx(1.0, rel=1e-3)
    assert margins.delay_margin == pytest.approx(
        np.radians(margins.phase_margin) / margins.crossover, rel=1e-3
    )


def test_the_delay_margin_is_the_least_of_all_crossovers() -> None:
    # The resonance at 10 rad/s crosses over too; it has more phase left, but less time.
    loop = control.tf([1.0], [1, 0]) + control.tf([8.0], [1, 0.4, 100.0])
    margins = loop_margins(loop)
    frequencies = np.geomspace(0.1, 100, 400_001)
    response = loop(1j * frequencies)
    at = np.flatnonzero(np.diff(np.abs(response) > 1))
    delays = np.mod(np.pi + np.angle(response[at]), 2 * np.pi) / frequencies[at]
    assert len(at) == 3
    assert margins.delay_margin == pytest.approx(delays.min(), rel=1e-3)
    assert margins.delay_margin < 0.5 * delays[0]
    assert margins.as_metrics("pid")["pid.delay_margin"].value == margins.delay_margin
