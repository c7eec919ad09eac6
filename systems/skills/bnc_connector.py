"""The strategy that inserts a BNC connector (Fig. 6).

Source: Morrow, Nelson and Khosla. The paper's text gives the three phases and the primitives; the
figure's transitions and all numbers are reconstructed.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

from models.validation import ParameterError, require_one_of, require_positive
from systems.skills.force_primitives import GuardedMove, Hindered, Hold, Push, Stick
from systems.skills.skill import DONE, Retry, Skill, SkillState
from systems.skills.trajectory_primitives import Dither, MoveDx, lissajous

Turn = Literal["-rz", "+rz"]


@dataclass(frozen=True, kw_only=True)
class BncConnectorSkillParams:
    """Parameters of the insertion; all of them are assumed."""

    period: float = 0.01  # s, between two ticks
    approach_speed: float = 0.01  # m/s
    contact_force: float = 4.0  # N, of guarded moves
    approach_limit: float = 0.02  # m, of the first guarded move
    maintained: float = 0.008  # m/s, of stick
    drop: float = (
        0.001  # m, of a sleeve that drops over the barrel, or with its slots on the studs
    )
    hold_gain: float = 10.0  # 1/s, of the orientation in the search
    centring: float = 3.0  # 1/s, of the search
    search_amplitude: float = 0.0022  # m
    search_frequency: float = 0.6  # Hz, of the slower dither
    search_repeats: int = 8  # N, cycles of it
    stud_limit: float = 0.005  # m, of the push to the studs; beyond they are in the slots
    sweep_amplitude: float = math.pi / 2  # rad, of the search for the slots
    sweep_frequency: float = 0.05  # Hz
    compress_speed: float = 0.023  # m/s
    compress_force: float = 16.0  # N, that counts as fully compressed
    compress_depth: float = 0.006  # m, least depth of a compression that is not jammed
    turn: Turn = "-rz"
    turn_speed: float = 0.8  # rad/s
    turn_torque: float = 0.35  # N m, of the stop at the turn's end
    turn_distance: float = 1.2  # rad, least angle of the turn
    pull_speed: float = 0.0165  # m/s
    pull_force: float = 10.0  # N, that the detents have to hold
    pull_limit: float = 0.0025  # m
    verify_amplitude: float = 0.15  # rad, more than the studs' play in the slots
    verify_frequency: float = 0.5  # Hz
    verify_threshold: float = 1.0  # of C; free is pi^2/8
    retries: int = 3
    retract: float = 0.03  # m

    def __post_init__(self) -> None:
        require_positive(
            self,
            *(
                name
                for name in self.__dataclass_fields__
                if name not in ("turn", "search_repeats", "retries")
            ),
        )
        require_one_of(self, "turn", get_args(Turn))
        for name in ("search_repeats", "retries"):
            if not getattr(self, name) >= 1:
                raise ParameterError(name, getattr(self, name), "a whole number >= 1")


def make_bnc_connector_skill(
    params: BncConnectorSkillParams, *, height: float = 0.005, before: Sequence[SkillState] = ()
) -> Skill:
    """Return the skill.

    Args:
        params: Speeds, forces and amplitudes.
        height: Of the plug over the socket before the approach, m, within 1 mm.
        before: States that grasp and transport the plug; the last one leads to ``approach``.
            Without them the plug is held from the begin.
    """
    stick = Stick(speed=params.maintained, threshold=params.drop)
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
    sweep = Dither(
        kind="rotary",
        axis="z",
        amplitude=params.sweep_amplitude,
        frequency=params.sweep_frequency,
        cycles=1.0,
    )
    wiggle = Dither(
        kind="rotary",
        axis="z",
        amplitude=params.verify_amplitude,
        frequency=params.verify_frequency,
        cycles=4.0,
    )
    second = round(1 / params.period)
    windows = tuple(round(1 / (dither.frequency * params.period)) for dither in search)
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
            on={"contact": "enter"},
            timeout=2 * params.approach_limit / params.approach_speed,
        ),
        SkillState(
            name="enter",
            run=[
                stick,
                *search,
                Hold(axes=("rx", "ry"), gain=params.hold_gain),
                Hindered(samples=windows),
            ],
            on={"lost": "to the studs", "hindered": "to the studs"},
            timeout=2 * search[0].duration,
        ),
        SkillState(
            name="to the studs",
            run=[
                GuardedMove(
                    speed=params.approach_speed,
                    threshold=params.contact_force,
                    limit=params.stud_limit,
                )
            ],
            on={"contact": "find slots", "lost": "compress"},
            timeout=5.0,
        ),
        SkillState(
            name="find slots",
            # Hindered are studs that are in the slots already.
            run=[stick, sweep, Hindered(axes=("rz",), samples=(second,))],
            on={"lost": "compress", "hindered": "compress"},
            timeout=2 * sweep.duration,
        ),
        SkillState(
            name="compress",
            from_mark=True,
            run=[
                Push(
                    speed=params.compress_speed,
                    force=params.compress_force,
                    distance=height + params.compress_depth,
                )
            ],
            on={"done": "turn", "jammed": Retry("find slots", params.retries)},
            timeout=3.0,
        ),
        SkillState(
            name="turn",
            run=[
                Stick(speed=params.compress_speed, threshold=math.inf),
                Push(
                    direction=params.turn,
                    speed=params.turn_speed,
                    force=params.turn_torque,
                    distance=params.turn_distance,
                ),
            ],
            on={"done": "release", "jammed": Retry("find slots", params.retries)},
            timeout=2 * math.pi / params.turn_speed,
        ),
        SkillState(
            name="release",
            run=[MoveDx(duration=0.5)],
            on={"done": "verify"},
            timeout=1.0,
        ),
        SkillState(
            name="verify",
            run=[
                wiggle,
                Hindered(
                    axes=("rz",),
                    samples=(round(1 / (wiggle.frequency * params.period)),),
                    threshold=params.verify_threshold,
                ),
            ],
            on={"hindered": "pull", "done": Retry("find slots", params.retries)},
            timeout=2 * wiggle.duration,
        ),
        SkillState(
            name="pull",
            run=[
                GuardedMove(
                    direction="+z",
                    speed=params.pull_speed,
                    threshold=params.pull_force,
                    limit=params.pull_limit,
                )
            ],
            on={"contact": DONE, "lost": Retry("approach", params.retries)},
            timeout=3.0,
        ),
    )
    return Skill(
        name="BNC connector",
        states=states,
        retract=[MoveDx(displacement=(0.0, 0.0, 0.0, 0.0, 0.0, params.retract), duration=1.0)],
        held=not before,
    )
