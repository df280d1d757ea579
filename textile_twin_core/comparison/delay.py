"""Delay, gain and offset of the torque sensor, fitted to measured and predicted torque."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray
from textile_twin_core.comparison.alignment import TWO_PI, Track, parts
from textile_twin_core.inference.robust import huber_weights

GUARD_S = 0.0005
"""Samples this close [s] to a discontinuity of the load are left out: their stamps do not show its side."""
_COARSE_SAMPLES = 5000
_COARSE_STEPS = 100  # on either side of the configured delay
_MORE_LIKELY = 1.05  # factor by which a reversed torque must correlate better than one that is not


@dataclass(frozen=True, slots=True)
class SensorFit:
    """Fitted torque sensor: `measured(t) = gain * true(t - delay) + offset`.

    Attributes:
        delay_s: the estimated delay; the configured one where `identifiable` is false.
        delay_sigma_s: its standard deviation; residuals of one turn of the shaft may be correlated.
        gain: estimated gain, negative where the torque's sign is reversed. offset_Nm: estimated offset.
        identifiable: true if the torque follows the prediction well enough to determine a delay.
        at_limit: true if the best delay lies on the edge of the searched range.
        sought: false without enough data for a fit: then gain and offset are the configured ones, too.
    """

    delay_s: float
    delay_sigma_s: float
    gain: float
    offset_Nm: float
    identifiable: bool
    at_limit: bool
    sought: bool = True


def usable(track: Track, time_s: FloatArray) -> tuple[BoolArray, FloatArray, FloatArray]:
    """Return true for the times (m,) that can be interpolated, and torque and slope there."""
    piece, inside = track.piece(time_s)
    good = inside & ~track.blocked[piece] & ~track.near_step(time_s, GUARD_S)
    torque, slope = track.torque_at(time_s, piece)
    return good, torque, slope


def fit_sensor(
    track: Track,
    time_s: FloatArray,
    measured_Nm: FloatArray,
    configured_s: float,
    search_s: float,
) -> SensorFit:
    """Estimate delay, gain and offset from measured samples (m,) at `time_s`.

    First the delay of the highest correlation, of either sign, on a grid of `search_s` around the configured delay,
    then Gauss-Newton in (delay, gain, offset) with Huber weights, which resolves a small fraction of a sample.
    Samples at a discontinuity of the load are left out: there the dynamics of the sensor matter more than its delay.
    """
    thin = np.linspace(0, time_s.size - 1, min(time_s.size, _COARSE_SAMPLES)).astype(np.int64)
    grid = configured_s + np.linspace(-search_s, search_s, 2 * _COARSE_STEPS + 1)
    likeness = np.array([_correlation(track, time_s[thin] - d, measured_Nm[thin]) for d in grid])
    if -likeness.min() > _MORE_LIKELY * likeness.max():
        likeness = -likeness
    best = int(np.argmax(likeness))
    at_limit = best in (0, grid.size - 1)
    if not likeness[best] > 0.3 or at_limit:
        good, torque, _ = usable(track, time_s - configured_s)
        gain, offset = line(torque[good], measured_Nm[good])
        return SensorFit(configured_s, float("nan"), gain, offset, False, at_limit)
    delay, gain, offset, sigma = float(grid[best]), 1.0, 0.0, float("nan")
    span = float(grid[1] - grid[0])
    for _ in range(30):
        good, torque, slope = usable(track, time_s - delay)
        if not good.any():
            return SensorFit(configured_s, float("nan"), float("nan"), 0.0, False, False)
        torque, slope, seen = torque[good], slope[good], measured_Nm[good]
        if sigma != sigma:  # the first pass
            gain, offset = line(torque, seen)
        error = seen - gain * torque - offset
        scale = 1.4826 * float(np.median(np.abs(error))) + 1e-12 * float(np.max(np.abs(seen)))
        theta = track.theta_at(time_s - delay, track.piece(time_s - delay)[0])[good]
        move, sigma = _gauss_newton(np.stack([-gain * slope, torque, np.ones_like(torque)]), error, scale, theta)
        shift = float(np.clip(move[0], -span, span))
        delay, gain, offset = delay + shift, gain + float(move[1]), offset + float(move[2])
        if abs(shift) < 1e-10:
            break
    return SensorFit(delay, sigma, gain, offset, True, abs(delay - configured_s) > search_s)


def _gauss_newton(
    columns: FloatArray, error: FloatArray, scale: float, theta_rad: FloatArray
) -> tuple[FloatArray, float]:
    """Move of the unknowns for their slopes (3, m) and errors (m,), and the first one's standard deviation.

    The deviation is the larger of two: with residuals correlated within a turn, or all independent.
    """
    normal, sides = np.zeros((3, 3)), np.zeros(3)
    for part in parts(error.size):
        weight = huber_weights(error[part], scale)
        error[part] *= weight
        normal += (columns[:, part] * weight) @ columns[:, part].T
        sides += columns[:, part] @ error[part]
    first = np.linalg.pinv(normal)[0]
    turn = np.floor(theta_rad / TWO_PI).astype(np.int64)
    turn -= turn.min()
    scores, count, alone = np.zeros(turn.max() + 1), np.zeros(turn.max() + 1), 0.0
    for part in parts(error.size):
        weights = (first @ columns[:, part]) * error[part]
        scores += np.bincount(turn[part], weights=weights, minlength=scores.size)
        count += np.bincount(turn[part], minlength=scores.size)
        alone += float(weights @ weights)
    turns = int(np.count_nonzero(count))
    few = turns / max(turns - 1, 1)
    move = np.asarray(np.linalg.lstsq(normal, sides, rcond=None)[0], np.float64)
    return move, float(np.sqrt(max(few * float(scores @ scores), alone)))


def _correlation(track: Track, time_s: FloatArray, measured_Nm: FloatArray) -> float:
    good, torque, _ = usable(track, time_s)
    if np.count_nonzero(good) < 8:
        return -1.0
    a, b = torque[good], measured_Nm[good]
    a, b = a - a.mean(), b - b.mean()
    size = float(np.sqrt((a @ a) * (b @ b)))
    # Rounding errors of a constant torque must not pass for a correlation.
    if size <= 1e-12 * float(np.max(np.abs(torque[good])) ** 2 + np.max(np.abs(measured_Nm)) ** 2) * a.size:
        return 0.0
    return float(a @ b) / size


def line(torque_Nm: FloatArray, measured_Nm: FloatArray) -> tuple[float, float]:
    """Least-squares gain and offset of measured over predicted torque; nan gain for constant torque."""
    centred = torque_Nm - torque_Nm.mean()
    power = float(centred @ centred)
    if power <= 1e-24 * float(np.max(np.abs(torque_Nm), initial=0.0)) ** 2 * torque_Nm.size or power == 0.0:
        return float("nan"), float(np.mean(measured_Nm - torque_Nm))
    gain = float(centred @ measured_Nm) / power
    return gain, float(measured_Nm.mean() - gain * torque_Nm.mean())
