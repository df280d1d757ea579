"""The energy of a run, booked: kinetic, elastic, damped, lost in impacts, brought in by the drive."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.contact.forces import LinearForces
from textile_twin_core.contact.mode import derivative
from textile_twin_core.contact.model import ContactModel
from textile_twin_core.contact.monitors import pad_series
from textile_twin_core.contact.polynomials import gram_matrix
from textile_twin_core.contact.result import ContactEvent, PadState, Segment


@dataclass(frozen=True)
class EnergyBook:
    """Energies [J] at the segments' ends, arrays (segments+1,); impacts are booked at the end they happen at.

    kinetic + potential + damped + lost - work is the same everywhere; `imbalance` says how nearly.
    """

    times_s: FloatArray
    kinetic_J: FloatArray
    potential_J: FloatArray
    damped_J: FloatArray
    impact_J: FloatArray
    work_J: FloatArray

    @property
    def imbalance(self) -> float:
        """Largest change of what must not change, relative to the largest energy that takes part."""
        total = self.kinetic_J + self.potential_J + self.damped_J + self.impact_J - self.work_J
        exchanged = np.abs(np.diff(self.potential_J, prepend=self.potential_J[0])).sum()
        largest = max(
            float(np.abs(part).max())
            for part in (self.kinetic_J, self.potential_J, self.damped_J, self.impact_J, self.work_J, exchanged)
        )
        return float(np.abs(total - total[0]).max()) / largest if largest > 0.0 else 0.0


def book_energy(model: ContactModel, segments: list[Segment], events: list[ContactEvent]) -> EnergyBook:
    """Energy book of a run; work and damping are integrated exactly from the segments' power series."""
    forces = LinearForces.of(model)
    bodies = len(model.bodies)
    rows = np.zeros((5, len(segments) + 1))
    times = np.array([*(segment.start_s for segment in segments), segments[-1].end_s])
    pad_normals = _normals(model, [(pad.upper, pad.lower) for pad in model.pads])
    stop_normals = _normals(model, [(stop.lower, stop.upper) for stop in model.stops])
    damped = work = lost = 0.0
    event = 0
    for k, segment in enumerate(segments):
        start, velocity = segment.positions[:, 0], segment.positions[:, 1] / segment.span_s
        while event < len(events) and events[event].booked_s <= segment.start_s:
            lost += events[event].energy_lost_J
            work += events[event].drive_work_J
            event += 1
        rows[:, k] = _kinetic(forces, velocity), _potential(model, start), damped, lost, work
        speeds = derivative(segment.positions) / segment.span_s
        gram = gram_matrix(speeds.shape[1]) * segment.span_s
        damped += float(np.sum((forces.damping @ speeds @ gram) * speeds))
        on_drive = forces.on_movers(segment.positions[:, :-1], speeds)[bodies]
        for number, state in enumerate(segment.pads):
            if state is PadState.OFF:
                continue
            depth = pad_series(model, number, pad_normals[number], segment.positions)
            pad = model.pads[number]
            if state is PadState.PUSHING:
                rate = pad_normals[number] @ speeds
                damped += pad.damping_Ns_m * float(rate @ gram @ rate)
                on_drive = on_drive - pad_normals[number, bodies] * segment.pad_forces[number]
            else:
                damped += pad.energy(float(depth[0])) - pad.energy(float(depth.sum()))
        for number, force in zip(segment.closed, segment.stop_forces, strict=True):
            on_drive[: force.size] += stop_normals[number, bodies] * force
        work -= float(on_drive @ gram @ speeds[bodies])
    last = segments[-1]
    for remaining in events[event:]:
        lost += remaining.energy_lost_J
        work += remaining.drive_work_J
    end_velocity = derivative(last.positions).sum(axis=1) / last.span_s
    rows[:, -1] = _kinetic(forces, end_velocity), _potential(model, last.positions.sum(axis=1)), damped, lost, work
    return EnergyBook(times, *rows)


def _normals(model: ContactModel, ends: list[tuple[str, str]]) -> FloatArray:
    """Rows (parts, movers) with +1 at the first and -1 at the second end, the frame left out."""
    movers = len(model.bodies) + 1
    rows = np.zeros((len(ends), movers + 1))
    for row, (plus, minus) in zip(rows, ends, strict=True):
        row[model.index[plus]] += 1.0
        row[model.index[minus]] -= 1.0
    return rows[:, :movers]


def _kinetic(forces: LinearForces, velocities: FloatArray) -> float:
    return 0.5 * float(forces.masses @ velocities[:-1] ** 2)


def _potential(model: ContactModel, positions: FloatArray) -> float:
    at = np.append(positions, 0.0)
    total = -sum(body.force_N * float(at[row]) for row, body in enumerate(model.bodies))
    for spring in model.springs:
        stretch = float(at[model.index[spring.upper]] - at[model.index[spring.lower]]) - spring.free_length_m
        total += 0.5 * spring.stiffness_N_m * stretch * stretch
    for pad in model.pads:
        total += pad.energy(float(at[model.index[pad.upper]] - at[model.index[pad.lower]]) - pad.position_m)
    return total
