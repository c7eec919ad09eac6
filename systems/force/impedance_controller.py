"""Cartesian impedance control of an arm (Ruybal, Lumia and Wood, eq. 1)."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem
from scipy.linalg import null_space

from chamfer.models.arms.serial_arm import SerialArm
from chamfer.models.validation import ParameterError, require_not_negative, require_positive
from chamfer.systems.force.arm_model import ArmModel, Vector3
from chamfer.systems.force.impedance_law import (
    all_finite,
    impedance_torque,
    modal_damping,
    stable_damping_ratios,
)
from chamfer.systems.pose import pose_vector

Array = NDArray[np.float64]

# Added to the diagonal of (J M^-1 J^T), relative to its value at the rest posture, before it is
# inverted: the null space's projection stays finite where the arm is singular.
_REGULARISATION: Final = 1e-6
_STILL: Final = np.zeros(6)


@dataclass(frozen=True, kw_only=True)
class ImpedanceControllerParams:
    """Parameters of :class:`ImpedanceController`; axes are those of the desired pose."""

    stiffness: Vector3 = (400.0, 400.0, 400.0)  # N/m, along each axis; section 5, alignment
    rotational_stiffness: Vector3 = (5.0, 5.0, 5.0)  # N m/rad, about each axis; section 5
    damping_ratio: float = 0.7  # of all six modes, from which the damping follows; assumed
    null_stiffness: float = 5.0  # N m/rad, of every joint towards the rest posture; assumed
    null_damping_ratio: float = 0.7  # of every joint's motion that doesn't move the tool; assumed
    torque_limits: tuple[float, ...] | None = None  # N m, of each joint; None: the arm's own
    smallest_singular_value: float = 0.05  # of the rest posture's Jacobian, rad and m
    allow_unstable: bool = False  # True: run with damping beyond what the period allows
    period: float = 0.002  # s, of the controller, 500 Hz; assumed

    def __post_init__(self) -> None:
        require_positive(self, "damping_ratio", "null_damping_ratio", "period")
        require_not_negative(self, "null_stiffness", "smallest_singular_value")
        for name in ("stiffness", "rotational_stiffness"):
            self._require_some(name, 3)
        if self.torque_limits is not None:
            self._require_some("torque_limits", len(self.torque_limits))

    def limits(self, arm: SerialArm) -> Array:
        """Return the largest torques of an arm's joints, N m, shape (n,).

        Raises:
            ParameterError: If they are of another number of joints.
        """
        if self.torque_limits is None:
            return np.array(arm.torque_limits)
        self._require_some("torque_limits", arm.num_joints)
        return np.array(self.torque_limits)

    def _require_some(self, name: str, size: int) -> None:
        values = getattr(self, name)
        if len(values) != size or not all(0 < value < math.inf for value in values):
            raise ParameterError(name, values, f"{size} finite numbers > 0")


class ImpedanceController(LeafSystem):
    """Makes the tool behave as a mass on springs and dampers anchored at a desired pose, eq. (1).

    .. pydrake_system::

        name: ImpedanceController
        input_ports:
        - encoders
        - desired_pose
        - desired_velocity (optional)
        output_ports:
        - torque
        - tool_pose
        - saturated

    ``T = T_g(q) - J^T [K_p (x - x_d) + K_d (x' - x'_d)] + T_null``, once a period, with the
    controller's own model of the arm. Position and velocity errors are taken in the axes of the
    desired pose D. The orientation error is the rotation vector theta of R_DT, up to pi; the
    moment is the gradient of ``theta^T K theta / 2``, for equal stiffnesses k theta, so that the
    springs store what they take. K_d is the :func:`modal_damping` for the effective inertia
    ``Lambda = (J M^-1 J^T)^-1`` at the rest posture.

    The torque towards the rest posture, and the damping of the elbow's own motion, are projected
    into the null space that is consistent with the mass matrix: they do not accelerate the tool.
    The law needs no inverse of the Jacobian, the projection a regularised one, so that in a
    singular pose the torque is finite and the tool compliant as eq. (1) says. The torque is
    limited at last. An arm with six joints has no null space.

    Of an arm with n joints ``encoders``, shape (2 n,), is q (rad) and velocity;
    ``desired_pose``, shape (7,), quaternion (w, x, y, z), of any length and sign, and position of
    the tool frame, m; ``desired_velocity``, shape (6,), rad/s and m/s in the world's axes, 0 if
    not connected. ``torque``, shape (n,), N m;
    ``tool_pose``, shape (7,), where the model takes the tool to be, the quaternion's sign without
    jumps (w >= 0 at the rest posture); ``saturated``, shape (n,), is the sign of a torque that
    was limited, else 0. All are held over the period; the first ones are those of the start.

    Args:
        model: What the controller knows of the arm.
        posture: Rest posture q, rad, shape (n,).
        params: Parameters.

    Raises:
        ParameterError: At construction if the posture is outside the joints' ranges or too close
            to a singularity, or a mode is unstable at this period; in a run if an input is not
            finite or a quaternion is zero.
    """

    def __init__(
        self,
        model: ArmModel,
        posture: Array,
        params: ImpedanceControllerParams,
    ) -> None:
        super().__init__()
        n = model.arm.num_joints
        self._model = model
        self._params = params
        self._posture = _checked_posture(model.arm, posture)
        self._limits = params.limits(model.arm)
        self._stiffness = np.array([*params.rotational_stiffness, *params.stiffness])
        rest = model.evaluate(self._posture)
        self._design(rest.X_WT.rotation().matrix(), rest.J_V_WT, rest.mass)
        self._ports = [
            self.DeclareVectorInputPort(name, size)
            for name, size in (
                ("encoders", 2 * n),
                ("desired_pose", 7),
                ("desired_velocity", 6),
            )
        ]
        for name, start in (
            ("torque", np.clip(rest.gravity, -self._limits, self._limits)),
            ("tool_pose", pose_vector(rest.X_WT)),
            ("saturated", np.zeros(n)),
        ):
            self.DeclareStateOutputPort(name, self.DeclareDiscreteState(start))
        self.DeclareInitializationDiscreteUpdateEvent(self._tick)
        # A MultibodyPlant with sampled outputs has made its step of the same instant before: no
        # step of delay gets into the loop.
        self.DeclarePeriodicDiscreteUpdateEvent(params.period, 0.0, self._tick)

    @property
    def posture(self) -> Array:
        """Rest posture, rad, shape (n,)."""
        return self._posture.copy()

    @property
    def inertia(self) -> Array:
        """Effective inertia at the rest posture in the tool's axes, angular first, (6, 6)."""
        return self._inertia.copy()

    @property
    def damping(self) -> Array:
        """K_d in the desired pose's axes, angular first, shape (6, 6)."""
        return self._damping.copy()

    @property
    def frequencies(self) -> Array:
        """Natural frequencies of the six modes, rad/s, ascending, shape (6,)."""
        return self._frequencies.copy()

    @property
    def null_damping(self) -> float:
        """Damping of every joint in the null space, N m s/rad; 0 where there is none."""
        return self._null_damping

    def _design(self, R_WT: Array, J_V_WT: Array, mass: Array) -> None:
        """Set damping and regularisation for the rest posture."""
        params = self._params
        J = np.vstack([R_WT.T @ J_V_WT[:3], R_WT.T @ J_V_WT[3:]])  # in the tool's axes
        smallest = float(np.linalg.svd(J, compute_uv=False)[-1])
        if not smallest >= params.smallest_singular_value:
            raise ParameterError(
                "rest posture",
                tuple(self._posture.round(4).tolist()),
                f"joint positions at which the Jacobian's smallest singular value, here "
                f"{smallest:.3g}, is {params.smallest_singular_value:g} or more",
            )
        mobility = J_V_WT @ np.linalg.solve(mass, J_V_WT.T)
        self._regularisation = _REGULARISATION * mobility.diagonal()
        self._inertia = np.linalg.inv(J @ np.linalg.solve(mass, J.T))
        self._damping, self._frequencies = modal_damping(
            np.diag(self._stiffness), self._inertia, params.damping_ratio
        )
        if not params.allow_unstable:
            _require_stable(params, "damping_ratio", float(self._frequencies[-1]))
        self._design_null_space(null_space(J), mass)

    def _design_null_space(self, free: Array, mass: Array) -> None:
        """Set the damping of the joints' own motion, along the columns of ``free``.

        Its slowest mode has the damping ratio that is asked for, all others more.
        """
        params = self._params
        self._null_damping = 0.0
        if not (free.size and params.null_stiffness):
            return
        inertias = np.linalg.eigvalsh(free.T @ mass @ free)
        frequencies = np.sqrt(params.null_stiffness / inertias)
        slowest, inertia = float(frequencies[-1]), float(inertias[-1])
        self._null_damping = 2 * params.null_damping_ratio * slowest * inertia
        if params.allow_unstable:
            return
        for frequency in frequencies.tolist():
            _require_stable(params, "null_damping_ratio", frequency, frequency / slowest)

    def _tick(self, context: Context, values: DiscreteValues) -> None:
        encoders, pose, velocity = self._ports
        rate = velocity.Eval(context) if velocity.HasValue(context) else _STILL
        inputs = (encoders.Eval(context), pose.Eval(context), rate)
        if not all_finite(*inputs):
            for port, value in zip(self._ports, inputs, strict=True):
                if not np.all(np.isfinite(value)):
                    raise ParameterError(port.get_name(), value.tolist(), "finite numbers")
        result = self.step(context.get_discrete_state(1).value(), *inputs)
        n = len(self._posture)
        for i, part in enumerate((result[:n], result[n : n + 7], result[n + 7 :])):
            values.set_value(i, part)

    def step(
        self,
        last_pose: Array,
        encoders: Array,
        desired_pose: Array,
        desired_velocity: Array = _STILL,
    ) -> Array:
        """Return torque, tool pose and saturation, shape (2 n + 7,), that follow from the inputs.

        ``last_pose``, shape (7,), is the tool pose before; it decides the quaternion's sign.
        """
        params = self._params
        tool = self._model.evaluate(encoders[: len(self._posture)])
        result = impedance_torque(
            tool.X_WT.GetAsMatrix34(),
            tool.J_V_WT,
            tool.mass.T,  # symmetric, row by row
            tool.gravity,
            encoders,
            desired_pose,
            desired_velocity,
            last_pose.copy(),  # writable: one signature, compiled once
            self._stiffness,
            self._damping,
            self._posture,
            params.null_stiffness,
            self._null_damping,
            self._regularisation,
            self._limits,
        )
        if not math.isfinite(float(result @ result)):
            if not float(desired_pose[:4] @ desired_pose[:4]) > 0:
                raise ParameterError(
                    "desired_pose", desired_pose.tolist(), "a quaternion that is not zero"
                )
            raise ParameterError("torque", result[: len(self._posture)].tolist(), "finite numbers")
        return result


def _checked_posture(arm: SerialArm, posture: Array) -> Array:
    q: Array = np.array(posture, dtype=np.float64)
    if q.shape != (arm.num_joints,) or not arm.within_limits(q):
        raise ParameterError("rest posture", tuple(q.tolist()), arm.ranges)
    return q


def _require_stable(
    params: ImpedanceControllerParams, name: str, frequency: float, factor: float = 1.0
) -> None:
    """Refuse a named damping ratio, ``factor`` times of which is that of a mode, in rad/s."""
    period = params.period
    low, high = (ratio / factor for ratio in stable_damping_ratios(frequency, period))
    if not low < high:
        raise ParameterError(
            "period", period, f"less than {math.sqrt(2) / frequency:.3g} s for this stiffness"
        )
    value = getattr(params, name)
    if not low < value < high:
        raise ParameterError(
            name,
            value,
            f"more than {low:.3g} and less than {high:.3g} for a mode of {frequency:.0f} rad/s "
            f"and a period of {period:g} s (damping below 2 Lambda/period)",
        )
