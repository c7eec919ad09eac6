"""A sensorimotor primitive: it computes a velocity from sensor data, and ends with an event.

Source: Morrow, Nelson and Khosla, section 3: "a parameterized encapsulation of sensing and
action". The velocities of primitives that run together add; accommodation perturbs their sum.
"""

from collections.abc import Mapping
from typing import Any, ClassVar, Final, Literal, NamedTuple, TypeAlias, get_args

from chamfer.systems.force.accommodation_law import VELOCITY, WRENCH
from chamfer.systems.law import Signal
from chamfer.systems.vision.detections import (
    CROSS_SECTION_SIZE,
    CROSS_SECTION_UNITS,
    DETECTION_UNITS,
)

Vector: TypeAlias = tuple[float, ...]
Event = Literal["done", "contact", "lost", "hindered", "jammed", "tilted"]

EVENTS: Final[tuple[Event, ...]] = get_args(Event)
STILL: Final[Vector] = (0.0,) * 6
TICK: Final = 0.01  # s
DISPLACEMENT: Final = ("rad",) * 3 + ("m",) * 3
# m/s and rad/s, faster than arms are: what commands more was given in other units.
FASTEST: Final = 3.0
FASTEST_TURN: Final = 10.0


class Observation(NamedTuple):
    """Inputs of all primitives: encoders, wrist sensor, cameras. No true pose is among them.

    Velocities, displacements and wrenches have six elements, angular above linear, in the world's
    axes, Z against the direction of insertion. The reference point is the tool's tip as it was
    taught.
    """

    carriage: Vector  # of the tip, rad above m, by encoders and the wrist's known stiffness
    motion: Vector  # V_ref, rad/s above m/s, the last output of accommodation
    wrench: Vector  # on the tool, N m above N, from the wrist sensor
    xz_detections: Vector | None = None  # of the camera along Y; None: no camera
    yz_detections: Vector | None = None  # of the camera along X
    cross_section: Vector | None = None  # of the camera on the gripper
    perturbed: Vector = STILL  # V_cmd from which accommodation made ``motion``
    spread: Vector | None = None
    # standard deviation of one reading of the wrench, from the tare; None: no tare
    holding: Vector | None = None  # 1 while the gripper detects a part; None: it has no sensor


def sensed_signals(parts: int) -> dict[str, Signal]:
    """Return the signal of each field of :class:`Observation`, for cameras that see some parts."""
    size = len(STILL)
    detections = Signal(len(DETECTION_UNITS) * parts, DETECTION_UNITS * parts, optional=True)
    return {
        "carriage": Signal(size, DISPLACEMENT),
        "motion": Signal(size, VELOCITY),
        "wrench": Signal(size, WRENCH),
        "xz_detections": detections,
        "yz_detections": detections,
        "cross_section": Signal(CROSS_SECTION_SIZE, CROSS_SECTION_UNITS, optional=True),
        "perturbed": Signal(size, VELOCITY),
        "spread": Signal(size, WRENCH, optional=True),
        "holding": Signal(optional=True),
    }


class Stepped(NamedTuple):
    """The result of a primitive's tick."""

    memory: object  # immutable; for the next tick
    velocity: Vector = STILL  # V_cmd, rad/s above m/s
    event: Event | None = None  # None: it goes on


class Primitive:
    """A primitive: its parameters are its fields, everything that changes is in the memory.

    ``lost`` is the event of a primitive whose target or contact is gone, ``tilted`` that of one
    that has jammed out of line. The first primitive of a state that has an event ends the state.
    Your own primitive derives from this class and has a ``step``.
    """

    WORD: ClassVar[str] = "primitive"

    @property
    def label(self) -> str:
        """The name in a chart, such as "gmove -z": its word, and its direction or axes."""
        where = getattr(self, "direction", "") or ", ".join(getattr(self, "axes", ()))
        return f"{self.WORD} {where}".rstrip()

    @property
    def events(self) -> Mapping[Event, float]:
        """The events that it can have, with these parameters, each with the earliest time, s.

        The time counts from its start; it is 0 where only the environment decides. By default
        none.
        """
        return {}

    def begin(self, sensed: Observation) -> object:
        """Return the memory at its first tick; ``perturbed`` is what was commanded until then."""
        return None

    def step(self, sensed: Observation, memory: Any, time: float) -> Stepped:
        """Return the result of a tick, ``time`` seconds after it began."""
        raise NotImplementedError
