"""What may be wrong with what an observer of the normal is told, and what it finds out itself."""

from dataclasses import dataclass

from models.validation import ParameterError, require_not_negative


@dataclass(frozen=True, kw_only=True)
class ModelErrorParams:
    """How far gripper and sensor may be from what an observer is told of them.

    A deviation is a standard deviation; where an error has a bound, the bound itself or little
    less is honest at the bound, and cautious within it.
    """

    stiffness: float = 0.0  # relative, deviation of a factor that all of K may be off by
    bias: float = 0.0  # N, deviation of a constant error of F, on each axis
    tare: float = 0.0  # s, from the start, when the gripper is known to be free
    delay: float = 0.0  # s, by which the force is late
    delay_deviation: float = 0.0  # s, deviation of the delay

    def __post_init__(self) -> None:
        require_not_negative(self, "stiffness", "bias", "tare", "delay", "delay_deviation")
        if not self.stiffness < 1:
            raise ParameterError("stiffness", self.stiffness, "a part below 1")
        if self.tare and not self.bias:
            raise ParameterError("tare", self.tare, "0, if there is no bias to be found")
