"""Where fields act that do nothing by default, and which fields may do nothing.

Paths are patterns of :mod:`fnmatch`, where ``*`` stands for any text. A ``*`` that begins a
pattern and a setting stands in both for the same fields above.
"""

import re
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Final


@dataclass(frozen=True, kw_only=True)
class Context:
    """Settings with which a field acts."""

    path: str
    settings: tuple[str, ...]  # path=value
    reason: str
    experiment: str = "*"

    def holds_for(self, experiment: str, path: str) -> bool:
        """Whether it is for that field of that experiment."""
        return fnmatchcase(experiment, self.experiment) and fnmatchcase(path, self.path)

    def settings_for(self, path: str) -> tuple[str, ...]:
        """Return the settings for a field that it holds for."""
        parts = path.split(".")
        above = ""
        while self.path.startswith("*") and not fnmatchcase(path[len(above) :], self.path[1:]):
            above += f"{parts.pop(0)}."
        return tuple(re.sub(r"^\*", above, setting) for setting in self.settings)


@dataclass(frozen=True, kw_only=True)
class Exemption:
    """A field that changes nothing and is right to."""

    path: str
    reason: str
    experiment: str = "*"

    def holds_for(self, experiment: str, path: str) -> bool:
        """Whether it is for that field of that experiment."""
        return fnmatchcase(experiment, self.experiment) and fnmatchcase(path, self.path)


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
    Context(path="map.trials", settings=("map.points=9",), reason="cells that some trials leave"),
    # Hybrid control.
    *(
        Context(path=f"*task.{name}", settings=("*task.amplitude=0.01",), reason="of the sinusoid")
        for name in ("frequency", "blend", "along")
    ),
    Context(
        path="*surface.wavelength", settings=("*surface.ripple=1e-4",), reason="of the ripple"
    ),
    Context(path="*task.kick_speed", settings=_BLOW, reason="that a blow gives"),
    Context(path="*controller.creep_*", settings=_BLOW, reason="to find lost contact"),
    Context(path="*controller.loss_mode", settings=_BLOW, reason="while contact is lost"),
    Context(path="*detection.*", settings=_FAINT, reason="told by a force between the two"),
    Context(
        path="*controller.inertia",
        settings=("*controller.full_dynamics=true",),
        reason="of the full dynamics",
    ),
    Context(
        path="*controller.full_dynamics",
        settings=("*controller.law=projected",),
        experiment="puma-*",
        reason="not with the transposed Jacobian",
    ),
    Context(
        path="*controller.allow_unstable",
        settings=("*controller.stiffness=0", "*controller.allow_unstable=true"),
        reason="without stiffness all arms' loops are unstable",
    ),
    Context(
        path="controller.allow_unstable",
        settings=("controller.force_integral=50", "controller.allow_unstable=true"),
        experiment="unknown-surface-control*",
        reason="with so much force integral the loop is unstable",
    ),
    Context(
        path="arm.elbow",
        settings=("controller.allow_unstable=true",),
        experiment="planar-*",
        reason="unstable with the other sign",
    ),
    Context(
        path="*sensor.decoupling",
        settings=("*sensor.cross_talk=0.1",),
        reason="of the cross-talk",
    ),
    Context(
        path="*friction_compensation.bandwidth",
        settings=("*friction_compensation={bandwidth: 20}",),
        reason="none by default",
    ),
    # Unknown surfaces.
    Context(path="friction.wavelength", settings=("friction.ripple=0.2",), reason="of the ripple"),
    Context(path="friction.jump_*", settings=("friction.jump=0.3",), reason="of the jump"),
    Context(
        path="*surface.friction.wavelength",
        settings=("*surface.friction={coefficient: 0.3, ripple: 0.2}",),
        reason="of the ripple",
    ),
    Context(
        path="*surface.friction.jump_*",
        settings=("*surface.friction={coefficient: 0.3, jump: 0.3}",),
        reason="of the jump",
    ),
    Context(
        path="observer.halt_speed",
        settings=("observer.kind=gated", "observer.halt_speed=0.15"),
        reason="of the gate, and about as fast as the motion",
    ),
    # The work cell.
    Context(path="*pid.*", settings=("*controller.kind=pid",), reason="of the PID"),
    Context(path="*impedance.allow_unstable", settings=_OVERDAMPED, reason="beyond the bound"),
    Context(
        path="*cameras.most_misses",
        settings=("*cameras.frames.miss=0.7",),
        reason="frames are missing",
    ),
    *(
        Context(
            path=f"*cameras.continuity.{name}",
            settings=(f"*cameras.continuity={{{slow}}}",),
            reason="so slow that noise is a jump; by default nothing is",
        )
        for name, slow in (
            ("speed", "speed: 5"),
            ("turning", "turning: 0.05"),
            ("most_jumps", "speed: 5"),
        )
    ),
    Context(
        path="*motion_time",
        settings=("*start_offset=[0, 0, -0.02]",),
        reason="on the way from the start to the goal",
    ),
    *(
        Context(
            path=f"hole.{name}",
            settings=("hole.payload_error=0.05",),
            experiment="vertical-tracking",
            reason="of an arm that its payload moves",
        )
        for name in ("payload_position", "joint_friction")
    ),
    # Insertion by sight.
    *(
        Context(
            path=f"insert.{name}",
            settings=_THICK,
            experiment="insertion*",
            reason="of a peg that is stuck",
        )
        for name in ("push", "attempts", "hold_force", "force_limit")
    ),
    Context(
        path="insert.pull",
        settings=_WEDGED,
        experiment="insertion*",
        reason="of a peg that is held",
    ),
    Context(
        path="insert.held_force",
        settings=_WEDGED,
        experiment="insertion*",
        reason="of a peg that is held",
    ),
    Context(
        path="insert.bottom_force",
        settings=("parts.bore_depth=0.014",),
        experiment="insertion*",
        reason="of a blind hole",
    ),
    Context(
        path="decide.timeout",
        settings=("compensated=none", "initial_error=[0, 0.006, 0, 0, 0, 0]", "duration=15"),
        experiment="insertion*",
        reason="of parts that do not get aligned",
    ),
    Context(
        path="compensation_time",
        settings=("decide.kind=wait", "duration=6"),
        experiment="insertion*",
        reason="that the decision waits",
    ),
    *(
        Context(
            path=f"{above}axis",
            settings=(f"{above}hole.kind=fixture",),
            reason="two arms don't reach each other downwards",
        )
        for above in ("", "alignment.")
    ),
    # Skills.
    Context(
        path="dither.axis",
        settings=("constraint.index=3",),
        reason="hindered along x, else all axes are alike",
    ),
    Context(
        path="accommodation.allow_unstable",
        settings=(
            "accommodation.damping=[1, 1, 1, 400, 400, 400]",
            "accommodation.allow_unstable=true",
        ),
        reason="beyond the bound",
    ),
    Context(path="arm.*", settings=_WAM, experiment="*connector*", reason="of the WAM"),
    Context(
        path="impedance.allow_unstable",
        settings=(*_WAM, *(setting.removeprefix("*") for setting in _OVERDAMPED)),
        experiment="*connector*",
        reason="of the WAM, beyond the bound",
    ),
    Context(path="impedance.*", settings=_WAM, experiment="*connector*", reason="of the WAM"),
    Context(path="arm.*", settings=_WAM, experiment="skill", reason="of the WAM"),
    Context(path="impedance.*", settings=_WAM, experiment="skill", reason="of the WAM"),
    Context(path="gripper.*", settings=("sight={}",), experiment="skill", reason="it grasps"),
    Context(path="gripper.*", settings=("sight={}",), experiment="*success", reason="it grasps"),
    Context(
        path="*servoing.lost_frames",
        settings=("loop.frames.miss=0.3",),
        experiment="vision-primitives",
        reason="frames are missing",
    ),
    Context(
        path="sight.servoing.lost_frames",
        settings=("sight={frames: {miss: 0.3}}",),
        reason="frames are missing",
    ),
    Context(path="skill.back_off", settings=_JAMS, reason="of a push that jams"),
    Context(path="skill.re*", settings=_JAMS, reason="of a push that jams"),
)
EXEMPTIONS: Final[tuple[Exemption, ...]] = (
    Exemption(
        path="*connector.largest_*",
        reason="what a connector stands refuses skills that push harder",
    ),
    Exemption(
        path="task.along",
        experiment="planar-unknown-wall",
        reason="in the plane only the sign of what is at right angles to the approach counts",
    ),
)
