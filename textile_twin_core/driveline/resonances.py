"""Natural frequencies, mode shapes and critical speeds of an elastic main shaft.

The inertia of a linkage counts with its mean over the turn; how far a frequency moves over the turn stands beside it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy

from textile_twin_core.arrays import FloatArray
from textile_twin_core.driveline.chain import ElasticShaft
from textile_twin_core.driveline.profile import TURN, AngleProfile, evaluate
from textile_twin_core.errors import MotionError

MATTERS = 0.005
"""An order matters for a mode where it excites it by this share of the peak torque: ten times amplified it shows."""
HIGHEST_ORDER = 60
_SAMPLES = 720
_TURN_STEPS = 72


@dataclass(frozen=True)
class ShaftMode:
    """One natural vibration of the shaft.

    undamped_Hz: without any damping. damped_Hz: the frequency at which it dies away; 0 where it is overdamped.
    damping_ratio: share of the critical damping. lowest_Hz, highest_Hz: range of the undamped frequency over the turn,
    with the inertias of the linkages at each angle. shape: (stations,) angles of the stations, the largest 1.
    """

    undamped_Hz: float
    damped_Hz: float
    damping_ratio: float
    lowest_Hz: float
    highest_Hz: float
    shape: FloatArray


@dataclass(frozen=True)
class CriticalSpeed:
    """Shaft speed at which an order of the machine's own torque meets a mode (numbered from 1).

    share: torque in the piece that this mode loads most, as if it acted slowly, over the peak torque of that kind;
    amplification: how much larger the vibration is at this speed, infinite without damping.
    """

    speed_rad_s: float
    order: int
    mode: int
    frequency_Hz: float
    share: float
    amplification: float
    piece: int

    @property
    def severity(self) -> float:
        """Share of the torque at resonance; without damping the share as it acts slowly."""
        return self.share * (self.amplification if math.isfinite(self.amplification) else 1.0)


@dataclass(frozen=True)
class Resonances:
    """Modes from the lowest on, and the critical speeds within a range of speeds, rising."""

    stations: tuple[str, ...]
    modes: tuple[ShaftMode, ...]
    speeds_rad_s: tuple[float, float]
    critical: tuple[CriticalSpeed, ...]


def natural_frequencies(inertia: FloatArray, stiffness: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Undamped natural frequencies [Hz] but for the rigid rotation, rising, and modes of unit modal inertia.

    Args:
        inertia: (stations,) [kg m^2].
        stiffness: (stations - 1,) of the pieces [N m/rad].

    Returns:
        (stations - 1,) frequencies and (stations, stations - 1) modes. They are singular values of the scaled
        differences between neighbours, whose small ones keep their digits (Golub and Van Loan 2013, 8.6).
    """
    scale = 1.0 / np.sqrt(inertia)
    root = np.sqrt(stiffness)
    differences = np.zeros((stiffness.size, inertia.size))
    rows = np.arange(stiffness.size)
    differences[rows, rows], differences[rows, rows + 1] = root * scale[:-1], -root * scale[1:]
    _, values, vectors = scipy.linalg.svd(differences, full_matrices=False)
    return values[::-1] / TURN, (scale * vectors[::-1]).T


def find_modes(elastic: ElasticShaft) -> tuple[ShaftMode, ...]:
    """Compute every mode of the shaft but the rigid rotation, from the lowest frequency on.

    Damping is that of the pieces and of the bearings and the drive's slip; where it couples modes, a damped frequency
    belongs to the undamped mode that its shape is nearest to.
    """
    chain = elastic.chain
    frequencies, modes = natural_frequencies(elastic.mean_inertia_kgm2, chain.stiffness)
    rigid = np.full((modes.shape[0], 1), 1.0 / math.sqrt(elastic.mean_inertia_kgm2.sum()))
    basis = np.hstack([rigid, modes])
    twist = basis[:-1] - basis[1:]
    damping = twist.T @ (chain.damping[:, None] * twist) + basis.T @ (chain.viscous[:, None] * basis)
    decays, damped = _damped(TURN * np.concatenate([[0.0], frequencies]), damping)
    over_turn = np.array([natural_frequencies(each, chain.stiffness)[0] for each in _inertias(elastic)])
    found = []
    for k, frequency in enumerate(frequencies.tolist()):
        own = elastic.ratios * modes[:, k]
        size = math.hypot(decays[k + 1], damped[k + 1])
        ratio = decays[k + 1] / (size if damped[k + 1] > 0.0 else TURN * frequency)
        low, high = min(over_turn[:, k].min(), frequency), max(over_turn[:, k].max(), frequency)
        shape = own / own[np.abs(own).argmax()]
        found.append(ShaftMode(frequency, float(damped[k + 1] / TURN), float(ratio), float(low), float(high), shape))
    return tuple(found)


def _damped(omega: FloatArray, damping: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(modes,) decay rates [1/s] and damped frequencies [rad/s] from undamped ones and the modal damping matrix.

    A mode that does not swing has the frequency 0, and half of its damping as decay rate.
    """
    n = omega.size
    system = np.block([[np.zeros((n, n)), np.eye(n)], [-np.diag(omega**2), -damping]])
    values, vectors = np.linalg.eig(system)
    swings = np.flatnonzero(values.imag > 1e-6 * np.abs(values))
    weight = np.abs(vectors[:n, swings]) * omega[:, None]
    weight /= weight.max(axis=0, initial=1e-300)
    rows, columns = scipy.optimize.linear_sum_assignment(-weight)
    decays, damped = 0.5 * np.diag(damping), np.zeros(n)
    decays[rows], damped[rows] = -values[swings[columns]].real, values[swings[columns]].imag
    return decays, damped


def _inertias(elastic: ElasticShaft) -> FloatArray:
    """(angles, stations) inertias at shaft angles over one turn."""
    theta = TURN * np.arange(_TURN_STEPS) / _TURN_STEPS
    found = np.tile(elastic.chain.inertia, (_TURN_STEPS, 1))
    for stations, profile, phase in _hangers(elastic):
        found[:, stations] += evaluate(profile.functions[:1], theta + phase)[0][:, None]
    return found


def _hangers(elastic: ElasticShaft) -> list[tuple[list[int], AngleProfile, float]]:
    """Stations of the hangers of each profile at each phase."""
    chain = elastic.chain
    groups: dict[tuple[int, float], list[int]] = {}
    for station, number, phase in zip(
        elastic.hanger_stations, chain.profile.tolist(), chain.phase.tolist(), strict=True
    ):
        groups.setdefault((number, phase), []).append(station)
    return [(stations, elastic.profiles[number], phase) for (number, phase), stations in groups.items()]


def find_resonances(elastic: ElasticShaft, speeds_rad_s: tuple[float, float]) -> Resonances:
    """Compute the modes of the shaft and the critical speeds in a range of speeds.

    The orders are those of the torque that the stations need at uniform speed: J'/2 omega^2 + V' - loads. A critical
    speed is reported where its order matters (see `MATTERS`).

    Args:
        elastic: The shaft, from `elastic_shaft`.
        speeds_rad_s: Slowest and fastest speed of the main shaft [rad/s].

    Returns:
        The modes, and the critical speeds in the range.

    Raises:
        MotionError: For a range that is empty or not positive.

    Examples:
        >>> import textile_twin_core as ttc
        >>> from textile_twin_core.driveline.chain import elastic_shaft
        >>> from textile_twin_core.driveline.resonances import find_resonances
        >>> shaft = elastic_shaft(ttc.load_machine("examples/wide_tufting.yaml"))
        >>> found = find_resonances(shaft, (10.0, 60.0))  # [rad/s]
        >>> round(found.modes[0].undamped_Hz)  # [Hz]
        112
    """
    slow, fast = speeds_rad_s
    if not 0.0 < slow < fast < math.inf:
        raise MotionError(f"the range of speeds must rise from above 0, not {slow:g} to {fast:g} rad/s")
    modes = find_modes(elastic)
    unit = natural_frequencies(elastic.mean_inertia_kgm2, elastic.chain.stiffness)[1]
    needed = needed_by_power(elastic)
    critical = []
    for k, mode in enumerate(modes):
        shares = elastic.chain.stiffness * np.abs(unit[:-1, k] - unit[1:, k]) / (TURN * mode.undamped_Hz) ** 2
        piece = int(shares.argmax())
        for order in range(1, HIGHEST_ORDER + 1):
            speed = TURN * mode.damped_Hz / order
            if not slow <= speed <= fast:
                continue
            torque = needed[0] + speed * (needed[1] + speed * needed[2])
            force = 2.0 * abs(complex(np.fft.rfft(unit[:, k] @ torque)[order])) / _SAMPLES
            share = float(force * shares[piece] / (_peak_torque(elastic, torque) or math.inf))
            if share >= MATTERS:
                gain = 0.5 / mode.damping_ratio if mode.damping_ratio > 0.0 else math.inf
                critical.append(CriticalSpeed(speed, order, k + 1, mode.damped_Hz, share, gain, piece))
    critical.sort(key=lambda each: each.speed_rad_s)
    return Resonances(elastic.shaft.names, modes, speeds_rad_s, tuple(critical))


def needed_by_power(elastic: ElasticShaft) -> FloatArray:
    """(3, stations, samples) torque needed over one turn at uniform speed, by powers of the speed."""
    theta = TURN * np.arange(_SAMPLES) / _SAMPLES
    found = np.zeros((3, elastic.stations, _SAMPLES))
    for stations, profile, phase in _hangers(elastic):
        _, half_slope, weight, *loads = evaluate(profile.functions, theta + phase)
        torque = np.stack([weight, np.zeros(_SAMPLES), half_slope])
        row = np.searchsorted(profile.forward.starts_rad, (theta + phase) % TURN, side="right") - 1
        for j, load in enumerate(loads):
            torque[profile.powers[j]] -= profile.forward.coefficients[row, j] * load
        for station in stations:
            found[:, station] += torque
    return found


def _peak_torque(elastic: ElasticShaft, needed: FloatArray) -> float:
    """Largest torque in any piece as if the shaft were rigid [N m]."""
    beyond = np.cumsum(needed[::-1], axis=0)[::-1][1:]
    before = np.arange(elastic.stations - 1) < elastic.shaft.drive_station
    return float(np.abs(np.where(before[:, None], needed.sum(axis=0) - beyond, beyond)).max())
