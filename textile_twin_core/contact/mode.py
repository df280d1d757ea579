"""A mode of contact: which stops are closed, and the equations of motion that are left in it."""

from __future__ import annotations

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.contact.forces import LinearForces
from textile_twin_core.contact.model import ContactError, ContactModel


class Mode:
    """Bodies joined by closed stops move as one: x_bodies = spread @ q + driven x_drive + offset.

    Clusters without driven element or frame keep a coordinate q each, whose equation is
    q'' = -stiffness q - damping q' + by_position x_drive + by_velocity v_drive + constant (+ pads).
    Raises ContactError when closed stops tie the driven element to the frame.
    """

    def __init__(self, model: ContactModel, forces: LinearForces, closed: frozenset[int]) -> None:
        self.model = model
        self.forces = forces
        self.closed = tuple(sorted(closed))
        bodies = len(model.bodies)
        cluster, offset = self._clusters(bodies)
        free = sorted({c for c in cluster[:bodies] if c not in (cluster[bodies], cluster[bodies + 1])})
        self.spread = np.zeros((bodies, len(free)))
        self.driven = np.zeros(bodies)
        self.offset = np.zeros(bodies)
        for body in range(bodies):
            if cluster[body] == cluster[bodies]:
                self.driven[body] = 1.0
                self.offset[body] = offset[body] - offset[bodies]
            elif cluster[body] == cluster[bodies + 1]:
                self.offset[body] = offset[body] - offset[bodies + 1]
            else:
                column = free.index(cluster[body])
                self.spread[body, column] = 1.0
                self.offset[body] = offset[body] - offset[free[column]]
        weights = self.spread * forces.masses[:, None]
        self.cluster_mass = weights.sum(axis=0)
        self.average = (weights / self.cluster_mass).T if free else weights.T
        self._reduce()
        self.stop_normals = np.zeros((bodies, len(self.closed)))
        for column, stop in enumerate(self.closed):
            for end, sign in ((model.stops[stop].upper, -1.0), (model.stops[stop].lower, 1.0)):
                if model.index[end] < bodies:
                    self.stop_normals[model.index[end], column] = sign
        self.from_residual = np.linalg.pinv(self.stop_normals)

    def _clusters(self, bodies: int) -> tuple[list[int], list[float]]:
        """Cluster number of every end (its smallest row) and its distance from the cluster's first end."""
        model = self.model
        cluster = list(range(bodies + 2))
        offset = [0.0] * (bodies + 2)
        for number in self.closed:
            stop = model.stops[number]
            upper, lower = model.index[stop.upper], model.index[stop.lower]
            keep, merge = sorted((cluster[upper], cluster[lower]))
            if keep == merge:
                continue
            shift = offset[lower] + stop.limit_m - offset[upper]
            if cluster[upper] == keep:
                shift = -shift
            for end in range(bodies + 2):
                if cluster[end] == merge:
                    cluster[end] = keep
                    offset[end] += shift
        if cluster[bodies] == cluster[bodies + 1]:
            names = ", ".join(model.stops[k].name for k in self.closed)
            raise ContactError(
                f"closed stops ({names}) tie the driven element to the frame: nothing can give way; "
                "set the limits so that a spring or pad stands between them"
            )
        return cluster, offset

    def _reduce(self) -> None:
        bodies = len(self.model.bodies)
        project = (self.spread / self.cluster_mass).T if self.cluster_mass.size else self.spread.T
        rows_k, rows_b = self.forces.stiffness[:bodies], self.forces.damping[:bodies]
        self.stiffness = project @ rows_k[:, :bodies] @ self.spread
        self.damping = project @ rows_b[:, :bodies] @ self.spread
        self.by_position = -project @ (rows_k[:, :bodies] @ self.driven + rows_k[:, bodies])
        self.by_velocity = -project @ (rows_b[:, :bodies] @ self.driven + rows_b[:, bodies])
        self.constant = project @ (self.forces.constant[:bodies] - rows_k[:, :bodies] @ self.offset)

    @property
    def size(self) -> int:
        """Number of coordinates that are left."""
        return int(self.spread.shape[1])

    def coordinates(self, positions: FloatArray, velocities: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Cluster coordinates and speeds (mass-weighted, so that momentum stays) from those of the bodies."""
        return self.average @ (positions - self.offset), self.average @ velocities

    def movers(self, coordinates: FloatArray, drive: FloatArray) -> FloatArray:
        """Power series (movers, order+1) of every mover from those of the coordinates (size, order+1) and the drive."""
        bodies = self.spread @ coordinates + self.driven[:, None] * drive
        bodies[:, 0] += self.offset
        return np.vstack((bodies, drive))

    def stop_forces(self, series: FloatArray, span_s: float, other: FloatArray) -> FloatArray:
        """Power series (closed, order-1) of the force in every closed stop, from the movers' series.

        `other` (bodies, order-1) holds the forces that are not linear (pads).
        """
        order = series.shape[1] - 1
        velocity = derivative(series) / span_s
        acceleration = derivative(velocity) / span_s
        bodies = len(self.model.bodies)
        linear = self.forces.on_movers(series[:, : order - 1], velocity[:, : order - 1])[:bodies]
        residual = self.forces.masses[:, None] * acceleration[:bodies] - linear - other
        return np.asarray(self.from_residual @ residual)


def derivative(series: FloatArray) -> FloatArray:
    """Power series of d/du, one order shorter, along the last axis."""
    return series[..., 1:] * np.arange(1.0, series.shape[-1])
