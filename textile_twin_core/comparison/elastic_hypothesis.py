"""Test of an elastic shaft on a recording of a machine whose file has a rigid shaft."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from textile_twin_core.arrays import ComplexArray, FloatArray
from textile_twin_core.comparison.cause import Cause
from textile_twin_core.comparison.evidence import Evidence
from textile_twin_core.comparison.shaft_track import TURN
from textile_twin_core.driveline import elastic_shaft
from textile_twin_core.driveline.harmonic_response import HarmonicResponse, harmonic_response
from textile_twin_core.inference.measurement import Hypothesis
from textile_twin_core.machine import Machine, MainShaft, ShaftPiece, ShaftPlace, Station, TorqueFilter
from textile_twin_core.twin import compile_machine

_TORQUE = "balancing_torque_Nm"
_TURNS = 5
"""Turns in a window, whose speed is taken as uniform."""
_UNIFORM = 0.1
"""Largest spread of the turns' mean speeds in a window, over their mean."""
_MOST_WINDOWS = 6
_LONGEST_GAP_RAD = 0.5 * TURN
"""Largest distance of neighbouring states: beyond it the angle between them is too uncertain."""
_ORDERS = 100
_HIGHEST_HZ = 400.0
_SHARE_OF_SAMPLING = 0.4
"""Orders are fitted up to this share of the torque's sampling rate."""
_FREQUENCIES_HZ = np.geomspace(10.0, 500.0, 400)
"""First natural frequencies tried: 1 % apart."""
_DRIVES = (1.0, 3.0, 10.0)
"""Inertias of the drive tried, over that of all linkages together."""
_DAMPING_RATIOS = (0.01, 0.03)
_DELAYS_S = np.linspace(-0.005, 0.005, 41)
"""Delays of the torque tried beside the configured one: phases of high orders are sensitive to them."""
_LEAST_DISC_KGM2 = 1e-9
"""Disc of the drive's station, to which the inertias tried are added."""
_ANGLES = 720
"""Zeros of the encoder tried for the rigid shaft."""
_LEAST_RIGID, _MOST_UNEXPLAINED, _BETTER = 0.02, 0.3, 0.7
"""An elastic shaft is named where the rigid one leaves at least the first share of the variance unexplained, the
elastic one at most the second, and at most the third share of what the rigid one leaves. In 24 simulated recordings of
wide machines (40 to 100 mm, 160 to 500 rpm, in phase and staggered) elastic shafts leave 0.01 to 0.20."""


RIGID_NOTE = (
    "the machine file has a rigid shaft and the recording an elastic one: sensors, friction and masses are not judged;"
    " declare `shaft` in the machine file, then compare again"
)


@dataclass(frozen=True)
class ElasticHypothesis:
    """The elastic shaft that explains a recording best.

    Attributes:
        first_Hz: first natural frequency. sigma_Hz: its standard deviation.
        stiffness_Nm_rad: of the whole shaft from the drive to the last linkage, as equal pieces.
        unexplained, rigid_unexplained: share of the torque's variance over the orders of the shaft that the elastic
            and the rigid shaft leave unexplained.
    """

    first_Hz: float
    sigma_Hz: float
    stiffness_Nm_rad: float
    unexplained: float
    rigid_unexplained: float


def elastic_hypothesis(evidence: Evidence, machine: Machine, configured: Hypothesis) -> ElasticHypothesis | None:
    """Fit an elastic shaft with the machine's linkages in a row behind the drive.

    The torque of each window of turns is compared order by order with the response of a chain of equal pieces. Free
    parameters are the first natural frequency, the drive's inertia, the damping and a small delay; the sensors are as
    configured. The rigid shaft for comparison may have any zero and direction of the encoder, any gain and sign.

    Args:
        evidence: The record.
        machine: The machine with its rigid shaft.
        configured: sensors as the machine file has them.

    Returns:
        The shaft; None if it does not explain the torque clearly better than a rigid one.
    """
    if machine.shaft is not None or machine.missing_for_torque or not machine.linkage.solved.turns_fully:
        return None
    windows = _windows(evidence, configured, machine)
    if not windows:
        return None
    rigid = _rigid_unexplained(windows)
    if rigid < _LEAST_RIGID:
        return None
    total = sum(float(np.sum(np.abs(window.amplitudes) ** 2)) for window in windows)
    shaft = _row_of_linkages(machine)
    elastic = elastic_shaft(replace(machine, shaft=shaft, linkages=_places(machine)))
    linkages = float(elastic.mean_inertia_kgm2.sum())
    best: tuple[float, float, HarmonicResponse] | None = None
    curve = np.empty(0)
    for drive in _DRIVES:
        for damping in _DAMPING_RATIOS:
            response = harmonic_response(elastic, drive * linkages, damping)
            left = _unexplained(response, windows) / total
            k = int(left.argmin())
            if best is None or left[k] < best[0]:
                best, curve = (float(left[k]), float(_FREQUENCIES_HZ[k]), response), left
    assert best is not None
    unexplained, first, response = best
    if unexplained > min(_MOST_UNEXPLAINED, _BETTER * rigid):
        return None
    stiffness = (first / response.first_Hz) ** 2 / len(shaft.pieces)
    count = sum(window.amplitudes.size for window in windows)
    return ElasticHypothesis(first, _width(curve, count), stiffness, unexplained, rigid)


def elastic_cause(found: ElasticHypothesis) -> Cause:
    """Cause for the verdict."""
    text = (
        f"the main shaft twists: first natural frequency {found.first_Hz:.1f} +- {found.sigma_Hz:.1f} Hz, about"
        f" {found.stiffness_Nm_rad:.2g} N m/rad from the drive to the last linkage; so it leaves"
        f" {found.unexplained:.0%} of the torque's variance, a rigid shaft {found.rigid_unexplained:.0%}"
    )
    value = {"first_mode_Hz": found.first_Hz, "stiffness_Nm_rad": found.stiffness_Nm_rad}
    return Cause("elastic_shaft", text, value, found.sigma_Hz)


def _row_of_linkages(machine: Machine) -> MainShaft:
    """Return a shaft with a station for the drive and one for each linkage, and pieces of stiffness 1."""
    names = [f"s{k}" for k in range(len(machine.linkages) + 1)]
    pieces = (ShaftPiece(a, b, stiffness_Nm_rad=1.0) for a, b in pairwise(names))
    return MainShaft(tuple(Station(name, _LEAST_DISC_KGM2) for name in names), tuple(pieces))


def _places(machine: Machine) -> tuple[ShaftPlace, ...]:
    return tuple(replace(place, at=f"s{k + 1}") for k, place in enumerate(machine.linkages))


@dataclass(frozen=True)
class _Window:
    """A few turns at uniform speed: amplitudes (orders,) of the measured and the rigid torque from order 1 on.

    `passed` is the response of the torque sensor's filter, which is in both.
    """

    omega_rad_s: float
    amplitudes: ComplexArray
    rigid: ComplexArray
    passed: ComplexArray


def _windows(evidence: Evidence, configured: Hypothesis, machine: Machine) -> list[_Window]:
    """Choose windows of uniform speed, evenly over the record."""
    time = evidence.time_s - configured.delay_s
    track = evidence.track
    angle, omega, alpha, _ = track.at(time)
    # An estimator of a rigid shaft may reject readings of a vibrating shaft, always at the same angles of the turn.
    after = np.clip(np.searchsorted(track.time_s, time), 1, track.time_s.size - 1)
    apart = np.abs(track.theta_rad[after] - track.theta_rad[after - 1])
    good = (time >= track.time_s[0]) & (time <= track.time_s[-1]) & (apart < _LONGEST_GAP_RAD)
    theta = configured.turn * angle - configured.zero_rad
    good &= np.abs(omega) > evidence.slow_rad_s
    time, theta, torque = time[good], theta[good], (evidence.torque_Nm[good] - configured.offset_Nm) / configured.gain
    if time.size < 2:
        return []
    twin, torque_filter = compile_machine(machine, [_TORQUE]), TorqueFilter.of(machine.sensors.torque)
    expected = twin.evaluate(theta, configured.turn * omega[good], configured.turn * alpha[good])[_TORQUE]
    both = np.stack([torque, expected], axis=1)
    sampling = 1.0 / float(np.median(np.diff(time)))
    part = np.floor((theta - theta[0]) / (TURN * _TURNS))
    edges = np.flatnonzero(np.diff(part)) + 1
    found = [
        (rows, speed)
        for first, end in pairwise([0, *edges.tolist(), time.size])
        if (speed := _uniform_speed(time[rows := slice(first, end)], theta[rows])) is not None
    ]
    evenly = np.linspace(0, len(found) - 1, min(_MOST_WINDOWS, len(found))).astype(np.int64)
    chosen = [found[k] for k in evenly.tolist()]
    windows = (_window(speed, theta[rows], both[rows], sampling, torque_filter) for rows, speed in chosen)
    return [window for window in windows if window is not None]


def _uniform_speed(time: FloatArray, theta: FloatArray) -> float | None:
    """Speed of a window; None where samples are missing or the shaft does not turn forward at one speed."""
    turned, lasted = float(theta[-1] - theta[0]), float(time[-1] - time[0])
    if abs(turned) < 0.9 * TURN * _TURNS or not lasted > 0.0:
        return None
    speed = turned / lasted
    if speed <= 0.0:
        return None
    turns = [np.abs(theta - theta[0]) // TURN == k for k in range(_TURNS - 1)]
    if any(np.count_nonzero(rows) < 8 for rows in turns):
        return None
    speeds = [float(np.ptp(theta[rows]) / np.ptp(time[rows])) for rows in turns]
    return None if max(speeds) - min(speeds) > _UNIFORM * speed else speed


def _window(
    speed: float, theta: FloatArray, torques: FloatArray, sampling: float, torque_filter: TorqueFilter
) -> _Window | None:
    """Fit the orders of a window; None if too few of them lie below the limits."""
    orders = int(min(_ORDERS, min(_SHARE_OF_SAMPLING * sampling, _HIGHEST_HZ) * TURN / speed, theta.size // 6))
    if orders < 4:
        return None
    waves = np.exp(1j * np.outer(theta, np.arange(1, orders + 1)))
    columns = np.concatenate([np.ones((theta.size, 1)), waves.real, waves.imag], axis=1)
    fitted = np.linalg.lstsq(columns, torques, rcond=None)[0]
    amplitudes = fitted[1 : orders + 1] - 1j * fitted[orders + 1 :]
    passed = torque_filter.response(np.arange(1, orders + 1) * speed / TURN)
    return _Window(speed, amplitudes[:, 0], passed * amplitudes[:, 1], passed)


def _rigid_unexplained(windows: list[_Window]) -> float:
    """Share of the squared amplitudes that a rigid shaft leaves unexplained at its best zero, direction and gain."""
    zeros = TURN * np.arange(_ANGLES) / _ANGLES
    common, measured, expected = np.zeros((2, _ANGLES)), 0.0, 0.0
    for window in windows:
        turned = np.exp(1j * np.outer(np.arange(1, window.rigid.size + 1), zeros))
        for k, rigid in enumerate((window.rigid, np.conj(window.rigid))):
            common[k] += ((np.conj(window.amplitudes) * rigid) @ turned).real
        measured += float(np.sum(np.abs(window.amplitudes) ** 2))
        expected += float(np.sum(np.abs(window.rigid) ** 2))
    return 1.0 - float(np.max(common**2)) / (measured * expected) if measured * expected > 0.0 else 0.0


def _unexplained(response: HarmonicResponse, windows: list[_Window]) -> FloatArray:
    """Residual sum of squared amplitudes (frequencies,) of the response, each at its best delay."""
    factors = (_FREQUENCIES_HZ / response.first_Hz) ** 2
    squares_left = np.zeros((factors.size, _DELAYS_S.size))
    for window in windows:
        orders = window.amplitudes.size
        expected = window.passed * response.elastic(window.omega_rad_s, orders, factors)
        delayed = np.exp(-1j * np.outer(np.arange(1, orders + 1) * window.omega_rad_s, _DELAYS_S))
        common = ((expected * np.conj(window.amplitudes)) @ delayed).real
        squares = np.sum(np.abs(expected) ** 2, axis=1) + float(np.sum(np.abs(window.amplitudes) ** 2))
        squares_left += squares[:, None] - 2.0 * common
    return np.asarray(squares_left.min(axis=1))


def _width(curve: FloatArray, count: int) -> float:
    """Standard deviation of the frequency [Hz], from the likelihood of `count` amplitudes."""
    k, grid = int(curve.argmin()), _FREQUENCIES_HZ
    near = np.flatnonzero(count * np.log(curve / curve[k]) < 0.5)
    return 0.5 * float(grid[min(near.max() + 1, grid.size - 1)] - grid[max(near.min() - 1, 0)])
