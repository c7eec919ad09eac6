"""The strategy that inserts a D connector (Fig. 5).

Source: Morrow, Nelson and Khosla. The paper's text gives the three phases and the primitives; the
figure's transitions and all numbers are reconstructed.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from models.validation import require_not_negative, require_positive
from systems.skills.force_primitives import Hindered, Level, Push, ShiftToContact, Stick
from systems.skills.plug_insertion import PlugInsertionParams, up, windows
from systems.skills.skill import DONE, Retry, Skill, SkillState
from systems.skills.trajectory_primitives import Axis, Dither


@dataclass(frozen=True, kw_only=True)
class DConnectorSkillParams(PlugInsertionParams):
    """Parameters of the insertion; all of them are assumed."""

    drop: float = 0.0006  # m, of a shell that drops in
    level_time: float = 4.0  # s, in which the plug has to lie down on the socket's face
    lift: float = 0.004  # m, up, of a plug that has tipped over
    shift: float = 0.0015  # m, to the side of the edge, of a plug that has tipped over
    search_threshold: float = 1.0
    # of the correlation C, below it the search has ended; free is pi^2/8
    twist_amplitude: float = 0.06  # rad, of the rotary search's turn about z
    twist_frequency: float = 0.7  # Hz, of the rotary search's turn about z
    settle_amplitude: float = 0.02  # rad, about x and y, of the dithers that settle the plug
    settle_cycles: float = 2.0  # of the dithers that settle the plug
    push_speed: float = 0.075  # m/s, of the push; D times it is more than the mating force
    push_force: float = 54.0  # N, at which the push counts as stopped
    push_depth: float = 0.0042  # m, least depth of a push that is not jammed
    push_dither: float = 0.0001  # m, along x while it pushes
    back_off: float = 0.00075  # m, up, of a plug that has jammed
    verify_amplitude: float = 0.0015  # m, more than the shells' play

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(
            self,
            "level_time",
            "lift",
            "shift",
            "search_threshold",
            "twist_frequency",
            "settle_cycles",
            "push_speed",
            "push_force",
            "push_depth",
            "back_off",
        )
        require_not_negative(self, "twist_amplitude", "settle_amplitude", "push_dither")


def make_d_connector_skill(
    params: DConnectorSkillParams,
    *,
    period: float = 0.01,
    height: float = 0.005,
    before: Sequence[SkillState] = (),
) -> Skill:
    """Return the skill.

    Args:
        params: Speeds, forces and amplitudes.
        period: s, between two ticks.
        height: Of the plug over the socket before the approach, m, within 1 mm.
        before: States that grasp and transport the plug; the last one leads to ``approach``.
            Without them the plug is held from the begin.
    """
    stick = Stick(speed=params.maintained, threshold=params.drop)
    hold = Stick(speed=params.maintained, threshold=math.inf)
    search, upright = params.search, params.upright
    twist = Dither(
        kind="rotary",
        axis="z",
        amplitude=params.twist_amplitude,
        frequency=params.twist_frequency,
        cycles=1000.0,
    )
    fixed = Hindered(
        samples=windows(*search, period=period),
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
        params.approach("level"),
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
            run=[up(params.lift, 1.0), upright, ShiftToContact(way=params.shift)],
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
            run=[up(params.back_off, 0.2)],
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
                    samples=windows(*verify, period=period), threshold=params.verify_threshold
                ),
            ],
            on={"hindered": DONE},
            timeout=2 * verify[0].duration,
        ),
    )
    return Skill(
        name="D connector",
        states=states,
        retract=[up(params.retract, 1.0)],
        held=not before,
    )
