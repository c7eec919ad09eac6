"""The strategy that inserts a BNC connector (Fig. 6).

Source: Morrow, Nelson and Khosla. The paper's text gives the three phases and the primitives; the
figure's transitions and all numbers are reconstructed.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

from models.validation import require_one_of, require_positive
from systems.skills.force_primitives import GuardedMove, Hindered, Push, Stick
from systems.skills.plug_insertion import PlugInsertionParams, up, windows
from systems.skills.skill import DONE, Retry, Skill, SkillState
from systems.skills.trajectory_primitives import Dither, MoveDx

Turn = Literal["-rz", "+rz"]


@dataclass(frozen=True, kw_only=True)
class BncConnectorSkillParams(PlugInsertionParams):
    """Parameters of the insertion; all of them are assumed."""

    drop: float = 0.001  # m, of a sleeve over the barrel, or with its slots over the studs
    stud_limit: float = 0.005  # m, of the push to the studs; beyond they are in the slots
    sweep_amplitude: float = math.pi / 2  # rad, of the turn that searches for the slots
    sweep_frequency: float = 0.05  # Hz, of the turn that searches for the slots
    compress_speed: float = 0.023  # m/s, of the push that compresses the spring
    compress_force: float = 16.0  # N, at which the spring counts as fully compressed
    compress_depth: float = 0.006  # m, least depth of a compression that is not jammed
    turn: Turn = "-rz"  # that locks, about the tool's z
    turn_speed: float = 0.8  # rad/s, of the turn that locks
    turn_torque: float = 0.35  # N m, of the stop at the turn's end; a turn takes 0.28 at most
    turn_distance: float = 1.2  # rad, least angle of the turn
    pull_speed: float = 0.0165  # m/s, of the pull that tests the lock
    pull_force: float = 10.0  # N, that the detents have to hold
    pull_limit: float = 0.0025  # m, way after which the pull has found no hold
    verify_amplitude: float = 0.15  # rad, more than the studs' play in the slots

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(
            self,
            "stud_limit",
            "sweep_amplitude",
            "sweep_frequency",
            "compress_speed",
            "compress_force",
            "compress_depth",
            "turn_speed",
            "turn_torque",
            "turn_distance",
            "pull_speed",
            "pull_force",
            "pull_limit",
        )
        require_one_of(self, "turn", get_args(Turn))


def make_bnc_connector_skill(
    params: BncConnectorSkillParams,
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
    search = params.search
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
    second = round(1 / period)
    states = (
        *before,
        params.approach("enter"),
        SkillState(
            name="enter",
            run=[
                stick,
                *search,
                params.upright,
                Hindered(samples=windows(*search, period=period)),
            ],
            on={"lost": "to the studs", "hindered": "to the studs"},
            timeout=2 * search[0].duration,
        ),
        SkillState(
            name="to the studs",
            run=[params.guarded(params.stud_limit)],
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
                    samples=windows(wiggle, period=period),
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
        retract=[up(params.retract, 1.0)],
        held=not before,
    )
