"""How much damping a position-controlled arm needs in contact: computed, simulated, by theory."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from chamfer.analysis.drawing.figure_style import (
    FORCE,
    FSM,
    PUBLISHED,
    dress,
    legend,
    new_figure,
)
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress, column
from chamfer.diagrams.contact.hybrid_loop_stability import stability_of
from chamfer.diagrams.insertion.contact_loop import ContactLoop, axes_of, least_factor
from chamfer.models.arms.position_arm import ServoParams
from chamfer.models.arms.wrist import WristParams
from chamfer.models.validation import ParameterError
from chamfer.systems.force.accommodation_law import AXES, DAMPING
from chamfer.systems.force.contact_admittance import ContactAdmittanceParams
from chamfer.systems.force.contact_detection_law import CONTACT
from chamfer.systems.force.sampled_loop import NEUTRAL

_X: Final = AXES.index("x")
_FAR: Final = (0.5, 2.0)  # times the computed border, tried as well
_NEAR: Final = (1.3, 1 / 1.3, 4)  # times it, between which the simulated one is halved so often
_WIDE: Final = (1e3, 1e-3, 10)  # times the given damping, likewise of the computed one
_STEP: Final = 2e-5  # s, of the simulation
_DURATION: Final = 0.8  # s


@dataclass(frozen=True, kw_only=True)
class ContactStabilityScenario:
    """A loop, and contacts of which each has its border of the damping along x."""

    loop: ContactLoop = ContactLoop(
        servo=ServoParams(),
        admittance=ContactAdmittanceParams(),
        wrist=WristParams(
            stiffness=(500.0, 500.0, 300.0, 1.5e5, 1.5e5, 5e5),
            damping_ratio=0.3,
            mass=1.0,
            inertia=4e-3,
            centre_of_mass=0.03,
        ),
        contact=(200.0, 200.0, 200.0, 1e6, 1e6, 1e6),
        bandwidth=100.0,
        delay=0.001,
    )  # assumed
    shares: tuple[float, ...] = (0.003, 0.01, 0.03, 0.1, 0.3, 1.0)  # of the contact's stiffness

    def __post_init__(self) -> None:
        if not (self.shares and all(0 < share < math.inf for share in self.shares)):
            raise ParameterError("shares", self.shares, "finite numbers > 0")


CONTACT_STABILITY: Final = ContactStabilityScenario()


def damped(loop: ContactLoop, axis: int, factor: float) -> ContactLoop:
    """Return a loop with the damping of one of its six axes times a factor."""
    damping = tuple(D * factor if i == axis else D for i, D in enumerate(loop.damping))
    return replace(loop, admittance=replace(loop.admittance, damping=damping))


def delayed_border(k: float, delay: float, mass: float = 0.0, spring: float = 0.0) -> float:
    """Return the least D with which ``M x''(t) + D x'(t) + K x(t) = -k x(t - tau)`` is stable.

    The first w with ``k cos(w tau) + K = M w^2`` has it: ``D = k sin(w tau) / w``. Without M and
    K that is ``2 k tau / pi``. Source: N. D. Hayes, Roots of the transcendental equation
    associated with a certain difference-differential equation, J. London Math. Soc. s1-25 (1950).
    """
    if spring >= k:
        return 0.0
    low, high = 0.0, math.pi / delay
    for _ in range(60):
        w = (low + high) / 2
        low, high = (w, high) if k * math.cos(w * delay) + spring > mass * w * w else (low, w)
    return k * math.sin(low * delay) / low


def computed_border(loop: ContactLoop, axis: int) -> float:
    """Return the factor on one axis' damping from which on it is stable in contact."""

    def stable(factor: float) -> bool:
        loops = damped(loop, axis, factor).loops()
        touching = [one for one in loops if one.mode == CONTACT and AXES[axis] in axes_of(one)]
        return all(one.growth_rate() <= NEUTRAL for one in touching)

    return least_factor(stable, *_WIDE)


def grows(loop: ContactLoop) -> bool:
    """Return whether the force along x grows, step by step in time: nothing of a linear system.

    The flange is off by 1 m at first. The last quarter of the run is compared with the one before.
    """
    servo, own, tool = loop.servo, loop.admittance, loop.wrist
    k, c, m, wall = tool.stiffness[5], tool.damping[5], tool.mass, loop.contact[_X]
    M, D, K, T = own.inertia[_X], loop.damping[_X], own.spring[_X], servo.period
    w, follow = servo.frequency, 1 - math.exp(-2 * math.pi * loop.bandwidth * _STEP)
    x, v, tip, rate, read, e, speed = 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    commands, late, forces = [0.0] * (servo.delay + 1), [0.0] * (round(loop.delay / _STEP) + 1), []
    every = round(T / _STEP)
    for i in range(round(_DURATION / _STEP)):
        force = k * (tip - x) + c * (rate - v)
        read += (follow or 1.0) * (force - read)
        late = [*late[1:], read]
        if i % every == 0:
            speed = (late[0] - K * e + M / T * speed) / (M / T + D + K * T)
            e += T * speed
            commands = [*commands[1:], e]
            forces.append(abs(force))
        v += _STEP * (w * w * (commands[0] - x) - 2 * w * v)
        rate += _STEP * (-force - wall * tip) / m
        x, tip = x + _STEP * v, tip + _STEP * rate
    quarter = len(forces) // 4
    return max(forces[-quarter:]) > max(forces[-2 * quarter : -quarter])


def run(scenario: ContactStabilityScenario, seed: int, progress: Progress) -> Outcome:
    """Return the border of the damping along x over the contact's stiffness, three ways.

    Traces: ``stiffness`` of springs and contact in series, N/m; ``designed``, ``border`` computed,
    ``simulated`` and ``delayed``, N s/m. Table ``tried``: ``stiffness``, ``damping``, ``grew``.
    """
    own = scenario.loop.admittance
    rows, tried = [], list[tuple[float, float, bool]]()
    for i, share in enumerate(scenario.shares):
        progress(i / len(scenario.shares), f"contact times {share:g}")
        contact = tuple(share * stiffness for stiffness in scenario.loop.contact)
        loop = replace(scenario.loop, contact=contact)
        k, D = loop.stiffness[_X], loop.damping[_X]
        edge = damped(loop, _X, computed_border(loop, _X))

        def calm(factor: float, k: float = k, edge: ContactLoop = edge) -> bool:
            at = damped(edge, _X, factor)
            tried.append((k, at.damping[_X], grows(at)))
            return not tried[-1][-1]

        for far in _FAR:
            calm(far)
        seen = edge.damping[_X] * least_factor(calm, *_NEAR)
        delayed = delayed_border(k, loop.lag, own.inertia[_X], own.spring[_X])
        rows.append((k, D, edge.damping[_X], seen, delayed))
    names = ("stiffness", "designed", "border", "simulated", "delayed")
    traces = {name: column(values) for name, values in zip(names, np.transpose(rows), strict=True)}
    apart = 100 * float(np.abs(traces["simulated"] / traces["border"] - 1).max())
    columns = zip(("stiffness", "damping", "grew"), np.transpose(tried), strict=True)
    return Outcome(
        metrics={
            "border.difference": Metric(value=apart, unit="%", note="of the simulated, at most"),
            "border.damping": Metric(value=float(traces["border"][-1]), unit="N s/m"),
            "designed.damping": Metric(value=float(traces["designed"][-1]), unit="N s/m"),
            **loop_metrics(scenario.loop),
        },
        traces=traces,
        simulated_seconds=_DURATION * len(tried),
        tables={"tried": {name: column(values) for name, values in columns}},
    )


def loop_metrics(loop: ContactLoop) -> dict[str, Metric]:
    """Return growth and margins of a loop of contact, the least of its axes, and its damping."""
    found = stability_of(loop.loops())
    gain, delay = found.least_gain or "none up to 1000", found.least_delay or "none up to 10 T"
    return {
        "loop.growth_contact": Metric(value=found.growth_contact, unit="1/s"),
        "loop.gain_margin": Metric(value=found.gain_margin, unit="", note=gain),
        "loop.delay_margin": Metric(value=found.delay_margin, unit="s", note=delay),
        "loop.damping": Metric(value=loop.damping[_X], unit=DAMPING[_X], note="along the hole"),
    }


def figures(scenario: ContactStabilityScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    traces, tried = outcome.traces, outcome.tables["tried"]
    k = traces["stiffness"]
    border = np.exp(np.interp(np.log(tried["stiffness"]), np.log(k), np.log(traces["border"])))
    agree = np.sum((tried["damping"] < border) == (tried["grew"] > 0))
    says = f"{agree} of {len(border)} simulations agree with the computed border"
    figure = new_figure(
        height=5.2,
        caption=f"{says}: below it contact is unstable. The designed damping does not ring.",
    )
    axes = figure.subplots()
    axes.loglog(k, traces["designed"], label="designed: does not ring", **FSM)
    axes.loglog(k, traces["border"], label="border, computed", **FORCE)
    axes.loglog(k, traces["delayed"], label="border of an equal pure delay (Hayes)", **PUBLISHED)
    for grew, label, mark in ((0, "simulated: decays", "o"), (1, "simulated: grows", "x")):
        at = tried["stiffness"][tried["grew"] == grew], tried["damping"][tried["grew"] == grew]
        axes.plot(*at, mark, label=label, color="black", mfc="none", ms=5)
    x, y = "stiffness of springs and contact in series / (N/m)", "damping along the hole / (N s/m)"
    dress(axes, title=says, x=x, y=y)
    legend(axes, ncols=2)
    return {"contact-stability": figure}
