"""What a sensorimotor primitive is: it makes a velocity of what is sensed, and says when it ends.

Source: Morrow, Nelson and Khosla, section 3: "a parameterized encapsulation of sensing and
action". The velocities of primitives that run together add; accommodation perturbs their sum.
"""

import math
from collections.abc import Mapping
from typing import Any, ClassVar, Final, Literal, NamedTuple, TypeAlias, get_args

from pydrake.common.value import Value
from pydrake.systems.framework import BasicVector, Context, LeafSystem
from pydrake.systems.framework import State as DrakeState

from chamfer.models.validation import ParameterError
from chamfer.systems.vision.cross_section import CROSS_SECTION_SIZE
from chamfer.systems.vision.part_detector import DETECTION_SIZE

Vector: TypeAlias = tuple[float, ...]
Event = Literal["done", "contact", "lost", "hindered", "jammed"]

EVENTS: Final[tuple[Event, ...]] = get_args(Event)
STILL: Final[Vector] = (0.0,) * 6
TICK: Final = 0.01  # s, of a :class:`PrimitiveRunner` by default


class Observation(NamedTuple):
    """What primitives may know: encoders, wrist sensor, cameras. No true pose is among it.

    Velocities, displacements and wrenches have six elements, angular above linear, in the world's
    axes, Z against the direction of insertion; the reference point is the tool's tip as it was
    taught.
    """

    carriage: Vector  # of the tip, rad above m, by encoders and the wrist's known stiffness
    motion: Vector  # V_ref, rad/s above m/s, as accommodation gave it last
    wrench: Vector  # on the tool, N m above N, from the wrist sensor
    xz_detections: Vector | None = None  # of the camera along Y; None: no camera
    yz_detections: Vector | None = None  # of the camera along X
    cross_section: Vector | None = None  # of the camera on the gripper
    perturbed: Vector = STILL  # V_cmd of which accommodation made ``motion``
    spread: Vector | None = None  # of one reading of the wrench, as its zero was taken; None: not
    holding: Vector | None = None  # 1 while the gripper feels a part; None: it has no sensor


def sensed_sizes(parts: int) -> dict[str, int]:
    """Return the size of every port of :class:`Observation`, for cameras that see some parts."""
    return dict.fromkeys(Observation._fields, len(STILL)) | {
        "xz_detections": DETECTION_SIZE * parts,
        "yz_detections": DETECTION_SIZE * parts,
        "cross_section": CROSS_SECTION_SIZE,
        "holding": 1,
    }


class Stepped(NamedTuple):
    """What a primitive does at one tick."""

    memory: object  # immutable; what it needs at the next tick
    velocity: Vector = STILL  # V_cmd, rad/s above m/s
    event: Event | None = None  # None: it goes on


class Primitive:
    """A primitive: its parameters are its fields, everything that changes is in the memory.

    ``lost`` is the event of a primitive whose target or contact is gone. The first primitive of
    a state that has an event ends the state. One of one's own derives from it, and has a ``step``.
    """

    WORD: ClassVar[str] = "primitive"

    @property
    def label(self) -> str:
        """What a chart shows of it, such as "gmove -z": its word, and its direction or axes."""
        where = getattr(self, "direction", "") or ", ".join(getattr(self, "axes", ()))
        return f"{self.WORD} {where}".rstrip()

    @property
    def events(self) -> Mapping[Event, float]:
        """The events that it can have, with these parameters, each with the earliest time, s.

        The time counts from its begin; it is 0 where the world alone decides. By default none.
        """
        return {}

    def begin(self, sensed: Observation) -> object:
        """Return the memory at the tick at which it begins; by default nothing."""
        return None

    def step(self, sensed: Observation, memory: Any, time: float) -> Stepped:
        """Return what it does at a tick, ``time`` seconds after it began."""
        raise NotImplementedError


class _Content:
    """The block's state. It is immutable, so that contexts may share it instead of copying."""

    __slots__ = ("begun", "last")

    def __init__(self, begun: float | None, last: Stepped) -> None:
        self.begun = begun  # s; None: not yet
        self.last = last

    def __deepcopy__(self, memo: object) -> "_Content":
        return self


class PrimitiveRunner(LeafSystem):
    """Runs a primitive at a fixed period until it has an event; then it stands still.

    .. pydrake_system::

        name: PrimitiveRunner
        input_ports:
        - carriage
        - motion (optional)
        - wrench (optional)
        - xz_detections (optional)
        - yz_detections (optional)
        - cross_section (optional)
        - perturbed (optional)
        - spread (optional)
        - holding (optional)
        output_ports:
        - velocity
        - event

    The inputs are the fields of :class:`Observation`. Where
    ``motion`` is not connected nothing perturbs the command, where ``wrench`` is not nothing is
    touched. ``velocity``, shape (6,), rad/s above m/s, is held between ticks. ``event`` is 0 while
    the primitive runs, then 1 + the event's place in :data:`EVENTS`.

    Abstract state: when the primitive began, and what it did last.

    Args:
        primitive: What to run.
        parts: That the static cameras look for.
        period: s, time between ticks.
        offset: s, time of the first tick.

    Raises:
        ParameterError: If the period, the offset or the number of parts is not allowed.
    """

    def __init__(
        self, primitive: Primitive, *, parts: int = 2, period: float = TICK, offset: float = 0.0
    ) -> None:
        super().__init__()
        if not (math.isfinite(period) and period > 0):
            raise ParameterError("period", period, "a finite number > 0")
        if not (math.isfinite(offset) and offset >= 0):
            raise ParameterError("offset", offset, "a finite number >= 0")
        if not parts >= 1:
            raise ParameterError("parts", parts, "a whole number >= 1")
        self._inputs: dict[str, Any] = {
            name: self.DeclareVectorInputPort(name, size)
            for name, size in sensed_sizes(parts).items()
        }
        self._primitive = primitive
        state = self.DeclareAbstractState(Value[object](_Content(None, Stepped(None))))
        depends = {self.abstract_state_ticket(state)}
        self.DeclareVectorOutputPort("velocity", 6, self._calc_velocity, depends)
        self.DeclareVectorOutputPort("event", 1, self._calc_event, depends)
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, offset, self._tick)

    def event(self, context: Context) -> Event | None:
        """Return the event with which the primitive ended; None: it goes on."""
        return self._content(context).last.event

    def _content(self, context: Context) -> _Content:
        content: _Content = context.get_abstract_state(0).get_value()
        return content

    def _calc_velocity(self, context: Context, vector: BasicVector) -> None:
        vector.SetFromVector(self._content(context).last.velocity)

    def _calc_event(self, context: Context, vector: BasicVector) -> None:
        event = self.event(context)
        vector.SetAtIndex(0, 0.0 if event is None else 1.0 + EVENTS.index(event))

    def _tick(self, context: Context, state: DrakeState) -> None:
        content, primitive = self._content(context), self._primitive
        last = content.last
        if last.event is not None:
            return
        time = context.get_time()
        sensed = self._sensed(context, last.velocity)
        begun, memory = content.begun, last.memory
        if begun is None:
            begun, memory = time, primitive.begin(sensed)
        stepped = primitive.step(sensed, memory, time - begun)
        if not all(map(math.isfinite, stepped.velocity)):
            raise ParameterError(
                f"velocity of {primitive.label}", stepped.velocity, "finite numbers"
            )
        if stepped.event is not None:
            stepped = stepped._replace(velocity=STILL)
        content = _Content(begun, stepped)
        state.get_mutable_abstract_state().get_mutable_value(0).set_value(content)

    def _sensed(self, context: Context, velocity: Vector) -> Observation:
        read: dict[str, Vector] = {
            name: tuple(port.Eval(context).tolist())
            for name, port in self._inputs.items()
            if port.HasValue(context)
        }
        if "carriage" not in read:
            raise ParameterError(f"carriage of {self.get_name()}", None, "a connected port")
        return Observation(**{"motion": velocity, "wrench": STILL, **read})
