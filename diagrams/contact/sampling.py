"""Steps of an arm's dynamics within the controller's period, and periods of a run."""

from typing import Final, NamedTuple

from chamfer.models.validation import ParameterError

_MOST_HELD: Final = 5000  # steps in a period
_REFRESH: Final = 1e-3  # s, at most, over which the torque and the surface's shape are held
_MOST_PERIODS: Final = 1_000_000  # of a run; its traces have a row for each


class Updates(NamedTuple):
    """How a period is divided."""

    held: int  # steps in an update of the arm
    window: int  # updates in a period


def require_steps(step: float, period: float) -> None:
    """Raise unless a period is a whole number of steps, s.

    Raises:
        ParameterError: Naming ``step``.
    """
    held = round(period / step)
    if not (1 <= held <= _MOST_HELD and abs(held * step / period - 1) < 1e-9):
        allowed = f"a whole part of the period, {period:g}, down to {period / _MOST_HELD:g}"
        raise ParameterError("step", step, allowed)


def require_periods(duration: float, period: float) -> None:
    """Raise unless a run has not too few and not too many periods, s.

    Raises:
        ParameterError: Naming ``duration``.
    """
    if not 10 <= duration / period <= _MOST_PERIODS:
        allowed = f"10 to {_MOST_PERIODS} periods of {period:g} s"
        raise ParameterError("duration", duration, allowed)


def updates_of(step: float, period: float) -> Updates:
    """Return the longest updates, up to a millisecond, of which a period is a whole number."""
    steps = round(period / step)
    most = max(1, round(_REFRESH / step))
    held = max(count for count in range(1, most + 1) if steps % count == 0)
    return Updates(held, steps // held)
