"""Predictions of a machine with an elastic shaft: its observer, fed with the readings that an estimator accepts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.driveline import ElasticShaft
from textile_twin_core.driveline.observer import Observed, ShaftObserver
from textile_twin_core.driveline.observer_step import ShaftReadings, shaft_readings
from textile_twin_core.machine.main_shaft import ShaftDrive
from textile_twin_core.shaft import OneState, ShaftStates
from textile_twin_core.shaft.status import Records
from textile_twin_core.twin.elastic_motion import ElasticMotion, ElasticOutputs, set_angle, state_rows
from textile_twin_core.twin.predictor import Prediction, Predictor
from textile_twin_core.twin.second_readings import SecondReadings

_KEPT = np.dtype(
    [
        (name, np.float64)
        for name in ("step", "reading", "unit", "noise", "cut", "settled", "angle", "speed", "acceleration", "origin")
    ]
    + [("index", np.float64), ("covariance", np.float64, (9,))]
)
"""What the observer needs of a row of the shaft estimator."""


class ElasticPredictor(Predictor):
    """The observer's predictions.

    Args:
        elastic: The chain.
        observer: Its observer, before the first reading.
        results: What is asked for.
        twice: Hold all readings until `finish`, and observe them twice: the second time with what the first has learnt
            of the drive.
    """

    at_once = False
    estimator = "causal"

    def __init__(self, elastic: ElasticShaft, observer: ShaftObserver, results: ElasticOutputs, twice: bool) -> None:
        self._elastic, self._observer, self._results, self._twice = elastic, observer, results, twice
        self._held: list[tuple[np.ndarray, Records]] = []
        self._second = SecondReadings()

    def with_outputs(self, results: ElasticOutputs) -> ElasticPredictor:
        """The same observer, asked for other outputs."""
        self._results = results
        return self

    @property
    def drive(self) -> ShaftDrive:
        """The drive with inertia and slip, given or estimated so far."""
        observer = self._observer
        return replace(
            self._elastic.shaft.drive,
            inertia_kgm2=observer.drive_inertia_kgm2,
            slip_Nms_rad=max(observer.drive_slip_Nms_rad, 0.0),
        )

    def predict(self, states: ShaftStates) -> Prediction:
        """Predictions of the observer for the readings behind the estimated states."""
        if self._twice and len(states):
            self._held.append((states.stamps, _kept(states.rows)))
            states = ShaftStates.empty(states.stamps)
        if len(states) == 0:
            return Prediction(states, {name: np.empty(0) for name in self._results.names}, np.empty(0))
        return self._observed(states.stamps, states.rows, self._readings(states.stamps, states.rows))

    def take_second(self, stamps: np.ndarray, angles: FloatArray) -> None:
        """Take readings of the second encoder, before the states that they belong to."""
        self._second.take(stamps, angles)

    def finish(self, states: ShaftStates) -> Prediction:
        """Predictions for the waiting readings, with these at the end."""
        prediction = self.predict(states)
        if self._held:
            stamps, rows = (np.concatenate(parts) for parts in zip(*self._held, strict=True))
            self._held = []
            readings = self._readings(stamps, rows)
            self._observer.take(readings)
            self._observer.repeat()
            prediction = self._observed(stamps, rows, readings)
        self._observer.restart()
        return prediction

    def predict_one(self, stamp: int | float, state: OneState, sense_known: bool) -> dict[str, float]:
        """Not for an observer, which needs the reading."""
        raise NotImplementedError("an observer predicts from readings, not from states")

    def restart(self) -> None:
        """Begin another record; the estimate of the drive remains."""
        self._second.restart()

    def reset(self) -> None:
        """Forget all readings and the estimate of the drive."""
        self._held = []
        self._second.reset()
        self._observer.reset()

    def _readings(self, stamps: np.ndarray, rows: Records) -> ShaftReadings:
        return shaft_readings(rows, *self._second.at(stamps, rows["origin"]))

    def _observed(self, stamps: np.ndarray, rows: Records, readings: ShaftReadings) -> Prediction:
        observed = self._observer.take(readings)
        motion = self._motion(stamps, rows, observed)
        piece, _ = self._elastic.shaft.torque_piece
        sigma = observed.found["sigma"] / abs(self._elastic.ratios[piece + 1])
        return Prediction(motion.states, self._results.at(motion), np.asarray(sigma))

    def _motion(self, stamps: np.ndarray, rows: Records, observed: Observed) -> ElasticMotion:
        found, motion = observed.found, observed.motion
        states = state_rows(found["covariance"])
        set_angle(states, found["angle"], rows["origin"])
        states["speed"], states["acceleration"] = found["speed"], found["acceleration"]
        states["settled"], states["index"] = found["settled"], rows["index"]
        encoder = self._elastic.shaft.encoder_station
        theta: FloatArray = states["phase"][:, None] + motion.psi - motion.psi[:, encoder : encoder + 1]
        pieces = self._elastic.piece_torques(motion.pieces)
        return ElasticMotion(ShaftStates(stamps, states), theta, motion.omega, motion.alpha, pieces)


def _kept(rows: Records) -> Records:
    """Columns of rows for the observer."""
    found = np.zeros(len(rows), _KEPT)
    for name in _KEPT.names or ():
        found[name] = rows[name]
    return found
