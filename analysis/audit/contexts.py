"""Where fields act that do nothing by default, and which fields may do nothing.

Paths are patterns of :mod:`fnmatch`, where ``*`` stands for any text.
"""

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

    def sets(self, path: str | None) -> bool:
        """Whether a path is among those that are set."""
        return any(setting.partition("=")[0] == path for setting in self.settings)


@dataclass(frozen=True, kw_only=True)
class Exemption:
    """A field that changes nothing and is right to."""

    path: str
    reason: str
    experiment: str = "*"

    def holds_for(self, experiment: str, path: str) -> bool:
        """Whether it is for that field of that experiment."""
        return fnmatchcase(experiment, self.experiment) and fnmatchcase(path, self.path)


_KICK: Final = ("task.kick_time=2.2", "duration=3")
_FAINT: Final = (
    "task.force=1",
    "sensor.noise=1",
    "detection.detect=0.5",
    "detection.release=0.1",
)
_WAVY: Final = ("surface.ripple=1e-4",)

CONTEXTS: Final[tuple[Context, ...]] = (
    Context(path="friction.wavelength", settings=("friction.ripple=0.2",), reason="of the ripple"),
    Context(path="friction.jump_*", settings=("friction.jump=0.3",), reason="of the jump"),
    Context(
        path="observer.halt_speed",
        settings=("observer.halt_speed=0.15",),
        reason="about as fast as the motion",
    ),
    Context(
        path="dither.axis",
        settings=("constraint.index=3",),
        reason="hindered along x, the same along all axes otherwise",
    ),
    Context(
        path="accommodation.allow_unstable",
        settings=(
            "accommodation.damping=[1, 1, 1, 400, 400, 400]",
            "accommodation.allow_unstable=true",
        ),
        reason="beyond the bound",
    ),
    Context(path="*task.frequency", settings=("task.amplitude=0.01",), reason="of the sinusoid"),
    Context(path="*task.blend", settings=("task.amplitude=0.01",), reason="of the sinusoid"),
    Context(path="*task.along", settings=("task.amplitude=0.01",), reason="of the sinusoid"),
    Context(path="*surface.wavelength", settings=_WAVY, reason="of the ripple"),
    Context(path="*task.kick_speed", settings=_KICK, reason="of a blow"),
    Context(path="*controller.creep_*", settings=_KICK, reason="contact is lost by a blow"),
    Context(path="*controller.loss_mode", settings=_KICK, reason="contact is lost by a blow"),
    Context(path="detection.*", settings=_FAINT, reason="a force that is hardly felt"),
    Context(
        path="controller.allow_unstable",
        settings=("controller.integral=1e5", "controller.allow_unstable=true"),
        reason="with gains that are unstable",
    ),
    Context(
        path="arm.elbow",
        settings=("controller.allow_unstable=true",),
        experiment="planar-*",
        reason="unstable with the other sign",
    ),
    Context(
        path="*controller.inertia",
        settings=("controller.full_dynamics=true",),
        reason="of the full dynamics",
    ),
    Context(
        path="controller.full_dynamics",
        settings=("controller.law=projected",),
        experiment="puma-*",
        reason="not with the transposed Jacobian",
    ),
    Context(
        path="*sensor.decoupling", settings=("sensor.cross_talk=0.1",), reason="of the cross-talk"
    ),
    Context(
        path="friction_compensation.bandwidth",
        settings=("friction_compensation={bandwidth: 20}",),
        reason="none by default",
    ),
    Context(path="arm.*", settings=("robot=wam",), experiment="*connector*", reason="of the WAM"),
    Context(
        path="impedance.*", settings=("robot=wam",), experiment="*connector*", reason="of the WAM"
    ),
    Context(path="gripper.*", settings=("sight={}",), experiment="*success", reason="what grasps"),
    Context(
        path="*servoing.lost_frames",
        settings=("loop.frames.miss=0.3",),
        experiment="vision-primitives",
        reason="frames are missing",
    ),
    Context(
        path="*servoing.lost_frames",
        settings=("sight={frames: {miss: 0.3}}",),
        experiment="*connector*",
        reason="frames are missing",
    ),
    Context(
        path="skill.back_off",
        settings=("obstacle=0.003",),
        reason="the push jams on something in the way",
    ),
    Context(
        path="skill.re*",
        settings=("obstacle=0.003",),
        reason="the push jams on something in the way",
    ),
)
EXEMPTIONS: Final[tuple[Exemption, ...]] = ()
