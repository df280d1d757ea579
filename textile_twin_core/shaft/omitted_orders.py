"""Orders of the turn that a smoothed part of a record omits, from its residuals (see `residual_orders`)."""

from __future__ import annotations

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.shaft import layout
from textile_twin_core.shaft.constants import FEWEST_ORDERS, NORMAL_MEDIAN, ORDERS, ROBUST, SEEN_CYCLES
from textile_twin_core.shaft.residual_orders import add_omitted_orders, part_orders, resolved_share
from textile_twin_core.shaft.status import Records
from textile_twin_core.shaft.turns import TURN

PIECE = 4_096  # rows whose coefficients are summed at once: as many as a cache holds


def add_omitted(rows: Records, status: Records, model: int) -> None:
    """Add the variances by uncertain orders to the covariances of smoothed rows (n,) of a model."""
    now = status[0]
    bank, orders, lowest = now["bank"], now["orders"], float(now["bank"]["wave"]["lowest"])
    moving = np.abs(rows["speed"]) * rows["step"] > 3.0 * np.sqrt(rows["unit"])
    used = rows[moving & (rows["noise"] > 0.0) & (rows["residual"] != 0.0)]
    travel, power = float(np.sum(np.abs(np.diff(used["angle"])))), np.zeros(3)
    if len(used) and np.ptp(used["angle"]) * lowest >= SEEN_CYCLES * TURN:
        share = resolved_share(now["sampling"]["edges"]) * len(used) * TURN / (travel * lowest)
        top = min(int(share), ORDERS if model == layout.HIGH else layout.MOST_WAVES[-1])
        orders["found"][:top], white, bandwidth = _spectrum(used, lowest, top)
        last, omitted = part_orders(bank, orders, model), orders["found"][int(bank["models"]["waves"][model]) : top]
        if omitted.size >= FEWEST_ORDERS:  # no more than the median of exponentially distributed powers of that mean
            orders["sensor_power"] = min(orders["sensor_power"], np.median(omitted) / np.log(2.0))
        add_omitted_orders(bank, orders, model, top, last, white, bandwidth, 1.0)
        power = bank["models"]["uncertain_power"][model]
    for place in range(3):
        found = np.where(moving, power[place] * rows["speed"] ** (2 * place), 0.0)
        rows["covariance"][:, 4 * place] += found
        rows["systematic"][:, place] = found


def _spectrum(rows: Records, lowest: float, top: int) -> tuple[FloatArray, float, float]:
    """Return the squared amplitudes (top,) of the orders in the residuals, their mean if white, and the followed order.

    The smoother follows motion up to that order without a model.
    """
    residual = rows["residual"]
    most = np.sqrt(ROBUST * np.median(residual**2) / NORMAL_MEDIAN)
    residual, sums = np.clip(residual, -most, most), np.zeros(top, np.complex128)
    for first in range(0, len(rows), PIECE):
        piece = slice(first, first + PIECE)
        turn = np.exp(-1j * lowest * rows["angle"][piece])
        wave = residual[piece].astype(np.complex128)
        for k in range(top):
            wave *= turn
            sums[k] += np.sum(wave)
    independent = float(np.sum(1.0 / np.maximum(rows["correlated"], 1.0)))
    cut = np.median(rows["intensity"] / (rows["noise"] * rows["step"] * rows["speed"] ** 6))
    return np.abs(2.0 * sums / len(rows)) ** 2, float(4.0 * np.mean(residual**2) / independent), float(cut ** (1 / 6))
