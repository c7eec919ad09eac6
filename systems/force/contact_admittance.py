"""The law that offsets a position-controlled arm's command by the force at its wrist."""

import math
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple, get_args

import numpy as np

from chamfer.models.peg.support import Support
from chamfer.models.validation import (
    ParameterError,
    require_numbers,
    require_one_of,
    require_same,
)
from chamfer.systems.force.accommodation_law import AXES, WRENCH, AccommodationObservation
from chamfer.systems.force.admittance_law import AdmittanceLaw, AdmittanceParams, AdmittanceState
from chamfer.systems.force.tool_pose import (
    POSE,
    advance_of,
    axes_of,
    compensate,
    share_of_compensation,
)
from chamfer.systems.law import Array, Law, Signal

AdmittanceKind = Literal["wrist", "none"]

_SIX: Final = len(AXES)
_GRAVITY: Final = np.array([0.0, 0.0, -9.81])  # m/s^2, in the world
_RECENTRED: Final = 0.1  # s, time constant with which a displacement is taken back; assumed


@dataclass(frozen=True, kw_only=True)
class ContactAdmittanceParams:
    """``M v' + D v + K x = F``: how far, x, the arm goes from its command for a wrench F.

    About and along the hole's axes, x into it: rx, ry, rz in N m and rad, x, y, z in N and m.
    """

    kind: AdmittanceKind = "wrist"
    # wrist: gives way to the wrist sensor's force; none: to nothing, what gives way is below it
    inertia: tuple[float, ...] = (0.0,) * _SIX  # kg m^2 and kg, M; 0: none
    damping: tuple[float, ...] | None = None
    # N m s/rad and N s/m, D; None: derived, what the contact needs
    spring: tuple[float, ...] = (5.0, 5.0, 5.0, 400.0, 400.0, 400.0)
    # N m/rad and N/m, K, towards the command
    centre: tuple[float, ...] = (0.0, 0.0, 0.0)  # m, of compliance, from the peg's tip

    def __post_init__(self) -> None:
        require_one_of(self, "kind", get_args(AdmittanceKind))
        require_numbers(self, 3, "centre")
        if len(self.inertia) != _SIX or not all(0 <= value < math.inf for value in self.inertia):
            raise ParameterError("inertia", self.inertia, "six finite numbers >= 0")
        if len(self.spring) != _SIX or not all(0 < value < math.inf for value in self.spring):
            raise ParameterError("spring", self.spring, "six finite numbers > 0")
        given = self.damping
        positive = given is None or (len(given) == _SIX and all(0 < d < math.inf for d in given))
        if not positive:
            raise ParameterError("damping", given, "six finite numbers > 0, or null")
        if self.kind == "none":
            names = "inertia", "damping", "spring", "centre"
            why = "admittance.kind is none"
            require_same(self, ContactAdmittanceParams, "", *names, why=why)

    @property
    def stiffness(self) -> tuple[float, ...]:
        """K, N m/rad and N/m; infinity along rigid axes."""
        return self.spring if self.kind == "wrist" else (math.inf,) * _SIX

    @property
    def support(self) -> Support | None:
        """The support that its springs give a peg; None: it is rigid."""
        _, pitch, yaw, _, y, z = self.spring
        if self.kind == "none":
            return None
        return Support(
            lateral_stiffness=min(y, z),
            angular_stiffness=min(pitch, yaw),
            centre_distance=-self.centre[0],
        )


@dataclass(frozen=True, kw_only=True)
class WristSetting:
    """The law's knowledge of sensor, tool and hole."""

    R_WH: Array  # axes of the hole, x into it, shape (3, 3)
    R_TS: Array  # axes of the sensor in the tool's frame T, likewise
    tool_mass: float  # kg, that hangs below the sensor, as is believed
    p_TC: Array  # m, its centre of mass, shape (3,)
    hole_pose: Array  # quaternion w, x, y, z and position of the mouth, m, shape (7,)
    period: float  # s, of the law


class ContactAdmittanceObservation(NamedTuple):
    """Inputs of the law."""

    desired_pose: Array
    reading: Array
    tool_pose: Array
    tares: Array


class ContactAdmittanceState(NamedTuple):
    """Memory from one step to the next, shape (6,) except for the count, (1,)."""

    velocity: Array
    perturbed: Array
    displacement: Array
    zero: Array  # N m above N, of the readings
    counted: Array  # of the readings of the zero that is being taken


class ContactAdmittanceCommand(NamedTuple):
    """Outputs of the law."""

    reference_pose: Array
    force: Array
    advance: Array


class ContactAdmittanceLaw(
    Law[ContactAdmittanceState, ContactAdmittanceObservation, ContactAdmittanceCommand]
):
    """See :class:`chamfer.systems.force.wrist_wrench.ContactAdmittance`."""

    observation = ContactAdmittanceObservation

    def __init__(self, params: ContactAdmittanceParams, setting: WristSetting) -> None:
        damping = params.damping if params.kind == "wrist" else (math.inf,) * _SIX
        if damping is None:
            raise ParameterError("damping", None, "six numbers > 0")
        period = setting.period
        # That the loop is stable in contact is known where the arm is.
        self._give_way = AdmittanceLaw(
            AdmittanceParams(
                inertia=params.inertia,
                damping=damping,
                spring=params.spring,
                centre=params.centre,
                period=period,
                allow_unstable=True,
            )
        )
        self._setting = setting
        self._weight = setting.tool_mass * (_GRAVITY @ setting.R_WH)
        self._kept = math.exp(-period / _RECENTRED)
        # compensate() takes m above rad.
        self._moves = np.roll(share_of_compensation(1.0, setting.R_WH), 3, axis=1)
        pose, nothing = POSE._replace(finite=True), np.zeros(_SIX)
        super().__init__(
            period=period,
            inputs={
                "desired_pose": pose,
                "reading": Signal(_SIX, WRENCH, finite=True),
                "tool_pose": pose,
                "tares": Signal(),
            },
            outputs={"reference_pose": POSE, "force": Signal(3, "N"), "advance": Signal(1, "m")},
            start=ContactAdmittanceState(*self._give_way.start(), nothing, np.zeros(1)),
        )

    def step(
        self, state: ContactAdmittanceState, observation: ContactAdmittanceObservation, time: float
    ) -> tuple[ContactAdmittanceState, ContactAdmittanceCommand]:
        """Return the state after a step, and the pose that is commanded."""
        desired, reading, tool, tares = observation
        wrench, zero, count = self._weighed(reading, tool), state.zero, np.zeros(1)
        if tares[0] >= 0.5:
            count = state.counted + 1
            zero = wrench if count[0] == 1 else zero + (wrench - zero) / count
            still = np.zeros(_SIX)
            given = AdmittanceState(still, still, self._kept * state.displacement)
            wrench = still
        else:
            wrench = wrench - zero
            seen = AccommodationObservation(np.zeros(_SIX), wrench, None)
            given = self._give_way.update(AdmittanceState(*state[:3]), seen, time)
        told = ContactAdmittanceCommand(
            compensate(desired, self._moves @ given.displacement),
            -wrench[3:],
            np.array([advance_of(tool, self._setting.hole_pose)]),
        )
        return ContactAdmittanceState(*given, zero, count), told

    def _weighed(self, reading: Array, tool_pose: Array) -> Array:
        """Return a reading in the hole's axes, less the tool's believed weight."""
        setting = self._setting
        R_HT = setting.R_WH.T @ axes_of(tool_pose)
        turned: Array = reading.reshape(2, 3) @ (R_HT @ setting.R_TS).T
        (x, y, z), (fx, fy, fz) = (R_HT @ setting.p_TC).tolist(), self._weight.tolist()
        turned[0] -= (y * fz - z * fy, z * fx - x * fz, x * fy - y * fx)
        turned[1] -= self._weight
        return turned.ravel()
