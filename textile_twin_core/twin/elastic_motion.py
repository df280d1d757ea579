"""Outputs of a machine with an elastic shaft from the motion of its chain."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.machine import Machine, ShaftPlace
from textile_twin_core.machine.elastic_outputs import (
    ACCELERATION,
    ANGLE,
    LAG,
    PARTS,
    PIECE_TORQUE,
    PLACED,
    POSITION,
    SPEED,
    SPREAD,
    SUMS,
    ElasticOutput,
    elastic_outputs,
)
from textile_twin_core.shaft.states import INFLATION, ShaftStates
from textile_twin_core.shaft.status import STATE
from textile_twin_core.shaft.turns import TURN
from textile_twin_core.twin.compiled import InstantPredictor, Twin, windings

BALANCING = "balancing_torque_Nm"
_INERTIAL = "torque_inertial_Nm"

_INFLATION = np.outer(INFLATION, INFLATION).reshape(9)


@dataclass(frozen=True)
class ElasticMotion:
    """Motion of every station at n samples.

    states: (n,) of the encoder's station. theta_rad, omega_rad_s, alpha_rad_s2: (n, stations), reduced to the main
    shaft and counted from the whole turns of `states`. pieces_Nm: (n, pieces), each behind its gear.
    """

    states: ShaftStates
    theta_rad: FloatArray
    omega_rad_s: FloatArray
    alpha_rad_s2: FloatArray
    pieces_Nm: FloatArray

    def station(self, number: int) -> ShaftStates:
        """(n,) states of a station, with the covariance of the encoder's."""
        rows = self.states.rows.copy()
        set_angle(rows, self.theta_rad[:, number], rows["turns"])
        rows["speed"], rows["acceleration"] = self.omega_rad_s[:, number], self.alpha_rad_s2[:, number]
        return ShaftStates(self.states.stamps, rows)


def set_angle(rows: np.ndarray, angle: FloatArray, turns: FloatArray) -> None:
    """Write angles [rad] beyond whole turns as phase and turns."""
    whole = np.floor(angle / TURN + 0.5)
    rows["phase"], rows["turns"] = angle - whole * TURN, turns + whole


def state_rows(covariance: FloatArray) -> np.ndarray:
    """(n,) rows of STATE with a covariance (n, 9) of angle, speed and acceleration."""
    rows = np.zeros(len(covariance), STATE)
    rows["covariance"] = covariance / _INFLATION
    return rows


class ElasticOutputs:
    """The outputs by name from the motion of a chain.

    The usual outputs speak of the first linkage at its own station, the torque of the piece whose torque the sensor
    shows; sums over linkages take each at its own station.
    """

    def __init__(self, machine: Machine, names: tuple[str, ...]) -> None:
        self.machine, self.names = machine, names
        self._elastic = {name: output for name, output in elastic_outputs(machine).items() if name in names}
        self.of_the_shaft = tuple(self._elastic)
        """Names that only an elastic shaft has."""
        self._sums = tuple(name for name in SUMS if name in names or (_INERTIAL in names and name in PARTS))
        apart = {*self._elastic, *self._sums, BALANCING, _INERTIAL}
        self._usual = tuple(name for name in names if name not in apart)
        self._first, self._lone = machine.linkages[0], replace(machine, shaft=None, linkages=(ShaftPlace(),))
        shaft = machine.shaft
        assert shaft is not None
        self._stations = [shaft.station(place.at, "at") for place in machine.linkages]
        placed = {name: output for name, output in self._elastic.items() if output.kind == PLACED}
        self._elastic = {name: output for name, output in self._elastic.items() if name not in placed}
        numbers = sorted({output.number for output in placed.values()})
        self._placed = [(name, out.of_linkage, numbers.index(out.number)) for name, out in placed.items()]
        self._placed_at = (
            np.array([self._stations[k] for k in numbers], dtype=np.int64),
            np.array([machine.linkages[k].phase_rad for k in numbers]),
        )
        first = self._stations[0]
        self._ratios = np.array(shaft.speed_ratios) / shaft.speed_ratios[first]
        if machine.missing_for_torque and (self._sums or BALANCING in names):
            _ = machine.model.output(BALANCING)  # says what is missing
        _ = self._twin  # so a wrong output is refused at once

    @cached_property
    def _twin(self) -> Twin:
        """The first linkage alone."""
        machine = replace(self._lone, linkages=(ShaftPlace(self._first.phase_rad),))
        return Twin(machine, self._usual, "exact", machine.scene.tolerance)

    @cached_property
    def _predictor(self) -> InstantPredictor:
        return InstantPredictor(self._twin)

    @cached_property
    def _sum_twins(self) -> tuple[Twin, Twin]:
        """One linkage with all that acts on the shaft itself, and two."""
        two = replace(self._lone, linkages=(ShaftPlace(), ShaftPlace()))
        return tuple(Twin(m, self._sums, "exact", m.scene.tolerance) for m in (self._lone, two))  # type: ignore[return-value]

    def at(self, motion: ElasticMotion) -> dict[str, FloatArray]:
        """(n,) outputs by name."""
        found = self._predictor.predict(motion.station(self._stations[0])).outputs if self._usual else {}
        sums = self._summed(motion) if self._sums else {}
        shaft = self.machine.shaft
        assert shaft is not None
        piece, sign = shaft.torque_piece
        found[BALANCING] = sign * motion.pieces_Nm[:, piece]
        found |= sums
        if _INERTIAL in self.names:
            found[_INERTIAL] = found[BALANCING] - sum(sums[part] for part in PARTS)
        found |= self._placed_outputs(motion) if self._placed else {}
        by_station = self._by_station(motion) if self._elastic else {}
        for name, output in self._elastic.items():
            rows = by_station.get(output.kind)
            found[name] = self._elastic_output(output, motion) if rows is None else rows[output.number]
        return {name: found[name] for name in self.names}

    def _summed(self, motion: ElasticMotion) -> dict[str, FloatArray]:
        total = {name: np.zeros(len(motion.states)) for name in self._sums}
        one, two = self._sum_twins
        for k, (place, station) in enumerate(zip(self.machine.linkages, self._stations, strict=True)):
            columns = (motion.theta_rad, motion.omega_rad_s, motion.alpha_rad_s2)
            theta, omega, alpha = (np.ascontiguousarray(each[:, station]) for each in columns)
            alone = one.evaluate(theta + place.phase_rad, omega, alpha)
            both = two.evaluate(theta + place.phase_rad, omega, alpha) if k else alone
            for name in self._sums:
                total[name] += both[name] - alone[name] if k else alone[name]
        return total

    def _by_station(self, motion: ElasticMotion) -> dict[str, FloatArray]:
        """(stations, n) quantities of the stations, behind their gears."""
        return {
            ANGLE: (self._ratios * (motion.theta_rad + (TURN * motion.states.turns)[:, None])).T,
            SPEED: (self._ratios * motion.omega_rad_s).T,
            ACCELERATION: (self._ratios * motion.alpha_rad_s2).T,
        }

    def _elastic_output(self, output: ElasticOutput, motion: ElasticMotion) -> FloatArray:
        if output.kind == PIECE_TORQUE:
            return motion.pieces_Nm[:, output.number]
        encoder = motion.states.phase_rad
        if output.kind == POSITION:
            return self._position(output, motion.theta_rad[:, self._stations[output.number]], output.number)
        if output.kind == LAG:
            return np.asarray(encoder - motion.theta_rad[:, max(self._stations)])
        if output.kind == SPREAD:
            off = [
                self._position(output, motion.theta_rad[:, station], k) - self._position(output, encoder, k)
                for k, station in enumerate(self._stations)
            ]
            return np.asarray(np.max(off, axis=0) - np.min(off, axis=0))
        return np.asarray(motion.theta_rad[:, 0] - motion.theta_rad[:, -1])

    def _placed_outputs(self, motion: ElasticMotion) -> dict[str, FloatArray]:
        """(n,) outputs of single linkages, each at its own station: all linkages in one evaluation."""
        stations, phases = self._placed_at
        theta = np.ravel(motion.theta_rad[:, stations] + phases)
        values = self._placed_twin.evaluate(
            theta, np.ravel(motion.omega_rad_s[:, stations]), np.ravel(motion.alpha_rad_s2[:, stations])
        )
        columns = {name: value.reshape(-1, stations.size).T for name, value in values.items()}
        for name, winding in self._placed_windings.items():
            columns[name] = columns[name] + winding * motion.states.turns
        return {name: columns[of_linkage][k] for name, of_linkage, k in self._placed}

    @cached_property
    def _placed_twin(self) -> Twin:
        names = tuple(dict.fromkeys(of_linkage for _, of_linkage, _ in self._placed))
        return Twin(self._lone, names, "exact", self._lone.scene.tolerance)

    @cached_property
    def _placed_windings(self) -> dict[str, float]:
        return windings(self._placed_twin)

    def _position(self, output: ElasticOutput, angle: FloatArray, linkage: int) -> FloatArray:
        """(n,) a measure of one linkage at shaft angles [m]."""
        if output.measure not in self._positions:
            names = (f"{output.measure}_position_m",)
            self._positions[output.measure] = Twin(self._lone, names, "exact", self._lone.scene.tolerance)
        theta = np.ascontiguousarray(angle + self.machine.linkages[linkage].phase_rad)
        (found,) = self._positions[output.measure].evaluate(theta, 0.0 * theta, 0.0 * theta).values()
        return np.asarray(found)

    @cached_property
    def _positions(self) -> dict[str, Twin]:
        return {}
