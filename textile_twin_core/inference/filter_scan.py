"""Scan over filters of the torque sensor: which of them could explain a record better than none."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.inference.chain import torque_filter
from textile_twin_core.inference.evidence import OF_BODIES
from textile_twin_core.inference.map_fit import Fit
from textile_twin_core.inference.measurement import Measurement
from textile_twin_core.inference.parameter import BUTTERWORTH, HIGH_PASS, LOW_PASS, OFFSET
from textile_twin_core.inference.starts import GROUP_DELAY

_TIME_CONSTANTS_S = (0.002, 0.004, 0.008, 0.016, 0.032, 0.08)
_CORNERS_HZ = (0.1, 0.3, 1.0)
_CANDIDATES = tuple(
    (name, value)
    for name, values in ((LOW_PASS, _TIME_CONSTANTS_S), (BUTTERWORTH, _TIME_CONSTANTS_S), (HIGH_PASS, _CORNERS_HZ))
    for value in values
)
_SHIFTS_S = np.linspace(-4e-3, 4e-3, 9)
_SAMPLES = 2500
HOPEFUL = 0.93
"""Mean square of the residual, over that without a filter, below which a filter is fitted."""
_EXCLUSIVE = frozenset({LOW_PASS, BUTTERWORTH})


def likely_filters(measurement: Measurement, fit: Fit, hopeful: float = HOPEFUL) -> list[tuple[str, float, float]]:
    """List the filters that lower the residual of a fit clearly, with their values, the best first.

    Gain, dry and viscous friction, inertia, force and delay are solved for beside each candidate. Bodies and links are
    nominal: already their tolerances could imitate a filter. A low pass beside another low pass is no candidate.

    Args:
        measurement: record and model, linear about the fit.
        fit: without these filters.
        hopeful: mean square of the residual, over that without a filter, below which one is listed.

    Returns:
        Name, value and change of the delay [s] for the best value of each filter.
    """
    m = measurement
    v = m.values(fit.x) | {p.name: p.nominal for p in m.parameters if p.kind in OF_BODIES}
    hypothesis = replace(fit.hypothesis, filters=fit.hypothesis.filters | {LOW_PASS})  # states on the grid
    (theta, omega, alpha, good), _ = m.states(hypothesis, v)
    good = good & (np.abs(omega) > 0.6 * m.record.slow_rad_s * abs(hypothesis.turn))
    forces = [p.name for p in m.parameters if p.kind == "force"]
    nominal = m.model.torque(v, (theta, omega, alpha), m.model.table(v, m.about), forces)
    later = np.gradient(nominal.torque_Nm)  # for delays between the shifts
    columns = [nominal.torque_Nm, np.sign(omega), omega, alpha, later, *(nominal.slopes[name] for name in forces)]
    matrix = np.where(good, np.stack(columns), 0.0)
    shown = m.record.torque_Nm - fit.hypothesis.shown_offset(v[OFFSET])
    every = np.unique(np.linspace(0, shown.size - 1, _SAMPLES).astype(np.int64))

    def residual(values: dict[str, float]) -> tuple[FloatArray, float]:
        """Residual at every chosen sample with these filters, nan where unknown, and the change of the delay."""
        chosen = torque_filter(values)
        known = m.grid.settled(chosen, good)[every]
        used, best, late = every[known], np.full(every.size, math.nan), 0.0
        if used.size < _SAMPLES // 10:
            return best, late
        through = m.grid.through(chosen, matrix)
        lag = sum(GROUP_DELAY[name] * (values[name] - v[name]) for name in GROUP_DELAY)
        for shift in _SHIFTS_S.tolist():
            rows = m.grid.at_samples(through, shift - lag, used).T
            if HIGH_PASS in fit.hypothesis.filters or values[HIGH_PASS]:
                rows = np.column_stack([rows, np.ones(used.size)])
            other = _residual(rows, shown[used])
            if not np.sum(other**2) >= np.sum(best[known] ** 2):
                best[known], late = other, shift - lag
        return best, late

    without = residual(dict(v))[0]
    out: dict[str, tuple[float, float, float]] = {}
    for name, value in _CANDIDATES:
        taken = fit.hypothesis.filters
        if name in taken or (name in _EXCLUSIVE and taken & _EXCLUSIVE):
            continue
        found, late = residual({**v, name: value})
        both = np.isfinite(found) & np.isfinite(without)
        reached = float(np.sum(found[both] ** 2) / max(np.sum(without[both] ** 2), 1e-300)) if both.any() else math.inf
        if reached < hopeful and (name not in out or reached < out[name][0]):
            out[name] = reached, value, late
    return [(name, value, late) for name, (_, value, late) in sorted(out.items(), key=lambda each: each[1][0])]


def _residual(matrix: FloatArray, side: FloatArray) -> FloatArray:
    """Residual of a least-squares fit."""
    scaled = matrix / np.maximum(np.sqrt(np.mean(matrix**2, axis=0)), 1e-300)
    solved = np.linalg.lstsq(scaled, side, rcond=1e-9)[0]
    return np.asarray(side - scaled @ solved)
