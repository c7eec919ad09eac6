"""Where fields act that do nothing by default, and which fields may do nothing.

Paths are patterns of :mod:`fnmatch`, where ``*`` stands for any text. A ``*`` that begins a
pattern and a setting stands in both for the same fields above.
"""

import re
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Final


@dataclass(frozen=True)
class Exemption:
    """A field that changes nothing and is right to."""

    path: str
    reason: str
    experiment: str = "*"

    def holds_for(self, experiment: str, path: str) -> bool:
        """Whether it is for that field of that experiment."""
        return fnmatchcase(experiment, self.experiment) and fnmatchcase(path, self.path)


@dataclass(frozen=True)
class Context(Exemption):
    """Settings, ``path=value``, with which a field acts."""

    settings: tuple[str, ...] = ()

    def settings_for(self, path: str) -> tuple[str, ...]:
        """Return the settings for a field that it holds for."""
        parts = path.split(".")
        above = ""
        while self.path.startswith("*") and not fnmatchcase(path[len(above) :], self.path[1:]):
            above += f"{parts.pop(0)}."
        return tuple(re.sub(r"^\*", above, setting) for setting in self.settings)


def _where(path: str, *settings: str, why: str, of: str = "*") -> Context:
    return Context(path, why, of, settings)


_BLOW: Final = ("*task.kick_time=2.2", "duration=3")  # loses contact
_FAINT: Final = (  # a force that is hardly felt
    "*task.force=1",
    "*sensor.noise=1",
    "*detection.detect=0.5",
    "*detection.release=0.1",
)
_OVERDAMPED: Final = ("*impedance.damping_ratio=5", "*impedance.allow_unstable=true")
_WAM: Final = ("robot=wam",)
_JAMS: Final = ("obstacle=0.003",)

_THICK: Final = ("peg_excess=0.0003", "duration=6")
_WEDGED: Final = (
    "initial_error=[0, 0.002, 0, 0, 0, -0.1]",
    "decide.kind=at_once",
    "insert.compensation=frozen",
    "duration=4",
)

CONTEXTS: Final[tuple[Context, ...]] = (
    # Servo loops.
    _where("map.trials", "map.points=9", why="cells that some trials leave"),
    # Hybrid control.
    *(
        _where(f"*task.{name}", "*task.amplitude=0.01", why="of the sinusoid")
        for name in ("frequency", "blend", "along")
    ),
    _where("*surface.wavelength", "*surface.ripple=1e-4", why="of the ripple"),
    _where("*task.kick_speed", *_BLOW, why="that a blow gives"),
    _where("*controller.creep_*", *_BLOW, why="to find lost contact"),
    _where("*controller.loss_mode", *_BLOW, why="while contact is lost"),
    _where("*detection.*", *_FAINT, why="told by a force between the two"),
    _where("*controller.inertia", "*controller.full_dynamics=true", why="of the full dynamics"),
    _where(
        "*controller.full_dynamics",
        "*controller.law=projected",
        why="not with the transposed Jacobian",
        of="puma-*",
    ),
    _where(
        "*controller.allow_unstable",
        "*controller.stiffness=0",
        "*controller.allow_unstable=true",
        why="without stiffness all arms' loops are unstable",
    ),
    _where(
        "controller.allow_unstable",
        "controller.force_integral=50",
        "controller.allow_unstable=true",
        why="with so much force integral the loop is unstable",
        of="unknown-surface-control*",
    ),
    _where(
        "arm.elbow",
        "controller.allow_unstable=true",
        why="unstable with the other sign",
        of="planar-*",
    ),
    _where("*sensor.decoupling", "*sensor.cross_talk=0.1", why="of the cross-talk"),
    _where(
        "*friction_compensation.bandwidth",
        "*friction_compensation={bandwidth: 20}",
        why="none by default",
    ),
    # Unknown surfaces.
    _where("friction.wavelength", "friction.ripple=0.2", why="of the ripple"),
    _where("friction.jump_*", "friction.jump=0.3", why="of the jump"),
    _where(
        "*surface.friction.wavelength",
        "*surface.friction={coefficient: 0.3, ripple: 0.2}",
        why="of the ripple",
    ),
    _where(
        "*surface.friction.jump_*",
        "*surface.friction={coefficient: 0.3, jump: 0.3}",
        why="of the jump",
    ),
    _where(
        "observer.halt_speed",
        "observer.kind=gated",
        "observer.halt_speed=0.15",
        why="of the gate, and about as fast as the motion",
    ),
    # The work cell.
    _where("*pid.*", "*controller.kind=pid", why="of the PID"),
    _where("*impedance.allow_unstable", *_OVERDAMPED, why="beyond the bound"),
    _where("*cameras.most_misses", "*cameras.frames.miss=0.7", why="frames are missing"),
    *(
        _where(
            f"*cameras.continuity.{name}",
            f"*cameras.continuity={{{slow}}}",
            why="so slow that noise is a jump; by default nothing is",
        )
        for name, slow in (
            ("speed", "speed: 5"),
            ("turning", "turning: 0.05"),
            ("most_jumps", "speed: 5"),
        )
    ),
    _where(
        "*motion_time", "*start_offset=[0, 0, -0.02]", why="on the way from the start to the goal"
    ),
    *(
        _where(
            f"hole.{name}",
            "hole.payload_error=0.05",
            why="of an arm that its payload moves",
            of="vertical-tracking",
        )
        for name in ("payload_position", "joint_friction")
    ),
    # Insertion by sight.
    *(
        _where(f"insert.{name}", *_THICK, why="of a peg that is stuck", of="insertion*")
        for name in ("push", "attempts", "hold_force", "force_limit")
    ),
    _where("insert.pull", *_WEDGED, why="of a peg that is held", of="insertion*"),
    _where("insert.held_force", *_WEDGED, why="of a peg that is held", of="insertion*"),
    _where(
        "insert.bottom_force", "parts.bore_depth=0.014", why="of a blind hole", of="insertion*"
    ),
    _where(
        "decide.timeout",
        "compensated=none",
        "initial_error=[0, 0.006, 0, 0, 0, 0]",
        "duration=15",
        why="of parts that do not get aligned",
        of="insertion*",
    ),
    _where(
        "compensation_time",
        "decide.kind=wait",
        "duration=6",
        why="that the decision waits",
        of="insertion*",
    ),
    *(
        _where(
            f"{above}axis",
            f"{above}hole.kind=fixture",
            why="two arms don't reach each other downwards",
        )
        for above in ("", "alignment.")
    ),
    # Skills.
    _where("dither.axis", "constraint.index=3", why="hindered along x, else all axes are alike"),
    _where(
        "accommodation.allow_unstable",
        "accommodation.damping=[1, 1, 1, 400, 400, 400]",
        "accommodation.allow_unstable=true",
        why="beyond the bound",
    ),
    _where("arm.*", *_WAM, why="of the WAM", of="*connector*"),
    _where(
        "impedance.allow_unstable",
        *_WAM,
        *(setting.removeprefix("*") for setting in _OVERDAMPED),
        why="of the WAM, beyond the bound",
        of="*connector*",
    ),
    _where("impedance.*", *_WAM, why="of the WAM", of="*connector*"),
    _where("arm.*", *_WAM, why="of the WAM", of="skill"),
    _where("impedance.*", *_WAM, why="of the WAM", of="skill"),
    _where("gripper.*", "sight={}", why="it grasps", of="skill"),
    _where("gripper.*", "sight={}", why="it grasps", of="*success"),
    _where(
        "*servoing.lost_frames",
        "loop.frames.miss=0.3",
        why="frames are missing",
        of="vision-primitives",
    ),
    _where("sight.servoing.lost_frames", "sight={frames: {miss: 0.3}}", why="frames are missing"),
    _where("skill.back_off", *_JAMS, why="of a push that jams"),
    _where("skill.re*", *_JAMS, why="of a push that jams"),
)
EXEMPTIONS: Final = (
    Exemption("*connector.largest_*", "what a connector stands refuses skills that push harder"),
    Exemption(
        "task.along",
        "in the plane only the sign of what is at right angles to the approach counts",
        "planar-unknown-wall",
    ),
)
