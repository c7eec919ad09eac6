"""Contexts in which fields act that do nothing by default, and fields that may do nothing.

Paths are patterns of :mod:`fnmatch`, where ``*`` stands for any text. A ``*`` that begins a
pattern and a setting stands in both for the same fields above.
"""

import re
from fnmatch import fnmatchcase
from typing import Final, NamedTuple


class Context(NamedTuple):
    """Settings, ``path=value``, with which fields act; none for fields that may do nothing."""

    paths: str  # patterns, with spaces between them
    settings: tuple[str, ...] = ()
    experiment: str = "*"

    def holds_for(self, experiment: str, path: str) -> bool:
        """Return whether it is for that field of that experiment."""
        return fnmatchcase(experiment, self.experiment) and self._pattern(path) is not None

    def settings_for(self, path: str) -> tuple[str, ...]:
        """Return the settings for a field that it holds for."""
        pattern = self._pattern(path) or ""
        parts = path.split(".")
        above = ""
        while pattern.startswith("*") and not fnmatchcase(path[len(above) :], pattern[1:]):
            above += f"{parts.pop(0)}."
        return tuple(re.sub(r"^\*", above, setting) for setting in self.settings)

    def _pattern(self, path: str) -> str | None:
        return next((one for one in self.paths.split() if fnmatchcase(path, one)), None)


def _where(paths: str, *settings: str, of: str = "*") -> Context:
    return Context(paths, settings, of)


_BLOW: Final = ("*task.kick_time=2.2", "duration=3")  # loses contact
_OVERDAMPED: Final = ("*impedance.damping_ratio=5", "*impedance.allow_unstable=true")
_WEDGED: Final = (
    "initial_error=[0, 0.002, 0, 0, 0, -0.1]",
    "decide.kind=at_once",
    "insert.compensation=frozen",
    "duration=4",
)

CONTEXTS: Final = (
    # Servo loops: cells that some trials leave.
    _where("map.trials", "map.points=9"),
    # Hybrid control: of the sinusoid, of the ripple, of a blow, and while contact is lost.
    _where("*task.frequency *task.blend *task.along", "*task.amplitude=0.01"),
    _where("*surface.wavelength", "*surface.ripple=1e-4"),
    _where("*task.kick_speed *controller.creep_* *controller.loss_mode", *_BLOW),
    # Told by a force that is hardly felt.
    _where(
        "*detection.*",
        *("*task.force=1", "*sensor.noise=1", "*detection.detect=0.5", "*detection.release=0.1"),
    ),
    _where("*controller.inertia", "*controller.full_dynamics=true"),
    # Not with the transposed Jacobian.
    _where("*controller.full_dynamics", "*controller.law=projected", of="puma-*"),
    # Without stiffness all arms' loops are unstable, as with so much force integral.
    _where(
        "*controller.allow_unstable", "*controller.stiffness=0", "*controller.allow_unstable=true"
    ),
    _where(
        "controller.allow_unstable",
        *("controller.force_integral=50", "controller.allow_unstable=true"),
        of="unknown-surface-control*",
    ),
    _where("arm.elbow", "controller.allow_unstable=true", of="planar-*"),
    _where("*sensor.decoupling", "*sensor.cross_talk=0.1"),
    _where("*friction_compensation.bandwidth", "*friction_compensation={bandwidth: 20}"),
    # Unknown surfaces: of the ripple, of the jump, of a gate about as fast as the motion.
    _where("friction.wavelength", "friction.ripple=0.2"),
    _where("friction.jump_*", "friction.jump=0.3"),
    _where("*surface.friction.wavelength", "*surface.friction={coefficient: 0.3, ripple: 0.2}"),
    _where("*surface.friction.jump_*", "*surface.friction={coefficient: 0.3, jump: 0.3}"),
    _where("observer.halt_speed", "observer.kind=gated", "observer.halt_speed=0.15"),
    # The work cell.
    _where("*pid.*", "*controller.kind=pid"),
    _where("*impedance.allow_unstable", *_OVERDAMPED),
    _where("*cameras.most_misses", "*cameras.frames.miss=0.7"),
    # So slow that noise is a jump; by default nothing is.
    _where(
        "*cameras.continuity.speed *cameras.continuity.most_jumps",
        "*cameras.continuity={speed: 5}",
    ),
    _where("*cameras.continuity.turning", "*cameras.continuity={turning: 0.05}"),
    _where("*motion_time", "*start_offset=[0, 0, -0.02]"),  # on the way to the goal
    # Of an arm that its payload moves.
    _where(
        "hole.payload_position hole.joint_friction",
        "hole.payload_error=0.05",
        of="vertical-tracking",
    ),
    # Insertion by sight: a peg that is stuck, one that is held, a blind hole, parts that do not
    # get aligned, a decision that waits.
    _where(
        "insert.push insert.attempts insert.hold_force insert.force_limit",
        *("peg_excess=0.0003", "duration=6"),
        of="insertion*",
    ),
    _where("insert.pull insert.held_force", *_WEDGED, of="insertion*"),
    _where("insert.bottom_force", "parts.bore_depth=0.014", of="insertion*"),
    _where(
        "decide.timeout",
        *("compensated=none", "initial_error=[0, 0.006, 0, 0, 0, 0]", "duration=15"),
        of="insertion*",
    ),
    _where("compensation_time", "decide.kind=wait", "duration=6", of="insertion*"),
    # Two arms don't reach each other downwards.
    _where("axis", "hole.kind=fixture"),
    _where("alignment.axis", "alignment.hole.kind=fixture"),
    # Skills: hindered along x, else all axes are alike; beyond the bound; of the WAM.
    _where("dither.axis", "constraint.index=3"),
    _where(
        "accommodation.allow_unstable",
        "accommodation.damping=[1, 1, 1, 400, 400, 400]",
        "accommodation.allow_unstable=true",
    ),
    _where(
        "impedance.allow_unstable",
        "robot=wam",
        *(setting.removeprefix("*") for setting in _OVERDAMPED),
        of="*connector*",
    ),
    _where("arm.* impedance.*", "robot=wam", of="*connector*"),
    _where("arm.* impedance.*", "robot=wam", of="skill"),
    _where("gripper.*", "sight={}", of="skill"),
    _where("gripper.*", "sight={}", of="*success"),
    # Frames are missing.
    _where("*servoing.lost_frames", "loop.frames.miss=0.3", of="vision-primitives"),
    _where("sight.servoing.lost_frames", "sight={frames: {miss: 0.3}}"),
    _where("skill.back_off skill.re*", "obstacle=0.003"),  # of a push that jams
)
EXEMPTIONS: Final = (
    # What a connector stands refuses skills that push harder.
    Context("*connector.largest_*"),
    # In the plane only the sign of what is at right angles to the approach counts.
    Context("task.along", experiment="planar-unknown-wall"),
    # What is drawn alone.
    Context("depth_ratios", experiment="jamming-diagram"),
)
