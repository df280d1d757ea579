"""Motion of an elastic shaft when one of its stations follows a given motion."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from textile_twin_core.arrays import FloatArray
from textile_twin_core.driveline.chain import ElasticShaft
from textile_twin_core.driveline.runs import Outputs, follow, outputs, twist_statically
from textile_twin_core.driveline.step import ChainState, chain_state
from textile_twin_core.errors import MotionError

_MOST_SUBSTEPS = 4096
_ELASTIC_TOLERANCE = 1e-3


@dataclass(frozen=True)
class ChainMotion:
    """Motion of every station and torque of every piece at the samples.

    theta_rad, omega_rad_s, alpha_rad_s2: (samples, stations), each station's own, behind its gears. piece_torque_Nm and
    twist_rad: (samples, pieces), on the far side of a piece's gear; a torque is positive as it drives the far station.
    drive_torque_Nm: (samples,) what the station that follows the given motion needs, or what the drive gave, reduced to
    the main shaft. reached_error: largest difference of a piece torque from the same with half the substeps, over the
    largest torque; NaN where the number of substeps was given.
    """

    stations: tuple[str, ...]
    time_s: FloatArray
    theta_rad: FloatArray
    omega_rad_s: FloatArray
    alpha_rad_s2: FloatArray
    piece_torque_Nm: FloatArray
    twist_rad: FloatArray
    drive_torque_Nm: FloatArray
    substeps: int
    reached_error: float = math.nan

    def number(self, station: str) -> int:
        """Number of a station by its name. Raises MotionError for an unknown one."""
        if station not in self.stations:
            raise MotionError(f"there is no station '{station}'; stations: {', '.join(self.stations)}")
        return self.stations.index(station)

    def torque_between(self, near: str, far: str) -> FloatArray:
        """(samples,) torque in the piece between two neighbouring stations [N m], positive as it drives `far`."""
        a, b = self.number(near), self.number(far)
        if abs(a - b) != 1:
            raise MotionError(f"'{near}' and '{far}' are not the two ends of one piece")
        return (b - a) * self.piece_torque_Nm[:, min(a, b)]


def follow_motion(
    elastic: ElasticShaft,
    time: npt.ArrayLike,
    theta: npt.ArrayLike,
    omega: npt.ArrayLike,
    alpha: npt.ArrayLike,
    *,
    station: str | None = None,
    torque: npt.ArrayLike | None = None,
    substeps: int | None = None,
    tolerance: float = _ELASTIC_TOLERANCE,
    settled: bool = True,
) -> ChainMotion:
    """Compute the motion of the chain while one station follows a given motion.

    Args:
        elastic: The shaft, from `elastic_shaft`.
        time: (samples,) rising times [s].
        theta, omega, alpha: (samples,) motion of the station, reduced to the main shaft [rad, rad/s, rad/s^2]; a
            polynomial of degree five joins the samples.
        station: Name of the station; by default that of the encoder.
        torque: (samples, stations) further torques on the stations, reduced to the main shaft [N m].
        substeps: Steps between two samples. By default they are doubled, the last two runs extrapolated (Richardson
            1911), until the largest change of a piece torque is within `tolerance` of the largest torque.
        tolerance: See `substeps`.
        settled: Begin with the twist of uniform rotation; False begins without any twist.

    Returns:
        The motion at the samples.

    Raises:
        MotionError: For samples that do not fit together, or a tolerance that 4096 substeps do not reach.
    """
    columns = [np.ascontiguousarray(each, dtype=np.float64) for each in (time, theta, omega, alpha)]
    times = columns[0]
    if times.ndim != 1 or times.size < 2 or any(each.shape != times.shape for each in columns):
        raise MotionError("time, theta, omega and alpha must be arrays of one length, two samples or more")
    if not (np.diff(times) > 0.0).all() or not all(np.isfinite(each).all() for each in columns):
        raise MotionError("times must rise, and all samples must be finite")
    names = elastic.shaft.names
    number = elastic.shaft.encoder_station if station is None else elastic.shaft.station(station, "station")
    shape = (times.size, len(names))
    external = np.zeros(shape) if torque is None else np.ascontiguousarray(np.broadcast_to(torque, shape), dtype=float)

    def run(count: int) -> Outputs:
        state, out = _start(elastic, columns, number, external, settled), outputs(*shape)
        follow(elastic.chain, state, number, times, columns[1], columns[2], columns[3], count, external, out)
        return out

    if substeps is not None:
        if substeps < 1:
            raise MotionError(f"substeps must be 1 or more, not {substeps}")
        return _motion(elastic, times, columns[1], run(substeps), substeps, math.nan)
    count, before, better = 1, run(1), None
    while True:
        count *= 2
        after, last = run(count), better
        better = Outputs(*(fine + (fine - coarse) / 3.0 for fine, coarse in zip(after, before, strict=True)))
        if last is not None:
            largest = float(np.abs(better.pieces).max()) or 1.0
            error = float(np.abs(better.pieces - last.pieces).max()) / largest
            if error <= tolerance:
                return _motion(elastic, times, columns[1], better, count, error)
            if count >= _MOST_SUBSTEPS:
                raise MotionError(
                    f"{count} substeps between two samples reach a tolerance of {error:.2g}, not {tolerance:g}; take"
                    " samples that lie closer together, or a larger tolerance"
                )
        before = after


def _start(
    elastic: ElasticShaft, columns: list[FloatArray], station: int, torque: FloatArray, settled: bool
) -> ChainState:
    """The state at the first sample: twisted as in uniform rotation, with the speed at which this twist changes."""
    chain, state = elastic.chain, chain_state(elastic.chain)
    if not settled:
        return state
    time, theta, omega, alpha = (float(each[0]) for each in columns)
    jerk = (float(columns[3][1]) - alpha) / (float(columns[0][1]) - time)
    moment = 1e-4 / max(abs(omega), 1.0)
    around = []
    for t in (-moment, moment, 0.0):
        angle, speed = theta + t * omega + 0.5 * t * t * alpha, omega + t * alpha
        twist_statically(chain, state, angle, speed, alpha + t * jerk, station, torque[0])
        around.append(state.psi.copy())
    rate = (around[1] - around[0]) / (2.0 * moment)
    smooth = np.abs(around[0] + around[1] - 2.0 * around[2]) <= 0.1 * np.abs(around[1] - around[0])
    state.speed[:] = np.where(smooth, rate, 0.0)
    return state


def _motion(
    elastic: ElasticShaft, times: FloatArray, reference: FloatArray, out: Outputs, substeps: int, error: float
) -> ChainMotion:
    """The result from reduced outputs."""
    ratios = elastic.ratios
    twist = (out.psi[:, :-1] - out.psi[:, 1:]) * ratios[1:]
    return ChainMotion(
        elastic.shaft.names,
        times,
        (reference[:, None] + out.psi) * ratios,
        out.omega * ratios,
        out.alpha * ratios,
        elastic.piece_torques(out.pieces),
        twist,
        out.drive,
        substeps,
        error,
    )
