"""Energy account of a run: kinetic, elastic, damped, lost in impacts, and work of the drive."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.contact.model import ContactModel
from textile_twin_core.contact.plant import Plant, plant_of
from textile_twin_core.contact.polynomials import gram_matrix
from textile_twin_core.contact.result import ContactEvent, Segment
from textile_twin_core.contact.state import PadState


@dataclass(frozen=True)
class EnergyBook:
    """Energies [J] at the segments' ends, arrays (segments+1,); impacts count at the end at which they happen.

    The sum kinetic + potential + damped + lost - work is constant; `imbalance` is its error.
    """

    times_s: FloatArray
    kinetic_J: FloatArray
    potential_J: FloatArray
    damped_J: FloatArray
    impact_J: FloatArray
    work_J: FloatArray

    @property
    def imbalance(self) -> float:
        """Largest change of the constant sum, relative to the largest energy involved."""
        total = self.kinetic_J + self.potential_J + self.damped_J + self.impact_J - self.work_J
        exchanged = np.abs(np.diff(self.potential_J, prepend=self.potential_J[0])).sum()
        largest = max(
            float(np.abs(part).max())
            for part in (self.kinetic_J, self.potential_J, self.damped_J, self.impact_J, self.work_J, exchanged)
        )
        return float(np.abs(total - total[0]).max()) / largest if largest > 0.0 else 0.0


def book_energy(model: ContactModel, segments: list[Segment], events: list[ContactEvent]) -> EnergyBook:
    """Compute the energy account of a run, integrating work and damping exactly from the segments' power series."""
    plant = plant_of(model)
    bodies = len(model.bodies)
    rows = np.zeros((5, len(segments) + 1))
    times = np.array([*(segment.start_s for segment in segments), segments[-1].end_s])
    damped = work = lost = 0.0
    event = 0
    for k, segment in enumerate(segments):
        start, velocity = segment.positions[:, 0], segment.positions[:, 1] / segment.span_s
        while event < len(events) and events[event].booked_s <= segment.start_s:
            lost += events[event].energy_lost_J
            work += events[event].drive_work_J
            event += 1
        rows[:, k] = kinetic_energy(plant, velocity), potential_energy(model, start), damped, lost, work
        speeds = segment.velocities
        gram = gram_matrix(speeds.shape[1]) * segment.span_s
        damped += float(np.sum((plant.damping @ speeds @ gram) * speeds))
        for number, state in enumerate(segment.pads):
            if state is PadState.OFF:
                continue
            depth = plant.pads[number] @ segment.positions
            depth[0] -= plant.pad_places[number]
            pad = model.pads[number]
            if state is PadState.PUSHING:
                rate = plant.pads[number] @ speeds
                damped += pad.damping_Ns_m * float(rate @ gram @ rate)
            else:
                damped += float(pad.energy(depth[:1])[0] - pad.energy(depth.sum(keepdims=True))[0])
        work -= float(_drive_force(plant, segment) @ gram @ speeds[bodies])
    last = segments[-1]
    for remaining in events[event:]:
        lost += remaining.energy_lost_J
        work += remaining.drive_work_J
    end, end_velocity = last.positions.sum(axis=1), last.velocities.sum(axis=1)
    rows[:, -1] = kinetic_energy(plant, end_velocity), potential_energy(model, end), damped, lost, work
    return EnergyBook(times, *rows)


def kinetic_energy(plant: Plant, velocities: FloatArray) -> FloatArray:
    """Compute the bodies' kinetic energy [J] from velocities (movers, ...); the driven element is massless here."""
    return np.asarray(0.5 * np.tensordot(plant.masses, velocities[:-1] ** 2, axes=1))


def potential_energy(model: ContactModel, positions: FloatArray) -> FloatArray:
    """Compute the energy [J] of springs, pads and constant forces at positions (movers, ...)."""
    at = np.concatenate((positions, np.zeros_like(positions[:1])))
    total = np.zeros(positions.shape[1:])
    for row, body in enumerate(model.bodies):
        total = total - body.force_N * at[row]
    for spring in model.springs:
        stretch = at[model.index[spring.upper]] - at[model.index[spring.lower]] - spring.free_length_m
        total = total + 0.5 * spring.stiffness_N_m * stretch * stretch
    for pad in model.pads:
        depth = at[model.index[pad.upper]] - at[model.index[pad.lower]] - pad.position_m
        total = total + pad.energy(np.maximum(depth, 0.0))
    return np.asarray(total)


def _drive_force(plant: Plant, segment: Segment) -> FloatArray:
    """Compute the power series (order,) of the force [N] on the driven element over a segment."""
    row = plant.constant.size - 1
    force = -(plant.stiffness[row] @ segment.positions[:, :-1]) - plant.damping[row] @ segment.velocities
    force[0] += plant.constant[row]
    force -= plant.pads[:, row] @ segment.pad_forces
    force[:-1] += plant.stops[:, row] @ segment.stop_forces
    return np.asarray(force)
