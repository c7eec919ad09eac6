"""The sampled loop of a position-controlled, compliant arm, in contact and free.

A wrist sensor reads what the tool does to its springs, an admittance makes a displacement of it,
joint servos follow that, and the tip on the wrist's springs presses on a contact that springs too.
For small motion the flange moves as each joint does: a linear sampled system about and along the
hole's axes, of which those that are coupled, by a centre off the tip, are one loop. Left out are
limits of rate and acceleration, noise, and that a contact opens: a first touch may still bounce.

A peg that comes with the speed v meets D v, so the least damping is the best with which the force
does not ring. That is measured by the largest sensitivity: how much nearer to its end than 1 the
open loop comes. Up to 1.6 a delayed admittance on a spring, ``D x'(t) = -k x(t - tau)``, has
D >= 2 k tau, its force overshoots by 4 % and bears three times the gain. Source: K. J. Astrom and
T. Hagglund, Advanced PID Control (2006), section 4.6, where 1.4 to 2 is usual. That all poles are
real is no measure: a tool on its springs rings by itself, too fast for the loop to hear.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.diagrams.contact.hybrid_loop_stability import LinearLoop
from chamfer.models.arms.position_arm import ServoParams
from chamfer.models.arms.wrist import SIZE, WristParams
from chamfer.models.validation import ParameterError, known, require_not_negative
from chamfer.systems.force.accommodation_law import AXES, DAMPING
from chamfer.systems.force.admittance_law import AdmittanceParams
from chamfer.systems.force.contact_admittance import ContactAdmittanceParams
from chamfer.systems.force.contact_detection_law import APPROACH, CONTACT
from chamfer.systems.force.sampled_loop import NEUTRAL, Plant, Sampled, held
from chamfer.systems.force.wrist_wrench import WRIST_AXES

if TYPE_CHECKING:
    from chamfer.diagrams.insertion.insertion import InsertionScenario

Array = NDArray[np.float64]

PEAK: Final = 1.6  # the largest sensitivity of a designed loop
_SHARES: Final = (0.0, 0.01, 0.1, 1.0)  # of the contact's stiffness, that are looked at
_SAMPLING: Final = np.geomspace(1e-4, 1.0, 300)  # frequencies, of half the sampling rate
_FACTORS: Final = 1e4, 1e-6  # times k tau, a damping that is enough and one that is not
_COARSE: Final = 1.5  # of the search between them
_SOFTEST: Final = 1e4  # times as soft, what is looked at
_FASTEST: Final = 1000.0  # Hz, of servos
_TURN: Final = np.kron(np.eye(2), WRIST_AXES.rotation().matrix())  # wrist's axes in the hole's


@dataclass(frozen=True, kw_only=True)
class ContactLoop:
    """The elements of the loop; sixes are about and along the hole's axes, x into it."""

    servo: ServoParams
    admittance: ContactAdmittanceParams  # damping None: designed for the contact
    wrist: WristParams  # springs and tool
    contact: tuple[float, ...]  # N m/rad and N/m, of part and fixture at the tip, 0: none
    bandwidth: float = 0.0  # Hz, of the sensor's first-order filter, 0: none
    delay: float = 0.0  # s, of its reading
    step: float = 0.0  # s, of a simulated plant with implicit springs, 0: none

    def __post_init__(self) -> None:
        require_not_negative(self, "bandwidth", "delay", "step")
        if len(self.contact) != SIZE or not all(0 <= k < math.inf for k in self.contact):
            raise ParameterError("contact", self.contact, "six finite numbers >= 0")

    @property
    def damping(self) -> tuple[float, ...]:
        """N m s/rad and N s/m, D as given, or as the contact needs."""
        given = self.admittance.damping
        return designed_damping(self) if given is None else given

    @property
    def lag(self) -> float:
        """Delay from a commanded displacement to the reading of its force, s."""
        filtered = 1 / (2 * math.pi * self.bandwidth) if self.bandwidth else 0.0
        servo = self.servo.delay * self.servo.period + 2 / self.servo.frequency
        return servo + filtered + self.delay

    @property
    def springs(self) -> Array:
        """N m/rad and N/m, the wrist's seen from the tip, shape (6, 6)."""
        return _at_tip(self.wrist.stiffness, self.wrist.centre)

    @property
    def stiffness(self) -> tuple[float, ...]:
        """N m/rad and N/m, of springs and contact in series, each axis by itself."""
        springs = np.diag(self.springs).tolist()
        return tuple(k * c / (k + c) for k, c in zip(springs, self.contact, strict=True))

    @property
    def _mass(self) -> Array:
        tool, own = self.wrist, self.wrist.centre_of_mass
        across = tool.inertia - tool.mass * own**2
        return _at_tip((across, across, tool.about_z, *3 * [tool.mass]), own)

    @property
    def _coupled(self) -> list[list[int]]:
        """The axes, those that are coupled together."""
        linked = (
            np.abs(self.springs) + np.abs(self._mass) + np.abs(self.law((1.0,) * SIZE).mobility)
        )
        near = np.linalg.matrix_power(linked > 0, SIZE)
        return [np.flatnonzero(row).tolist() for row in np.unique(near, axis=0)[::-1]]

    def law(self, damping: tuple[float, ...]) -> AdmittanceParams:
        """Return the law's parameters."""
        given = {name: getattr(self.admittance, name) for name in ("inertia", "spring", "centre")}
        period = self.servo.period
        return AdmittanceParams(**given, damping=damping, period=period, allow_unstable=True)

    def arm(self, axes: list[int], share: float) -> Plant:
        """Return the effect of a commanded displacement of some axes on the measured wrench.

        In contact with a share of its stiffness. States: the flange's place and rate, the tip's,
        and the filter.
        """
        n, of, w, h = len(axes), np.ix_(axes, axes), self.servo.frequency, self.step
        fast = 2 * math.pi * self.bandwidth
        if fast * h:  # as slow as the filter of samples
            fast = math.expm1(fast * h) / h
        one, none, K = np.eye(n), np.zeros((n, n)), self.springs[of]
        C, touching = _at_tip(self.wrist.damping, self.wrist.centre)[of], np.diag(self.contact)[of]
        felt = np.hstack([-K, -C, K, C, none])  # by the tool, of what it touches
        push = np.hstack([K, C + h * K, -K, -C - h * K, none])
        push[:, 2 * n : 4 * n] -= share * np.hstack([touching, h * touching])
        flow = np.vstack(
            [
                np.hstack([none, one, none, none, none]),
                np.hstack([-w * w * one, -2 * w * one, none, none, none]),
                np.hstack([none, none, none, one, none]),
                np.linalg.solve(self._mass[of], push),
                fast * (felt - np.eye(n, 5 * n, 4 * n)),
            ]
        )
        drive = np.vstack([none, w * w * one, none, none, none])
        late = np.eye(n, 5 * n, 4 * n) if fast else felt
        return Plant(flow, drive, np.zeros((0, 5 * n)), late, self.delay)

    def loops(self) -> tuple[LinearLoop, ...]:
        """Return the loops of the coupled axes, named after them, in contact and free."""
        law, period, found = self.law(self.damping), self.servo.period, []
        for axes in self._coupled:
            of, n = np.ix_(axes, axes), len(axes)
            mobility = law.mobility[of]
            # Of velocity and displacement.
            once = mobility @ np.hstack([law.momentum[of], -law.restoring[of]])
            then = np.eye(n, 2 * n, n) + period * once
            A, B = np.vstack([once, then]), np.vstack([mobility, period * mobility])
            sampled, late = Sampled(A, B, then, period * mobility), self.servo.delay * period
            name = ", ".join(AXES[i] for i in axes)
            for mode, share, where in ((CONTACT, 1.0, "in contact"), (APPROACH, 0.0, "free")):
                arm = self.arm(axes, share)
                found.append(LinearLoop(f"{name} {where}", mode, arm, sampled, period, late))
        return tuple(found)

    @property
    def unstable(self) -> list[LinearLoop]:
        """The loops that grow, the worst last."""
        grows = sorted((one.growth_rate(), i, one) for i, one in enumerate(self.loops()))
        return [one for growth, _, one in grows if growth > NEUTRAL]


def _at_tip(diagonal: tuple[float, ...], height: float) -> Array:
    """Return what is diagonal at a height above the tip there, in the hole's axes, (6, 6)."""
    lever = np.eye(SIZE)
    lever[3:5, :2] = [[0.0, height], [-height, 0.0]]
    turned: Array = _TURN @ (lever.T * diagonal) @ lever @ _TURN.T
    return turned


def axes_of(loop: LinearLoop) -> list[str]:
    """Return the names of a loop's axes, which it is called after."""
    return [word for word in loop.name.replace(",", "").split() if word in AXES]


@lru_cache(maxsize=64)
def designed_damping(loop: ContactLoop) -> tuple[float, ...]:
    """Return the least damping with which no axis rings, N m s/rad and N s/m.

    Each axis by itself, then coupled ones together by a common factor: on contacts up to as stiff
    as given, and on none.
    """
    T = loop.servo.period
    z = np.exp(1j * math.pi * _SAMPLING)[:, np.newaxis, np.newaxis]
    found = np.maximum(loop.stiffness, 1e-6 * np.diag(loop.springs)) * loop.lag

    def least(axes: list[int]) -> float:
        """Return the least factor on the present result."""
        of = np.ix_(axes, axes)
        arms = [
            held(loop.arm(axes, share), period=T, delay=loop.servo.delay * T) for share in _SHARES
        ]
        seen = np.array(
            [arm.C @ np.linalg.inv(z * np.eye(len(arm.A)) - arm.A) @ arm.B for arm in arms]
        )

        def calm(factor: float) -> bool:
            law = loop.law(tuple((factor * found).tolist()))
            impeding = np.linalg.inv(law.mobility)[of] - law.momentum[of] / z
            impeding = impeding + T * law.restoring[of] / (z - 1)
            opened = seen @ np.linalg.inv(impeding) * (T * z / (z - 1))
            sensitivity = np.linalg.inv(np.eye(len(axes)) - opened)
            return bool(np.abs(np.diagonal(sensitivity, axis1=2, axis2=3)).max() <= PEAK)

        return least_factor(calm, *_FACTORS)

    for axis in range(SIZE):
        found[axis] *= least([axis])
    for axes in loop._coupled:
        if len(axes) > 1:
            found[axes] *= max(1.0, least(axes))
    return tuple(found.tolist())


def least_factor(
    good: Callable[[float], bool], most: float, least: float, halvings: int = 20
) -> float:
    """Return the factor from which on all are good, up to the most."""
    while most > least and good(low := max(most / _COARSE, least)):
        most = low
    low = max(most / _COARSE, least)
    for _ in range(halvings):
        middle = math.sqrt(low * most)
        low, most = (low, middle) if good(middle) else (middle, most)
    return most


class Remedies(NamedTuple):
    """Changes that each make an unstable loop stable alone; None where none does."""

    damping: dict[str, float]  # N m s/rad or N s/m, at least, of the axes that grow
    softer: float | None  # a factor on the wrist's springs, at most
    faster: float | None  # a factor on rate and bandwidth of the servos, at least


def remedies(loop: ContactLoop) -> Remedies:
    """Return the remedies for a loop, each by bisection; damping as a share of the designed."""
    growing = {axis for one in loop.unstable for axis in axes_of(one)}
    given, servo = loop.damping, loop.servo
    needed = designed_damping(loop)

    def damped(share: float) -> ContactLoop:
        of = zip(AXES, given, needed, strict=True)
        more = tuple(max(D, share * least) if axis in growing else D for axis, D, least in of)
        return replace(loop, admittance=replace(loop.admittance, damping=more))

    def softer(factor: float) -> ContactLoop:
        springs = tuple(k / factor for k in loop.wrist.stiffness)
        return replace(loop, wrist=replace(loop.wrist, stiffness=springs))

    def faster(factor: float) -> ContactLoop:
        rate, bandwidth = factor * servo.rate, factor * servo.bandwidth
        return replace(loop, servo=replace(servo, rate=rate, bandwidth=bandwidth))

    def least(changed: Callable[[float], ContactLoop], most: float) -> float | None:
        if changed(most).unstable:
            return None
        return least_factor(lambda factor: not changed(factor).unstable, most, 1.0)

    share = least_factor(lambda share: not damped(share).unstable, *_FACTORS)
    found, less = zip(AXES, damped(share).damping, given, strict=True), least(softer, _SOFTEST)
    return Remedies(
        {axis: D for axis, D, before in found if before < D},
        1 / less if less else None,
        least(faster, _FASTEST / servo.rate),
    )


def require_stable(loop: ContactLoop) -> None:
    """Refuse a loop that is unstable, in contact or free, and name the remedies.

    Raises:
        ParameterError: If it is.
    """
    if not (unstable := loop.unstable):
        return
    mend, units, worst = remedies(loop), dict(zip(AXES, DAMPING, strict=True)), unstable[-1]
    more = ", ".join(f"{D:.3g} {units[axis]} of {axis}" for axis, D in mend.damping.items())
    allowed = f"at least {more}"
    if mend.softer:
        allowed += f" or a compliance at most {mend.softer:.2g} times as stiff"
    if mend.faster:
        allowed += f" or servos {mend.faster:.3g} times as fast, in rate and bandwidth"
    found = f"the loop of {worst.name} grows at {worst.growth_rate():.3g} 1/s"
    raise ParameterError("admittance.damping", loop.damping, f"{allowed}: {found}")


def contact_loop(scenario: "InsertionScenario") -> ContactLoop:
    """Return the loop of a cell whose arm takes positions, where peg and fixture touch most.

    As stiff as all points at once, which the springs hardly tell from a contact that is rigid.
    """
    parts, material = scenario.parts, scenario.contact.over(scenario.parts)
    points = known("facets", material.facets) * material.stiffness / 2
    tilting = points * max(parts.peg_radius, parts.bore_length) ** 2
    return ContactLoop(
        servo=scenario.arm.servo,
        admittance=scenario.admittance,
        wrist=scenario.wrist,
        contact=(points * parts.peg_radius**2, tilting, tilting, points, points, points),
        bandwidth=scenario.sensor.bandwidth,
        delay=scenario.sensor.delay,
    )
