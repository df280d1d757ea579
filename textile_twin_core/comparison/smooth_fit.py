"""Fit of a torque model's smooth parameters: bounded least squares, then instrumental variables."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
import scipy

from textile_twin_core.arrays import BoolArray, FloatArray
from textile_twin_core.comparison.shaft_track import ShaftTrack
from textile_twin_core.comparison.slow_motion import slow_motion
from textile_twin_core.comparison.torque_model import NOT_NEGATIVE, TorqueModel
from textile_twin_core.inference.robust import HUBER, huber_weights, robust_scale

_MOST_LOSS = 2.0
"""Standard deviations over those of least squares; above it, least squares would use errors of the track."""
SLOW_ORDERS = (3.0, 5.0, 8.0)
"""Orders of the turn that limit the slow part of the motion."""
SLOW_ORDERS_OF_ROTOR = (0.3, 0.5, 0.8)
"""The same if the torque does not depend on the angle: a torque that repeats with it is foreign to the machine."""
_ROUNDS, _STILL, _RUN_AWAY = 8, 1e-4, 2.0


@dataclass(frozen=True)
class SmoothFit:
    """Fitted values by name, and the basis of their uncertainty, (m, k) and (m,) over the samples `good` of a model.

    slopes: of the expected torque by the parameters. instruments: orthogonal to the residual.
    """

    values: dict[str, float]
    slopes: FloatArray
    instruments: FloatArray
    residual: FloatArray
    good: BoolArray


def least_squares_fit(
    model: TorqueModel, values: dict[str, float], free: tuple[str, ...], chosen: BoolArray, most_steps: int
) -> dict[str, float]:
    """Bounded least squares with Huber's loss in the free parameters, each scaled by its effect."""
    good = model.parts(values).good & chosen
    torque = model.evidence.torque_Nm[good]
    slopes = model.jacobian(values, free)[good]
    size = np.sqrt(np.mean(slopes**2, axis=0)) + 1e-300
    scale = robust_scale(torque - model.expected(values)[good])

    def at(x: FloatArray) -> dict[str, float]:
        return values | dict(zip(free, (x / size).tolist(), strict=True))

    def residual(x: FloatArray) -> FloatArray:
        return np.asarray(np.nan_to_num((model.expected(at(x))[good] - torque) / scale))

    def jacobian(x: FloatArray) -> FloatArray:
        return np.asarray(np.nan_to_num(model.jacobian(at(x), free)[good] / (size * scale)))

    low = np.array([0.0 if name in NOT_NEGATIVE else -np.inf for name in free])
    start = np.array([values[name] for name in free]) * size
    for _ in range(2):  # the second time with the scale of the residual
        start = np.maximum(start, low + 1e-12)
        solved = scipy.optimize.least_squares(
            residual, start, jacobian, (low, np.inf), loss="huber", f_scale=HUBER, max_nfev=most_steps
        )
        start = solved.x
        scale = robust_scale(torque - model.expected(at(start))[good])
    return at(start)


def clean_tracks(
    model: TorqueModel,
    steady: ShaftTrack | None,
    values: dict[str, float],
    free: tuple[str, ...],
    orders: tuple[float, ...] = SLOW_ORDERS,
) -> tuple[ShaftTrack, ...]:
    """Return tracks without the errors of the model's track, for instruments: the best first, then equally good ones.

    The best is `steady`, the motion that repeats, if it is given and its instruments cost little over least squares.
    Otherwise it is the slow part of the motion, with several limits. If that determines nothing either, it is
    the model's own track, which means least squares.
    """
    evidence = model.evidence
    if steady is not None and _loss(_on(model, steady, values, free)) <= _MOST_LOSS:
        return (steady,)
    slow = tuple(slow_motion(evidence.track, order, evidence.slow_rad_s) for order in orders)
    return slow if np.isfinite(_loss(_on(model, slow[0], values, free))) else (evidence.track,)


def instrumented_fit(
    model: TorqueModel, clean: ShaftTrack, values: dict[str, float], free: tuple[str, ...], chosen: BoolArray
) -> SmoothFit:
    """Fit by instrumental variables, starting from least squares: residual orthogonal to the slopes on `clean`.

    Errors of the shaft's acceleration are in the slopes as well as in the residual, which biases least squares; the
    slopes taken on `clean` are free of them (Soederstroem and Stoica 1983; with Huber's weights). The root close
    to least squares is wanted: if the steps diverge from it, the values of least squares are returned.
    """
    other = model.with_evidence(dataclasses.replace(model.evidence, track=clean))
    good = model.parts(values).good & other.parts(values).good & chosen
    start = fit = _state(model, other, values, free, good)
    for _ in range(_ROUNDS):
        step, normal = _step(fit, free)
        values = values | {name: values[name] + float(step[k]) for k, name in enumerate(free)}
        fit = _state(model, other, values, free, good)
        if float(np.max(np.abs(step) * normal, initial=0.0)) < _STILL * robust_scale(fit.residual):
            break
    return fit if np.std(fit.residual) < _RUN_AWAY * np.std(start.residual) else start


def _on(model: TorqueModel, clean: ShaftTrack, values: dict[str, float], free: tuple[str, ...]) -> SmoothFit:
    """Return the fit at these values, with instruments on another track."""
    other = model.with_evidence(dataclasses.replace(model.evidence, track=clean))
    return _state(model, other, values, free, model.parts(values).good & other.parts(values).good)


def _state(
    model: TorqueModel, other: TorqueModel, values: dict[str, float], free: tuple[str, ...], good: BoolArray
) -> SmoothFit:
    slopes, instruments = (each.jacobian(values, free)[good] for each in (model, other))
    residual = (model.evidence.torque_Nm - model.expected(values))[good]
    return SmoothFit(values, slopes, instruments, residual, good)


def _step(fit: SmoothFit, free: tuple[str, ...]) -> tuple[FloatArray, FloatArray]:
    """Return the next step, and the change of the torque per unit of each parameter.

    Parameters that would become negative stop at zero, and the others are solved without them.
    """
    size = np.sqrt(np.mean(fit.slopes**2, axis=0)) + 1e-300
    weighted = fit.instruments / size * huber_weights(fit.residual, robust_scale(fit.residual))[:, None]
    normal, right = weighted.T @ (fit.slopes / size), weighted.T @ fit.residual
    now = np.array([fit.values[name] for name in free])
    bounded = np.array([name in NOT_NEGATIVE for name in free], dtype=np.bool_)
    step, stopped = np.zeros(len(free)), np.zeros(len(free), dtype=np.bool_)
    for _ in range(np.count_nonzero(bounded) + 1):
        step[stopped] = -now[stopped]
        moving = ~stopped
        sides = right[moving] - normal[np.ix_(moving, stopped)] @ (step[stopped] * size[stopped])
        step[moving] = np.linalg.lstsq(normal[np.ix_(moving, moving)], sides, rcond=1e-12)[0] / size[moving]
        below = moving & bounded & (now + step < 0.0)
        if not below.any():
            break
        stopped |= below
    return step, size


def _loss(fit: SmoothFit) -> float:
    """Largest factor by which instruments widen a standard deviation."""
    size = np.sqrt(np.mean(fit.slopes**2, axis=0)) + 1e-300
    slopes, instruments = fit.slopes / size, fit.instruments / size
    if np.linalg.matrix_rank(instruments) < instruments.shape[1]:
        return np.inf
    best = np.diag(np.linalg.pinv(slopes.T @ slopes, rcond=1e-13, hermitian=True))
    gain = np.linalg.pinv(instruments.T @ slopes, rcond=1e-13)
    reached = np.einsum("ij,jk,ik->i", gain, instruments.T @ instruments, gain)
    return float(np.sqrt(np.max(reached / best, initial=1.0)))
