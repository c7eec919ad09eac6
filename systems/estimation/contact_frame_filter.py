"""An observer of the normal that follows the contact point's path, with several models at once."""

import math
from functools import lru_cache, partial
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.systems.compiled import compiled, inverse
from chamfer.systems.estimation.contact_frame import (
    CONSIDERED,
    NUMBERS,
    SIZE,
    ContactFrame,
    ContactModel,
    ContactReading,
    GripperModel,
    ahead,
    as_frame,
    begins,
    follow_all,
    mixture,
    repeats,
    sandwich,
    turn_all,
)
from chamfer.systems.estimation.model_error import (
    CALIBRATION,
    GripperCalibration,
)
from chamfer.systems.estimation.normal_filter import (
    Estimate,
    NormalStatus,
    ResolvedSurfaceObserverParams,
    Sample,
    contact_velocity,
    gate,
    rotation_between,
)

Array = NDArray[np.float64]

_LEAST_NOISE: Final = 1e-3  # N and N/s, taken for a sensor said to have none


@lru_cache(maxsize=16)
def gripper_model(
    stiffness: tuple[tuple[float, ...], ...],
    force_noise: float,
    rate_noise: float,
    position: float,
    factor: float,
) -> GripperModel:
    """Return the model of a gripper that is stiffer than set by a factor.

    ``position``, m, is the deviation of its nominal position, which counts for the force alone.
    """
    # A force's component has u / sqrt(3) (4-9).
    force, rate = (max(one, _LEAST_NOISE) / math.sqrt(3) for one in (force_noise, rate_noise))
    K = stiffness[0][0] * np.eye(3)  # in the plane any stiffness out of it would do
    K[: len(stiffness), : len(stiffness)] = stiffness
    K *= factor
    compliance: Array = np.asarray(np.linalg.inv(K), dtype=np.float64)
    spread, most = compliance @ compliance.T, float(np.linalg.norm(compliance, 2))
    return GripperModel(
        stiffness=K,
        compliance=compliance,
        force_deviation=force,
        point_covariance=force**2 * spread,
        point_root=np.linalg.inv(np.linalg.cholesky(force**2 * spread)),
        point_deviation=force * most,
        velocity_covariance=rate**2 * spread,
        velocity_deviation=rate * most,
        pulled_deviation=position * float(np.linalg.norm(K, 2)),
    )


@compiled
def _counted(covariance: Array, variance: float) -> tuple[Array, Array]:
    """Return a point's covariance, m^2, with more on each axis, and its inverse root, 1/m."""
    whole = covariance + variance * np.eye(3)
    root = np.linalg.cholesky(whole).astype(np.float64)
    return whole, inverse(root)  # which needs no pivots either


_MODELS: Final = 3  # their radii are spread evenly, in ratio, between the next two
_SMOOTHEST_RADIUS: Final = 6.0  # m, of the smoothest model; that of the sharpest is rho_min
_SWITCHING: Final = 0.01  # probability that another model holds from a sample to the next
_PATH_RADIUS: Final = 0.1  # m, how sharp the path within the surface turns (in space)
_UNKNOWN_HEADING: Final = 10.0  # rad, standard deviation
_TRAVEL_THRESHOLD: Final = 5.0  # standard deviations of a distance between two points
_SURE_MOTION: Final = 3.0  # u_v, less speed does not tell where a path begins
_FRICTION_ANGLE: Final = 0.5  # rad, initially, and its standard deviation
_LATEST: Final = 4.0  # standard deviations of the delay
_SMOOTHER: Final = 0.02  # probability of a model at first, over that of the next sharper one
_WHOLE: Final = 1e-6  # of a period, less is rounding
_NOTHING: Final = np.zeros((CONSIDERED, CONSIDERED))  # covariance of what is only considered
_ANY_DIRECTION: Final = math.pi / math.sqrt(12)  # rad, deviation of what is anywhere within 90 deg
# Of the model that makes the band, calibrated on bends, waves and switching arcs:
_BAND_BEND: Final = 0.8  # 1/rho_min, standard deviation of the curvature
_BAND_LENGTH: Final = 2.0  # resolving lengths, over which the curvature changes
_BAND: Final = (1.03, 1.5)  # of its deviation, on a flat and where it bends as it may
_TO_BAND: Final = 0.0015  # probability that it holds after another, from a sample to the next
_FROM_BAND: Final = 1.05  # of its deviation, how far the estimate may be from its own
_PULLS: Final = 3  # samples in a row, after which an estimate by which they pull is wrong
_OUTSIDE: Final = 3.0  # standard deviations of a force
_FITTED: Final = 20  # samples, of the mean square of what the model of the band did not foresee
_UNFIT: Final = 4.0  # of it, over the variance
_SURPRISE: Final = 50.0  # the largest square that one sample counts with
_ALONE: Final = np.ones(1)  # weight of a frame that no other competes with
_TINY: Final = 1e-14  # rad^2, keeps a covariance invertible


def resolving_length(
    *, radius: float, speed: float, period: float, point: float, velocity: float
) -> float:
    """Return the shortest length, m, of the path whose bend shows through the noise.

    A surface that begins to bend with the radius has turned by ``l / radius`` after the length l.
    By then the samples, one each ``speed * period``, tell the path's direction by the mean of
    their velocities to ``velocity / speed * sqrt(speed * period / l)``, and by a straight line
    through their points to ``point / l * sqrt(12 * speed * period / l)``. Where the one or the
    other is as large as the turn, the bend shows.

    Args:
        radius: m, of the bend.
        speed: m/s, of the contact point.
        period: s, between two samples.
        point: m, standard deviation of a component of the contact point.
        velocity: m/s, of a component of its velocity, infinite if it is not measured.
    """
    if not speed > 0.0:
        return radius
    by_velocity = (velocity**2 * period * radius**2 / speed) ** (1 / 3)
    by_point = (12.0 * point**2 * speed * period * radius**2) ** (1 / 5)
    return float(min(by_velocity, by_point))


@compiled
def _limited(normal: Array, sure: Array, apart: Array, covariance: Array) -> tuple[Array, Array]:
    """Return a normal, limited to near a more certain one, and that one's covariance.

    Args:
        normal: Shape (3,), unit.
        sure: The surer one, shape (3,), unit.
        apart: Its covariance by which the other may be off, shape (3, 3), rad^2.
        covariance: Its covariance that is returned, turned along, shape (3, 3), rad^2.
    """
    cosine = normal @ sure
    across = normal - cosine * sure
    length = math.sqrt(across @ across)
    if not length > 0.0:
        return sure, covariance
    across /= length
    whole = inverse(apart + np.outer(sure, sure) + _TINY * np.eye(3))
    most = _FROM_BAND / math.sqrt(across @ (whole @ across))
    angle = min(math.atan2(length, cosine), most, 0.5 * math.pi)
    found = math.cos(angle) * sure + math.sin(angle) * across
    both = sure + found
    turn = np.eye(3) - np.outer(both, both) / (1.0 + sure @ found) + 2.0 * np.outer(found, sure)
    return found, sandwich(turn, covariance)


class _Memory(NamedTuple):
    """Views of the filter's memory for its next sample."""

    frames: Array  # (models, 156)
    weights: Array  # (models,)
    predicted: Array  # (3,), the last predicted normal, zeros before the first
    placed: Array  # (1,), 1 if the contact point is known, else 0
    calibration: Array  # (23,)
    history: Array  # (rows, 6), m and m/s, nominal motion, the newest first
    lagging: Array  # (3,), m/s, v_nom, that lags as the force's rate does
    fit: Array  # (2,), mean square of what was not foreseen over its variance; samples of pull
    started: Array  # (1,), 1 after the first sample


class ContactFrameFilter:
    """A multiple-model extended Kalman filter for the Darboux frame of the contact point's path.

    By (4-2) the force shows where the contact point is, ``x = x_nom + K^-1 F``, and the surface's
    normal is at right angles to its path. The thesis uses the derivative of this alone (4-3). The
    path needs neither the force's derivative nor anything about friction, and a constant error of
    the force sensor does not matter to it; in space it matters sideways, see below. So a rate that
    comes from differences of the force only shows whether the contact point moves, and it lags.

    Several models run side by side (:mod:`chamfer.systems.estimation.contact_frame`) that
    take the surface to be as sharp as the bound allows, or smoother, though never flat: a
    curvature too small to be noticed must be covered by P. Their weights follow from their
    innovations, and the estimate is their mixture.

    None of them lets the curvature change within less than the bound's radius, as it may: where a
    bend begins all lag behind it. So the last model takes the curvature to change over what the
    sensor can just resolve (:func:`resolving_length`). The band is that model's, wider where the
    surface bends already, as it may then bend back by more, and the mixture is kept within it,
    near to that model's normal. Nothing predicts where a bend begins: a flat has that band too.

    In space the path shows only the normal's tilt along the path. The force shows the tilt
    sideways: friction opposes the motion, the force has no component across the path and the
    normal.

    The settings of gripper and sensor may be wrong
    (:class:`chamfer.systems.estimation.model_error.ModelErrorParams`). A wrong stiffness tilts the
    path, since ``v = v_nom + K^-1 Fdot`` and v_nom is known; a bias tilts the force. Along one
    path neither can be distinguished from another surface, so both are measured before
    (:class:`chamfer.systems.estimation.model_error.GripperCalibration`). The remaining errors
    widen the band by their effect on the estimate, which does not change. A late force is assigned
    to the gripper's earlier place, and the normal is predicted from there to the present one.

    The thesis' gate applies, but a contact point that moves slowly counts as moving once it has
    come five standard deviations, and where a path begins in another direction either this or
    more speed is needed: noise that passes the gate has any direction, and in space a wrong one
    tilts the normal. Once contact was lost, the frame starts again where it returns,
    with the last normal and what the surface may have turned since.
    """

    def __init__(self, params: ResolvedSurfaceObserverParams, *, banded: bool = True) -> None:
        """Make the filter; ``banded=False`` keeps the plain mixture, with its own band."""
        self._params = params
        self._gripper = partial(
            gripper_model,
            params.stiffness,
            params.force_noise,
            params.force_rate_noise,
            params.model_error.position,
        )
        # A velocity is that of a position, sample by sample.
        self._jitter = params.model_error.position / params.period
        self._velocity_noise = math.hypot(params.velocity_noise, math.sqrt(3) * self._jitter)
        self._d = len(params.stiffness)
        planar, self._adaptive = self._d == 2, params.kind == "adaptive"
        sharpest = params.smallest_radius
        radii = np.array([sharpest])
        if self._adaptive and sharpest < _SMOOTHEST_RADIUS:
            radii = np.geomspace(sharpest, _SMOOTHEST_RADIUS, _MODELS)
        bends = 1 / (math.sqrt(3) * radii)  # a third of the bound's square
        self._sharpest = float(bends[0])
        self._banded = banded and self._adaptive
        if self._banded:
            bends = np.append(bends, _BAND_BEND / sharpest)
        self._count = count = len(bends)
        switch = np.full((count, count), _SWITCHING / max(count - 1, 1))
        if self._banded:
            switch[:, -1] = _TO_BAND
        np.fill_diagonal(switch, 0.0)
        np.fill_diagonal(switch, 1 - switch.sum(axis=1))
        path = 0.0 if planar else 1 / (math.sqrt(3) * _PATH_RADIUS)
        self._model = ContactModel(
            turn=np.array([[0 if planar else one, one, path, sharpest] for one in bends.tolist()]),
            switch=switch,
            by_point=self._adaptive,
            # The derivative of a position that is off shows nothing beside it.
            differenced=bool(params.rate_lag or params.model_error.position),
            by_friction=params.kind == "friction",
            period=params.period,
            friction=params.model_error.friction,
        )
        error, told = params.model_error, self._gripper(1.0)
        self._considers = bool(error.stiffness or error.bias)
        # As many as the latest force needs.
        latest = error.delay + _LATEST * error.delay_deviation
        self._rows = 1 + math.ceil(latest / params.period - _WHOLE) if latest else 0
        lengths = (NUMBERS * count, count, 3, 1, CALIBRATION, 6 * self._rows, 3)
        self._ends = np.cumsum(lengths).tolist()
        force, compliance = told.force_deviation, told.compliance
        self._calibration = GripperCalibration(
            error, force=force, compliance=compliance, period=params.period
        )

    def start(self, normal: Array, deviation: float | None = None) -> Array:
        """Return the memory before the first sample, from an initial unit normal.

        ``deviation``, rad, is the normal's on each axis, the parameters' if it is None.
        """
        if deviation is None:
            deviation = self._params.initial_deviation
        n = _pad(normal)
        if self._d == 2:
            t = np.array([n[1], -n[0], 0.0])
        else:
            t = np.cross(n, np.eye(3)[np.argmin(np.abs(n))])
            t /= np.linalg.norm(t)
        frames = []
        for turn in self._model.turn[:, :3]:
            P = np.zeros((SIZE, SIZE))
            P[4, 4] = deviation**2
            if self._d == 3:
                P[3, 3], P[5, 5] = P[4, 4], _UNKNOWN_HEADING**2
            np.fill_diagonal(P[6:9, 6:9], turn**2)
            P[9, 9] = _FRICTION_ANGLE**2
            R = np.column_stack([t, np.cross(n, t), n])
            frames += [np.zeros(3), R.ravel(), np.zeros(3), [_FRICTION_ANGLE], P.ravel()]
            frames.append(np.zeros(SIZE * CONSIDERED))
        # A surface is taken to be sharp until it has shown that it is smooth.
        weights = _SMOOTHER ** np.arange(self._count)
        weights /= weights.sum()
        return np.concatenate([*frames, weights, np.zeros(10 + CALIBRATION + 6 * self._rows)])

    def _views(self, memory: Array) -> _Memory:
        a, b, c, d, e, f, g = self._ends  # np.split takes longer than all the rest
        return _Memory(
            memory[:a].reshape(self._count, NUMBERS),
            memory[a:b],
            memory[b:c],
            memory[c:d],
            memory[d:e],
            memory[e:f].reshape(self._rows, 6),
            memory[f:g],
            memory[g:-1],
            memory[-1:],
        )

    def update(self, memory: Array, sample: Sample) -> Estimate:
        """Return the estimate after a sample."""
        memory = memory.copy()
        kept = self._views(memory)
        frames, weights, placed = kept.frames, kept.weights, kept.placed
        if sample.predicted_normal is not None:
            predicted = _pad(sample.predicted_normal)
            if kept.predicted.any():  # w is what the prediction leaves over
                turn_all(frames, rotation_between(kept.predicted, predicted))
            kept.predicted[:] = predicted
        sample = self._in_time(kept, Sample(*map(_pad, sample[:4])))
        moving = sample.nominal_velocity
        lagging = self._lagging(kept, moving)
        kept.started[0] = 1.0
        known, factor = self._calibration, 1.0
        if self._considers:
            if known.take(kept.calibration, sample.force, sample.nominal_position, moving):
                touched = known.touched(kept.calibration)
                return self._estimate(
                    memory, kept, NormalStatus.STUCK if touched else NormalStatus.NO_CONTACT
                )
            sample = sample._replace(force=sample.force - known.bias(kept.calibration))
            factor = known.factor(kept.calibration)
        gripper = self._gripper(factor)
        velocity = contact_velocity(sample._replace(nominal_velocity=lagging), gripper.compliance)
        status = gate(self._params, sample, velocity, self._velocity_noise / factor)
        touches = self._adaptive and status is not NormalStatus.NO_CONTACT
        if touches and self._pulled(kept, sample.force, gripper.force_deviation):
            return self._estimate(memory, kept, NormalStatus.PULLED)
        point = sample.nominal_position + gripper.compliance @ sample.force
        if status is NormalStatus.NO_CONTACT:
            # A free gripper is where it is meant to be: its velocity is known.
            self._lose(frames, math.sqrt(moving @ moving) * self._params.period)
            placed[0] = 0.0
        elif status is not NormalStatus.HALTED and not placed[0]:
            self._place(frames, point, sample.nominal_position, gripper)
            placed[0] = 1.0
        step = self._params.period * velocity
        error = self._params.period * math.hypot(gripper.velocity_deviation, self._jitter)
        doubtful = self._is_doubtful(frames, weights, step, error, status)
        if self._adaptive and doubtful:
            step = point - weights @ frames[:, :3]
            apart = self._params.model_error.position
            error = math.sqrt(2) * math.hypot(gripper.point_deviation, apart)
            far = float(step @ step) > (_TRAVEL_THRESHOLD * error) ** 2
            status = NormalStatus.MEASURED if far else NormalStatus.STUCK
        if status is not NormalStatus.MEASURED:
            return self._estimate(memory, kept, status)
        nominal, force = sample.nominal_position, sample.force
        reading = ContactReading(point, velocity, force, nominal, moving, gripper)
        deviation = error / math.sqrt(step @ step)
        off = self._params.model_error
        if off.position:
            often = repeats(math.sqrt(step @ step), off.position_length)
            variance = often * off.position**2
            whole, root = _counted(gripper.point_covariance, variance)
            most = math.hypot(gripper.point_deviation, math.sqrt(variance))
            gripper = gripper._replace(
                point_covariance=whole, point_root=root, point_deviation=most
            )
            reading = reading._replace(gripper=gripper)
        model = self._at_speed(math.sqrt(moving @ moving), gripper)
        surprise = follow_all(frames, weights, model, reading, step, deviation)
        kept.fit[0] += (min(surprise, _SURPRISE) - kept.fit[0]) / _FITTED
        if kept.fit[0] > _UNFIT:
            status = NormalStatus.UNFIT
        return self._estimate(memory, kept, status, model, math.sqrt(velocity @ velocity))

    def _at_speed(self, speed: float, gripper: GripperModel) -> ContactModel:
        """Return the assumptions at a speed, m/s."""
        if not self._banded:
            return self._model
        turn = self._model.turn.copy()
        turn[-1, 3] = _BAND_LENGTH * resolving_length(
            radius=self._params.smallest_radius,
            speed=speed,
            period=self._params.period,
            point=gripper.point_deviation,
            velocity=math.inf if self._model.differenced else gripper.velocity_deviation,
        )
        return self._model._replace(turn=turn)

    def _estimate(
        self,
        memory: Array,
        kept: _Memory,
        status: NormalStatus,
        model: ContactModel | None = None,
        speed: float = 0.0,
    ) -> Estimate:
        frames = kept.frames
        if model is not None and speed and self._rows:
            late, deviation = self._calibration.delay(kept.calibration)
            frames = ahead(frames, model, speed, late, deviation)
        considered = _NOTHING
        if self._considers:
            considered = self._calibration.covariance(kept.calibration)
        normal, covariance = mixture(frames, kept.weights, considered)
        if self._banded:
            sure, apart = mixture(frames[-1:], _ALONE, _NOTHING)
            whole = mixture(frames[-1:], _ALONE, considered)[1] if self._considers else apart
            least, most = _BAND
            bend = kept.weights @ frames[:, 12:14] * self._params.smallest_radius
            factor = least + (most - least) * min(math.sqrt(bend @ bend), 1.0)
            normal, covariance = _limited(normal, sure, apart, factor**2 * whole)
        if kept.fit[0] > _UNFIT:
            covariance = kept.fit[0] * covariance
        d = self._d
        return Estimate(memory, normal[:d], covariance[:d, :d].copy(), status)

    def _pulled(self, kept: _Memory, force: Array, deviation: float) -> bool:
        """Restart along the force, if the surface repeatedly seems to pull."""
        n = kept.weights @ kept.frames[:, 5:12:3]
        if n @ force > -_OUTSIDE * deviation:
            kept.fit[1] = 0.0
            return False
        kept.fit[1] += 1.0
        if kept.fit[1] < _PULLS:
            return False
        kept.fit[1] = 0.0
        anew = self._views(self.start(force / math.sqrt(force @ force), _ANY_DIRECTION))
        kept.frames[:], kept.weights[:] = anew.frames, anew.weights
        kept.placed[0] = 0.0
        return True

    def _in_time(self, kept: _Memory, sample: Sample) -> Sample:
        """Return a sample with the nominal motion of the force's time."""
        history = kept.history
        if not self._rows:
            return sample
        now = np.concatenate([sample.nominal_position, sample.nominal_velocity])
        history[1:] = history[:-1].copy() if kept.started[0] else now
        history[0] = now
        late = self._calibration.delay(kept.calibration)[0] / self._params.period
        whole = min(max(math.floor(late + _WHOLE), 0), self._rows - 1)
        part = max(late - whole, 0.0) if whole + 1 < self._rows else 0.0
        motion = history[whole]
        if part:
            motion = (1 - part) * motion + part * history[whole + 1]
        x, v = motion[:3].copy(), motion[3:].copy()
        return sample._replace(nominal_position=x, nominal_velocity=v)

    def _lagging(self, kept: _Memory, moving: Array) -> Array:
        """Return the nominal velocity, m/s, that lags as much as the force's rate."""
        lag = self._params.rate_lag
        if not lag:
            return moving
        share = 1 - math.exp(-self._params.period / lag) if kept.started[0] else 1.0
        kept.lagging[:] += share * (moving - kept.lagging)
        return kept.lagging.copy()

    def _is_doubtful(
        self, frames: Array, weights: Array, step: Array, error: float, status: NormalStatus
    ) -> bool:
        """Return whether the velocity alone does not show that the contact point moves."""
        if status is not NormalStatus.MEASURED:
            return status is NormalStatus.STUCK
        length = math.sqrt(step @ step)
        # The noise's length u_v has three axes of the step's deviation.
        if length > _SURE_MOTION * math.sqrt(3) * error:
            return False
        likeliest = as_frame(frames[np.argmax(weights)])
        return begins(likeliest, step, error / length)

    def _place(self, frames: Array, point: Array, nominal: Array, gripper: GripperModel) -> None:
        """Put the frames where contact is made, on a path that is not known yet."""
        for numbers, turn in zip(frames, self._model.turn[:, :3], strict=True):
            frame: ContactFrame = as_frame(numbers)
            frame.p[:] = point
            frame.w[:] = 0.0
            P, S = frame.P, frame.S
            S[0:3, 0] = frame.R.T @ (point - nominal)
            S[0:3, 1:4] = -frame.R.T @ gripper.compliance
            S[6:9] = 0.0
            P[0:3], P[:, 0:3], P[6:9], P[:, 6:9] = 0.0, 0.0, 0.0, 0.0
            P[0:3, 0:3] = frame.R.T @ gripper.point_covariance @ frame.R
            np.fill_diagonal(P[6:9, 6:9], turn**2)
            if self._d == 2:
                P[1, :], P[:, 1] = 0.0, 0.0
            else:
                P[5, :], P[:, 5] = 0.0, 0.0
                P[5, 5] = _UNKNOWN_HEADING**2

    def _lose(self, frames: Array, distance: float) -> None:
        """Let the normal become as uncertain as the distance may have turned it."""
        for numbers in frames:
            P = as_frame(numbers).P
            for i in (4,) if self._d == 2 else (3, 4):
                deviation = math.sqrt(max(P[i, i], 0.0)) + self._sharpest * distance
                deviation = min(deviation, max(_ANY_DIRECTION, math.sqrt(max(P[i, i], 0.0))))
                P[i, :], P[:, i] = 0.0, 0.0
                P[i, i] = deviation**2


def _pad(vector: Array) -> Array:
    """Return a vector of the plane or of space in space."""
    if len(vector) == 3:
        return vector
    padded = np.zeros(3)
    padded[:2] = vector
    return padded
