"""Contact detection: a state machine on the measured force, with threshold and hysteresis.

A reading beyond the threshold may be noise; several in a row are less likely to be. Of a uniform
noise of half-width e, a reading is above d with the probability ``(e - d) / (2 e)``, so that n of
them in a row are rarer than p from ``n = log p / log((e - d) / (2 e))`` on; above d = e one is
enough.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, NamedTuple, TypeAlias

import numpy as np

from chamfer.models.validation import ParameterError, known, require_not_negative, require_positive
from chamfer.systems.compiled import compiled
from chamfer.systems.force.projection import unit
from chamfer.systems.law import Array, Signal
from chamfer.systems.statechart.chart import Chart, State, Tick, Transition
from chamfer.systems.statechart.chart_law import ChartLaw, number

APPROACH: Final = 0  # indices of the states, what the port ``state`` carries
CONTACT: Final = 1
LOST: Final = 2

_LEAST: Final = 0.1  # N, threshold without noise
_ABOVE: Final = 1.6  # thresholds by the noise: what was 0.8 and 0.2 N of the Adept's 0.5 N
_BELOW: Final = 0.4
_SLOW: Final = 1.1  # by a bias, which is the same in all readings
_RARE: Final = 1e-8  # probability that noise alone counts as contact, at a tick


@dataclass(frozen=True, kw_only=True)
class ContactDetectionParams:
    """Parameters of :class:`ContactDetectionLaw`; None: derived from the sensor's noise."""

    detect: float | None = None  # N, a larger force is contact
    release: float | None = None  # N, while in contact a force not above it is its loss
    samples: int | None = None  # consecutive readings that start or end a contact

    def __post_init__(self) -> None:
        require_positive(self, "detect")
        require_not_negative(self, "release")
        if self.detect is not None and self.release is not None and not self.release < self.detect:
            raise ParameterError("release", self.release, f"less than detect, {self.detect:g}")
        if self.samples is not None and self.samples < 1:
            raise ParameterError("samples", self.samples, "a whole number >= 1")

    def resolved(self, noise: float, bias: float = 0.0) -> "ContactDetectionParams":
        """Return the parameters, with open ones derived from noise and bias without contact, N.

        ``noise`` is its half-width, ``bias`` the most that it is off on average. A threshold in
        the bias is refused.
        """
        detect, release, samples = self.detect, self.release, self.samples
        off = _SLOW * bias
        if detect is None:
            detect = float(f"{off + max(_LEAST, _ABOVE * noise):.6g}")
        if release is None:
            release = float(f"{min(off + _BELOW * noise, (off + detect) / 2):.6g}")
        if detect <= off - noise:
            raise ParameterError("detect", detect, f"more than the sensor's bias, {off:g} N")
        if samples is None:
            chance = max((noise - detect + off) / (2 * noise), 0.0) if noise else 0.0
            samples = math.ceil(math.log(_RARE) / math.log(chance)) if chance else 1
        return ContactDetectionParams(detect=detect, release=release, samples=samples)


class Inputs(NamedTuple):
    """Inputs of the chart."""

    measured_force: tuple[float, ...]  # N, shape (m,), of the arm on the surface


class Memory(NamedTuple):
    """Memory of the chart."""

    contact_time: float = -1.0  # s, of the first contact; -1 before
    beyond: int = 0  # readings in a row, up to now, beyond the threshold that would end the state


Guard: TypeAlias = Callable[[Tick[Inputs, Memory]], bool]
Action: TypeAlias = Callable[[Tick[Inputs, Memory]], Memory]


@compiled
def push_along(direction: Array, force: Array) -> float:
    """Return a force's part along a unit vector."""
    total = 0.0
    for i in range(len(direction)):
        total += direction[i] * force[i]
    return total


def is_beyond(state: int, push: float, detect: float, release: float) -> bool:
    """Return whether a push, N, is beyond the threshold that would end a state."""
    return push <= release if state == CONTACT else push > detect


def make_contact_chart(params: ContactDetectionParams, direction: Array) -> Chart[Inputs, Memory]:
    """Return the chart of resolved thresholds and the push's direction, of any length."""
    ahead = unit(direction, "direction")
    detect, release = known("detect", params.detect), known("release", params.release)
    samples = known("samples", params.samples)
    times = f", {samples} times" if samples > 1 else ""

    def ends(state: int) -> Guard:
        def beyond(tick: Tick[Inputs, Memory]) -> bool:
            push = push_along(ahead, np.array(tick.inputs.measured_force))
            return is_beyond(state, push, detect, release)

        return beyond

    touches, free = ends(APPROACH), ends(CONTACT)

    def often(beyond: Guard) -> Guard:
        return lambda tick: beyond(tick) and tick.memory.beyond + 1 >= samples

    def count(beyond: Guard) -> Action:
        def counted(tick: Tick[Inputs, Memory]) -> Memory:
            return tick.memory._replace(beyond=tick.memory.beyond + 1 if beyond(tick) else 0)

        return counted

    def again(tick: Tick[Inputs, Memory]) -> Memory:
        return tick.memory._replace(beyond=0)

    def change(
        source: str, target: str, beyond: Guard, action: Action = again
    ) -> Transition[Inputs, Memory]:
        label = f"force {f'<= {release:g}' if beyond is free else f'> {detect:g}'} N{times}"
        return Transition(
            source=source, target=target, guard=often(beyond), label=label, action=action
        )

    return Chart(
        "contact detection",
        states=(
            State(name="approach", during=count(touches)),
            State(name="contact", during=count(free)),
            State(name="lost", during=count(touches)),
        ),
        transitions=(
            change("approach", "contact", touches, lambda tick: Memory(tick.time)),
            change("contact", "lost", free),
            change("lost", "contact", touches),
        ),
        memory=Memory(),
    )


class ContactDetectionLaw(ChartLaw[Inputs, Memory]):
    """See :class:`chamfer.systems.force.contact_detection.ContactDetection`."""

    def __init__(self, params: ContactDetectionParams, direction: Array, *, period: float) -> None:
        super().__init__(
            make_contact_chart(params, direction),
            observation=Inputs,
            inputs={"measured_force": Signal(len(direction), "N")},
            outputs={"contact_time": number("contact_time", "s")},
            period=period,
        )
