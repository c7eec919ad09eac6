"""Quantities that a robot's log determines, each with its 95 % interval."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from matplotlib.figure import Figure

from chamfer.analysis.identify.contact_fit import Touched, fit_contact
from chamfer.analysis.identify.impedance_fit import fit_impedance
from chamfer.analysis.identify.joint_fit import fit_joints
from chamfer.analysis.identify.log import Log, WrenchAxes
from chamfer.analysis.identify.motion import Motion, smooth_motion
from chamfer.analysis.identify.quantity import Quantity
from chamfer.analysis.identify.residual_figures import Residual, draw_residuals
from chamfer.analysis.identify.sensor_fit import Sensed, fit_sensor
from chamfer.analysis.scenario.errors import UserError

_ALIKE = 1.1  # times the smaller misfit: both fit
_ANGLE = "sensor.rotation"
_FALSE = 0.1  # rms of a unit force off the friction cone that puts the offset in doubt

__all__ = ["Identification", "Quantity", "identify"]


@dataclass(frozen=True, kw_only=True)
class Identification:
    """Quantities from a log, and their residuals."""

    quantities: dict[str, Quantity]
    residuals: tuple[Residual, ...]  # of the fits

    def figures(self) -> Mapping[str, Figure]:
        """Return the residuals of the fits as figures."""
        return {"residuals": draw_residuals(self.residuals)} if self.residuals else {}


def identify(log: Log, *, told_stiffness: float | None = None) -> Identification:
    """Return the quantities, or the reason why one is unknown. Nothing is random.

    ``told_stiffness``, N/m, is the impedance's setting, if that is known: it determines the unit
    of the forces.

    Raises:
        UserError: If no rotation of the sensor fits the log, but a mirrored one does.
    """
    quantities: dict[str, Quantity] = {}
    residuals: list[Residual] = []
    if log.force is not None:
        sensed, motion, touched = _sense(log)
        quantities |= sensed.quantities
        residuals.append(Residual("Force without contact", "N", log.time, sensed.residual))
        if motion is not None and touched is not None:
            arm = fit_impedance(motion, touched, sensed, told_stiffness)
            quantities |= {**touched.quantities, **arm.quantities}
            if sensed.quantities["sensor.offset.x"].value is None:
                for name in (_ANGLE, *(f"{_ANGLE}.{axis}" for axis in "xyz"), "friction"):
                    note = f"{quantities[name].note}, the sensor's offset still in".strip(", ")
                    quantities[name] = quantities[name]._replace(note=note)
            for title, unit, scale, values in (
                ("Height over the plane", "mm", 1e3, touched.height),
                ("Force off the friction cone", "N", 1.0, touched.off_cone),
                ("Impedance", "mm", 1e3, arm.residual),
            ):
                if values is not None:
                    residuals.append(Residual(title, unit, motion.time, scale * values))
    joints, left = fit_joints(log)
    if left:
        labels = tuple(f"joint {i}" for i in left)
        torques = np.column_stack(list(left.values()))
        residuals.append(Residual("Torque of the joints", "N m", log.time, torques, labels))
    shown = tuple(r for r in residuals if np.isfinite(r.values).any())
    return Identification(quantities=quantities | joints, residuals=shown)


def _sense(log: Log) -> tuple[Sensed, Motion | None, Touched | None]:
    """Return the result of the forces, in those of the two possible axes that fit better.

    Where the tool hardly turns both fit; then those are the axes that a sensor is turned less in.
    """
    axes: list[WrenchAxes] = ["base"] if log.rotation is None else ["base", "tool"]
    found: list[tuple[Sensed, Motion | None, Touched | None]] = []
    ranks: list[tuple[float, float]] = []  # misfit, angle by which the sensor is turned
    wrong: UserError | None = None
    for one, tared in product([log.wrench_axes] if log.wrench_axes else axes, (True, False)):
        if not tared and (wrong or (ranks and min(ranks)[0] < _FALSE)):
            continue  # the offset from the free part is not in doubt
        read = replace(log, wrench_axes=one)
        sensed = fit_sensor(read, tared=tared)
        motion = smooth_motion(read, sensed.force, sensed.moment)
        try:
            touched = None if motion is None else fit_contact(motion, sensed)
        except UserError as error:
            wrong = wrong or error
            continue
        misfit, angle = np.nan, None
        if touched is not None and motion is not None:
            misfit, angle = touched.misfit, touched.quantities[_ANGLE].value
            if touched.quantities["contacts"].value == 2.0 and motion.reference is not None:
                pull = motion.reference - motion.position  # which the force holds, no cone fits
                sizes = np.linalg.norm(pull) * np.linalg.norm(touched.force)
                misfit += 1 + float(np.sum(pull * touched.force)) / float(sizes)
        if np.isnan(misfit):
            known = sensed.residual[np.isfinite(sensed.residual)]
            misfit = float(np.std(known)) if len(known) else np.inf
        if tared and touched is not None and touched.grounded:
            misfit = np.inf  # the offset is that of a contact
        found.append((sensed, motion, touched))
        ranks.append((misfit if tared else 2 * misfit, angle or 0.0))
    if wrong is not None and not (ranks and min(ranks)[0] < _FALSE):
        raise wrong
    better = [i for i, (misfit, _) in enumerate(ranks) if misfit <= _ALIKE * min(ranks)[0]]
    return found[min(better, key=lambda i: ranks[i][1])]
