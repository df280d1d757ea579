"""Motion at given times, evaluated from the log of an integration."""

from __future__ import annotations

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import compiled
from textile_twin_core.contact.log import Log
from textile_twin_core.contact.plant import Plant
from textile_twin_core.contact.polynomials import value


@compiled
def read_motion(plant: Plant, log: Log, times: FloatArray, first: bool, motion: FloatArray, force: FloatArray) -> None:
    """Write position, velocity, acceleration (3, movers, times) and force on the driven element [N] (times,).

    At an event they are the values before it. Logs of consecutive pieces are read in their order: a later log does not
    change the times up to its beginning.
    """
    for i in range(times.size):
        if times[i] <= log.heads[0, 0] and not first:
            continue
        k = log.counts[1] - 1
        while k > 0 and log.heads[k, 0] >= times[i]:
            k -= 1
        span, series = log.heads[k, 1], log.series[k]
        u = min((times[i] - log.heads[k, 0]) / span, 1.0)
        for mover in range(plant.constant.size):
            x = v = half_a = 0.0
            for power in range(series.shape[1] - 1, -1, -1):
                half_a = half_a * u + v
                v = v * u + x
                x = x * u + series[mover, power]
            motion[0, mover, i], motion[1, mover, i], motion[2, mover, i] = x, v / span, 2.0 * half_a / (span * span)
        force[i] = _force_on_drive(plant, series, u, motion[0, :, i], motion[1, :, i])


@compiled
def _force_on_drive(plant: Plant, series: FloatArray, u: float, positions: FloatArray, velocities: FloatArray) -> float:
    """Compute the force [N] of springs, dampers, pads and stops on the driven element."""
    movers, pads = plant.constant.size, plant.pad_places.size
    row = movers - 1
    force = plant.constant[row]
    for mover in range(movers):
        force -= plant.stiffness[row, mover] * positions[mover] + plant.damping[row, mover] * velocities[mover]
    for pad in range(pads):
        force -= plant.pads[pad, row] * value(series[movers + pad], u)
    for stop in range(plant.limits.size):
        force += plant.stops[stop, row] * value(series[movers + pads + stop], u)
    return force
