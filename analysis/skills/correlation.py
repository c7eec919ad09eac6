"""Eq. (1): what the correlation of command and motion shows, and what it cannot."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Final, Literal, NamedTuple

import numpy as np
import scipy  # whose submodules are imported where they are used
from matplotlib.figure import Figure
from numpy.typing import NDArray

from chamfer.analysis.campaign.campaign import run_each
from chamfer.analysis.campaign.trial_metrics import trial_seed
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.linear.simulate import simulate
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress, column
from chamfer.analysis.skills.correlation_figures import plot_correlation
from chamfer.diagrams.skills.correlation_loop import (
    AxisSensorParams,
    CorrelationScenario,
    make_correlation_diagram,
)
from chamfer.models.validation import ParameterError
from chamfer.systems.contact.spring_constraint import SpringConstraintParams
from chamfer.systems.primitives.correlation import correlation

Array = NDArray[np.float64]

CASES: Final = ("free", "constrained", "one_sided", "noisy", "biased")
_MOST: Final = 10_000  # cycles
_FIRST: Final = 2  # windows, until what began at rest goes round


@dataclass(frozen=True, kw_only=True)
class CasesScenario(CorrelationScenario):
    """The same dither free, hindered on both sides, beside a stop, noisy and biased.

    Noise and bias are those of the cases named for them; all are assumed.
    """

    sensor: AxisSensorParams = AxisSensorParams(noise=2.5, bias=2.5)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.sensor.bias >= 0:
            raise ParameterError("sensor.bias", self.sensor.bias, "a finite number >= 0")
        if self.constraint.sides != SpringConstraintParams.sides:
            raise ParameterError("constraint.sides", self.constraint.sides, "both; cases set it")
        if self.dither.amplitude == 0:
            raise ParameterError("dither.amplitude", self.dither.amplitude, "a number but 0")
        if self.dither.kind != "linear":
            raise ParameterError("dither.kind", self.dither.kind, "linear")
        if not (_FIRST < self.dither.cycles <= _MOST and self.dither.cycles.is_integer()):
            raise ParameterError(
                "dither.cycles", self.dither.cycles, f"a whole number, {_FIRST + 1} to {_MOST}"
            )

    @property
    def cycles(self) -> int:
        """Windows of every case."""
        return round(self.dither.cycles)

    def case(self, name: str) -> CorrelationScenario:
        """Return the loop of one of the cases."""
        sides: dict[str, Literal["both", "one"]] = {"constrained": "both", "one_sided": "one"}
        return CorrelationScenario(
            # One more cycle, so that it goes on to the last row.
            dither=replace(self.dither, cycles=self.dither.cycles + 1.0),
            accommodation=self.accommodation,
            constraint=replace(self.constraint, sides=sides.get(name, "none")),
            sensor=AxisSensorParams(
                noise=self.sensor.noise if name == "noisy" else 0.0,
                bias=self.sensor.bias if name == "biased" else 0.0,
            ),
            correlator=self.correlator,
        )


class Windows(NamedTuple):
    """The cycles of a case."""

    command: Array  # shape (cycles, N)
    motion: Array  # shape (cycles, N)
    hindered: float  # share of the time after the first two for which the correlator says so


def run(scenario: CasesScenario, seed: int, progress: Progress) -> Outcome:
    """Run every case and correlate its cycles."""
    metrics: dict[str, Metric] = {}
    cycles = np.arange(scenario.cycles)
    traces = {"cycle": column(cycles)}
    shapes: dict[str, Array] = {"sample": column(np.arange(scenario.samples))}
    finished = run_each(partial(_run_case, scenario, seed), CASES, progress)
    for name, one in finished.split(CASES, lambda name: name).items():
        found = Windows(**one.rows[0])
        each = [correlation(f, g) for f, g in zip(found.command, found.motion, strict=True)]
        later = each[_FIRST:]
        value = float(np.mean([one.value for one in later]))
        spread = float(np.std([one.value for one in later]))
        metrics[f"correlation.{name}"] = Metric(
            value=value, unit="", note=f"mean of {len(later)} windows, deviation {spread:.2g}"
        )
        metrics[f"theory.{name}"] = Metric(value=theory(scenario, name), unit="")
        for what in ("amplitude_ratio", "bias"):
            ratio = float(np.mean([getattr(one, what) for one in later]))
            metrics[f"{what}.{name}"] = Metric(value=round(ratio, 9), unit="")
            metrics[f"{what}.{name}.first"] = Metric(
                value=round(float(getattr(each[0], what)), 9), unit="", note="of the first window"
            )
        metrics[f"hindered.{name}"] = Metric(
            value=100 * found.hindered, unit="%", note="of the time, says the correlator"
        )
        traces[name] = column([one.value for one in each])
        shapes[f"{name}_motion"] = found.motion[0]
        shapes[f"{name}_later"] = found.motion[_FIRST]
    shapes["command"] = found.command[0]
    return Outcome(
        metrics=metrics,
        traces=traces,
        simulated_seconds=len(CASES) * scenario.cycles / scenario.dither.frequency,
        tables={"cycles": shapes},
    )


def _run_case(scenario: CasesScenario, seed: int, name: str) -> Row:
    return _windows(scenario, name, trial_seed(seed, CASES.index(name)))._asdict()


def _windows(scenario: CasesScenario, name: str, seed: int) -> Windows:
    period, samples = scenario.accommodation.period, scenario.samples
    count = scenario.cycles * samples
    outputs = simulate(
        make_correlation_diagram(scenario.case(name)),
        duration=(count + 0.5) * period,
        step=period,
        seed=seed,
    ).outputs
    # What accommodation makes of a sample shows up in the next row.
    shape = (scenario.cycles, samples)
    return Windows(
        outputs["command"][:count].reshape(shape),
        outputs["motion"][1 : count + 1].reshape(shape),
        float(outputs["hindered"][_FIRST * samples : count].mean()),
    )


def theory(scenario: CasesScenario, name: str) -> float:
    """Return what eq. (1) is expected to be, in closed form, sampled as the loop is.

    Free: ``(N^2 / 8) tan^2(pi / N)`` for N a multiple of four. Constrained: the phase lag of
    ``(z - 1) / (z - 1 + kappa)``, damping control that samples with one hold. One-sided: as free,
    once the tool has left the stop. Noisy: the motion's mean size is that of a folded normal
    distribution. Biased: the sums of a shifted cosine.
    """
    n = scenario.samples
    angle = 2 * np.pi * np.arange(n) / n
    f = np.cos(angle)
    free = correlation(f, f).value
    if name in ("free", "one_sided"):
        return free
    damping = scenario.accommodation.damping[scenario.dither.index]
    peak = abs(scenario.dither.amplitude) * 2 * np.pi * scenario.dither.frequency
    if name == "constrained":
        kappa = scenario.constraint.stiffness * scenario.accommodation.period / damping
        z = np.exp(2j * np.pi / n)
        lag = float(np.angle((z - 1) / (z - 1 + kappa)))
        return correlation(f, np.cos(angle + lag)).value
    if name == "noisy":
        deviation = scenario.sensor.noise / damping / peak
        if deviation == 0:
            return free
        size = deviation * np.sqrt(2 / np.pi) * np.exp(-0.5 * (f / deviation) ** 2)
        size += f * (1 - 2 * scipy.stats.norm.cdf(-f / deviation))
        return float(n * (f @ f) / (np.abs(f).sum() * size.sum()))
    return correlation(f, f + scenario.sensor.bias / damping / peak).value


def figures(scenario: CasesScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    return {"correlation": plot_correlation(scenario.samples, outcome)}
