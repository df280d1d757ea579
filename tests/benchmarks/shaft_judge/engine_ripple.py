"""The engine's speed ripple by half orders, as a track has it, against `drive` under the measured gas torque."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import textile_twin_core as ttc
from tests.benchmarks.engine_records import BORE_M, CRANK_M, ROD_M, EngineRun, gas_torque
from tests.benchmarks.shaft_judge.views import Track
from textile_twin_core.dynamics import Body
from textile_twin_core.machine import Machine
from textile_twin_core.mechanism import Crank, RRPDyad

ORDERS = 12  # half orders: 0.5 to 6 of the turn
_CYCLE = 4.0 * np.pi
_BINS = 720
# The masses of the engine are not published: those of its class. The flywheel's inertia is found for each run.
_PISTON_KG, _ROD_KG, _INERTIA_KGM2 = 0.20, 0.12, 0.022
_ODD = slice(0, ORDERS, 2)  # orders 0.5, 1.5, ...: no error of the toothed wheel reaches them


@dataclass(frozen=True)
class Driven:
    """Result of `drive` for one run.

    Attributes:
        waves: (12,) complex amplitudes of the speed [rad/s] by half orders.
        speed: mean speed [rad/s].
        inertia_kgm2: of the flywheel, from the odd half orders.
    """

    waves: np.ndarray
    speed: float
    inertia_kgm2: float


def waves_of(made: Track, run: EngineRun, angle_rad: np.ndarray) -> np.ndarray:
    """(12,) complex amplitudes of a track's speed by half orders, after the first 15 %."""
    late = made.index >= 0.15 * angle_rad.size
    return amplitudes(angle_rad[made.index[late]] - run.tdc_rad, made.omega[late])


def driven(run: EngineRun, angle_rad: np.ndarray, seen: np.ndarray) -> Driven:
    """The ripple by `drive` under the measured gas torque; the inertia is fitted to the odd half orders seen."""
    crank = np.interp(run.gas_time_s, run.time_s, angle_rad) - run.tdc_rad
    torque = _mean_cycle(crank, gas_torque(crank, run.pressure_Pa))
    speed = float((angle_rad[-1] - angle_rad[0]) / (run.time_s[-1] - run.time_s[0]))
    inertia = _INERTIA_KGM2
    for _ in range(2):
        waves = _driven(torque, speed, inertia)
        inertia *= np.vdot(waves[_ODD], waves[_ODD]).real / np.vdot(waves[_ODD], seen[_ODD]).real
    return Driven(_driven(torque, speed, inertia), speed, float(inertia))


def wheel_errors(seen: list[np.ndarray], said: list[Driven]) -> np.ndarray:
    """(12,) the toothed wheel's part of the whole orders, per speed: the median over runs; 0 for odd half orders.

    An eccentric wheel reads as ripple of whole orders that is the same for every load: no motion tells the two apart,
    the torque does.
    """
    excess = np.array([(a - b.waves) / b.speed for a, b in zip(seen, said, strict=True)])
    excess[:, _ODD] = 0.0
    return np.asarray(np.median(excess.real, axis=0) + 1j * np.median(excess.imag, axis=0))


def explained(seen: np.ndarray, said: Driven, wheel: np.ndarray) -> tuple[float, float]:
    """R2 of the ripple: over the odd half orders, and over all after the wheel's errors."""
    rest, real = seen - wheel * said.speed - said.waves, seen - wheel * said.speed
    parts = [(rest[_ODD], real[_ODD]), (rest, real)]
    odd, every = (float(1.0 - np.vdot(a, a).real / np.vdot(b, b).real) for a, b in parts)
    return odd, every


def amplitudes(angle_rad: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """(12,) complex amplitudes of the half orders, by least squares beside a slow change of the mean."""
    x = (angle_rad - angle_rad[0]) / (angle_rad[-1] - angle_rad[0])
    waves = np.exp(0.5j * np.outer(angle_rad, np.arange(1, ORDERS + 1)))
    table = np.concatenate([np.polynomial.chebyshev.chebvander(2.0 * x - 1.0, 3), waves.real, waves.imag], axis=1)
    answer, *_ = np.linalg.lstsq(table, omega, rcond=None)
    return np.asarray(answer[4 : 4 + ORDERS] - 1j * answer[4 + ORDERS :])


def _mean_cycle(crank_rad: np.ndarray, torque: np.ndarray) -> np.ndarray:
    """(720,) mean over the cycles, by degrees of two turns."""
    cell = (np.mod(crank_rad, _CYCLE) / _CYCLE * _BINS).astype(int) % _BINS
    return np.asarray(np.bincount(cell, torque, _BINS) / np.bincount(cell, minlength=_BINS))


def _driven(torque: np.ndarray, speed: float, inertia: float) -> np.ndarray:
    """The half orders of the engine's machine under the gas torque less its mean, over three cycles."""
    bodies = (Body.flywheel(inertia), Body("rod", _ROD_KG, centroid=(ROD_M / 3.0, 0.0)), Body("piston", _PISTON_KG))
    dyad = RRPDyad("rod", "piston", "A", "B", "T", (ROD_M, BORE_M), (0.0, 0.0), (1.0, 0.0))
    engine = Machine("engine", {"O": (0.0, 0.0)}, (Crank("crank", "O", "A", CRANK_M), dyad), bodies)
    edges = (np.arange(_BINS + 1) + 0.5) * _CYCLE / _BINS
    around, mean = np.append(torque, torque[0]), float(np.mean(torque))

    def drive(time: float, theta: float, omega: float) -> float:
        place = (theta - edges[0]) % _CYCLE / _CYCLE * _BINS
        left = int(place)
        return float(around[left] + (place - left) * (around[left + 1] - around[left])) - mean

    motion = ttc.drive(engine, drive, 0.0, speed, np.linspace(0.0, 3.0 * _CYCLE / speed, 1000), tolerance=1e-7)
    return amplitudes(motion.theta_rad, motion.omega_rad_s)
