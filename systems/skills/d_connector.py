"""The strategy that inserts a D connector (Fig. 5).

Source: Morrow, Nelson and Khosla. The paper's text gives the three phases and the primitives; the
figure's transitions and all numbers are reconstructed.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from models.validation import ParameterError, require_not_negative, require_positive
from systems.skills.force_primitives import (
    GuardedMove,
    Hindered,
    Hold,
    Level,
    Push,
    ShiftToContact,
    Stick,
)
from systems.skills.skill import DONE, Retry, Skill, SkillState
from systems.skills.trajectory_primitives import Axis, Dither, MoveDx, lissajous


@dataclass(frozen=True, kw_only=True)
class DConnectorSkillParams:
    """Parameters of the insertion; all of them are assumed."""

    period: float = 0.01  # s, between two ticks
    approach_speed: float = 0.01  # m/s
    contact_force: float = 4.0  # N, of the guarded move
    approach_limit: float = 0.02  # m, of the guarded move
    maintained: float = 0.008  # m/s, of stick
    level_time: float = 4.0  # s, in which the plug has to lie down on the socket's face
    lift: float = 0.004  # m, of a plug that has tipped over
    shift: float = 0.0015  # m, of it, to the side of the edge
    drop: float = 0.0006  # m, of a shell that drops in
    hold_gain: float = 10.0  # 1/s, of the orientation in the search
    centring: float = 3.0  # 1/s, of the search
    search_amplitude: float = 0.0022  # m
    search_frequency: float = 0.6  # Hz, of the slower dither
    search_repeats: int = 8  # N, cycles of it
    search_threshold: float = 1.0  # of C; free is pi^2/8
    twist_amplitude: float = 0.06  # rad, of the rotary search
    twist_frequency: float = 0.7  # Hz
    settle_amplitude: float = 0.02  # rad, about x and y
    settle_cycles: float = 2.0
    push_speed: float = 0.075  # m/s: D times it is more than the mating force
    push_force: float = 54.0  # N, that counts as stopped
    push_depth: float = 0.0042  # m, least depth of a push that is not jammed
    push_dither: float = 0.0001  # m
    back_off: float = 0.00075  # m
    retries: int = 3
    verify_amplitude: float = 0.0015  # m, more than the play
    verify_frequency: float = 0.5  # Hz
    verify_threshold: float = 1.0  # of C; free is pi^2/8
    retract: float = 0.03  # m

    def __post_init__(self) -> None:
        require_positive(
            self,
            "period",
            "approach_speed",
            "contact_force",
            "approach_limit",
            "maintained",
            "level_time",
            "lift",
            "shift",
            "drop",
            "hold_gain",
            "search_amplitude",
            "search_frequency",
            "search_threshold",
            "twist_frequency",
            "settle_cycles",
            "push_speed",
            "push_force",
            "push_depth",
            "back_off",
            "verify_amplitude",
            "verify_frequency",
            "verify_threshold",
            "retract",
        )
        require_not_negative(
            self, "centring", "twist_amplitude", "settle_amplitude", "push_dither"
        )
        for name in ("search_repeats", "retries"):
            if not getattr(self, name) >= 1:
                raise ParameterError(name, getattr(self, name), "a whole number >= 1")


def make_d_connector_skill(
    params: DConnectorSkillParams, *, height: float = 0.005, before: Sequence[SkillState] = ()
) -> Skill:
    """Return the skill.

    Args:
        params: Speeds, forces and amplitudes.
        height: Of the plug over the socket before the approach, m, within 1 mm.
        before: States that grasp and transport the plug; the last one leads to ``approach``.
            Without them the plug is held from the begin.
    """
    stick = Stick(speed=params.maintained, threshold=params.drop)
    hold = Stick(speed=params.maintained, threshold=math.inf)
    search = lissajous(
        first=Dither(
            axis="x",
            amplitude=params.search_amplitude,
            frequency=params.search_frequency,
            centring=params.centring,
        ),
        axis="y",
        repeats=params.search_repeats,
    )
    upright = Hold(axes=("rx", "ry"), gain=params.hold_gain)
    twist = Dither(
        kind="rotary",
        axis="z",
        amplitude=params.twist_amplitude,
        frequency=params.twist_frequency,
        cycles=1000.0,
    )
    fixed = Hindered(
        samples=(_window(search[0], params), _window(search[1], params)),
        threshold=params.search_threshold,
    )

    def shake(axis: Axis, amplitude: float, cycles: float, frequency: float) -> Dither:
        return Dither(axis=axis, amplitude=amplitude, cycles=cycles, frequency=frequency)

    def tilt(axis: Axis, frequency: float) -> Dither:
        return Dither(
            kind="rotary",
            axis=axis,
            amplitude=params.settle_amplitude,
            cycles=params.settle_cycles,
            frequency=frequency,
        )

    verify = (
        shake("x", params.verify_amplitude, 4.0, params.verify_frequency),
        shake("y", params.verify_amplitude, 4.0, params.verify_frequency),
    )
    states = (
        *before,
        SkillState(
            name="approach",
            marks=True,
            run=[
                GuardedMove(
                    speed=params.approach_speed,
                    threshold=params.contact_force,
                    limit=params.approach_limit,
                )
            ],
            on={"contact": "level"},
            timeout=2 * params.approach_limit / params.approach_speed,
        ),
        SkillState(
            name="level",
            run=[hold, Level()],
            on={
                "done": "search",
                "lost": Retry("shift", 2 * params.retries),
                "timed out": Retry("shift", 2 * params.retries),
            },
            timeout=params.level_time,
        ),
        SkillState(
            name="shift",
            from_mark=True,
            run=[_up(params.lift, 1.0), upright, ShiftToContact(way=params.shift)],
            on={"done": "approach"},
            timeout=2.0,
        ),
        SkillState(
            name="search",
            run=[stick, *search, upright, fixed],
            on={"lost": "settle", "hindered": "settle", "done": "rotary search"},
            timeout=2 * search[0].duration,
        ),
        SkillState(
            name="rotary search",
            run=[stick, *search, twist, upright],
            on={"lost": "settle", "done": Retry("shift", params.retries)},
            timeout=2 * search[0].duration,
        ),
        SkillState(
            name="settle",
            run=[hold, tilt("x", 1.0), tilt("y", 1.0)],
            on={"done": "push"},
            timeout=2 * params.settle_cycles,
        ),
        SkillState(
            name="push",
            from_mark=True,
            run=[
                Push(
                    speed=params.push_speed,
                    force=params.push_force,
                    distance=height + params.push_depth,
                ),
                shake("x", params.push_dither, 1000.0, 4.0),
            ],
            on={
                "done": "verify",
                "jammed": Retry("back off", params.retries, then=Retry("shift", params.retries)),
            },
            timeout=3.0,
        ),
        SkillState(
            name="back off",
            run=[_up(params.back_off, 0.2)],
            on={"done": "free"},
            timeout=1.0,
        ),
        SkillState(
            name="free",
            run=[
                hold,
                shake("x", params.search_amplitude / 4, 2.0, 1.0),
                shake("y", params.search_amplitude / 4, 2.0, 1.0),
            ],
            on={"done": "push"},
            timeout=4.0,
        ),
        SkillState(
            name="verify",
            run=[
                hold,
                *verify,
                Hindered(
                    samples=(_window(verify[0], params),) * 2, threshold=params.verify_threshold
                ),
            ],
            on={"hindered": DONE},
            timeout=2 * verify[0].duration,
        ),
    )
    return Skill(
        name="D connector",
        states=states,
        retract=[_up(params.retract, 1.0)],
        held=not before,
    )


def _window(dither: Dither, params: DConnectorSkillParams) -> int:
    return round(1 / (dither.frequency * params.period))


def _up(way: float, duration: float) -> MoveDx:
    return MoveDx(displacement=(0.0, 0.0, 0.0, 0.0, 0.0, way), duration=duration)
