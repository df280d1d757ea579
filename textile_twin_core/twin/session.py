"""Session: what lives between samples. Angle samples go in, in blocks of any size; predictions come out."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import repeat
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray
from textile_twin_core.errors import SceneError
from textile_twin_core.machine.sensitivity import TorqueSensitivity
from textile_twin_core.machine.sensors import Encoder
from textile_twin_core.shaft import SampleReport, ShaftStates, create_estimator
from textile_twin_core.shaft.turns import TURN, TURN_TAIL
from textile_twin_core.twin.predictor import AnyTwin, Predictor, StampedEvent, names_text
from textile_twin_core.twin.sense import SENSE_SIGMAS

_PIECE = 65_536
"""Samples whose covariances are copied at a time: those of an hour would take as much memory as all else."""


class Sample(NamedTuple):
    """The prediction at one accepted sample, in plain numbers."""

    stamp: Any
    """as it came in: int [ns] or float [s]"""
    theta_rad: float
    omega_rad_s: float
    alpha_rad_s2: float
    torque_sigma_Nm: float
    """NaN where it was not asked for"""
    outputs: Mapping[str, float]


@dataclass(frozen=True)
class Samples:
    """Predictions at accepted samples, each with its sample's own stamp.

    states: the shaft's estimated states (stamps, index, omega_rad_s, alpha_rad_s2, covariance, settled).
    outputs: (n,) arrays by output name.
    """

    states: ShaftStates
    outputs: Mapping[str, FloatArray]
    _uncertainty: TorqueSensitivity | FloatArray | None

    def __getstate__(self) -> dict[str, Any]:
        # A sensitivity is compiled and belongs to its process; its result goes along.
        return {**self.__dict__, "torque_sigma_Nm": self.torque_sigma_Nm, "_uncertainty": None}

    def __repr__(self) -> str:
        return f"<Samples: {len(self)}, {_span_text(self.stamps)}; outputs {names_text(tuple(self.outputs))}>"

    def __len__(self) -> int:
        return len(self.states)

    def __getitem__(self, name: str) -> FloatArray:
        return self.outputs[name]

    @property
    def stamps(self) -> FloatArray | IntArray:
        """(n,) stamps as they came in."""
        return self.states.stamps

    @property
    def index(self) -> IntArray:
        """(n,) running number of the input sample, from 0."""
        return self.states.index

    @property
    def theta_rad(self) -> FloatArray:
        """(n,) shaft angle, unwrapped [rad]."""
        return self.states.theta_rad

    @property
    def omega_rad_s(self) -> FloatArray:
        """(n,) shaft speed [rad/s]."""
        return self.states.omega_rad_s

    @property
    def alpha_rad_s2(self) -> FloatArray:
        """(n,) shaft acceleration [rad/s^2]."""
        return self.states.alpha_rad_s2

    @property
    def settled(self) -> BoolArray:
        """(n,) whether the estimator had settled."""
        return self.states.settled

    def rows(self, sigma: bool = False) -> Iterator[Sample]:
        """The samples one by one; `sigma`: with that of the torque."""
        names = tuple(self.outputs)
        columns = zip(*(self.outputs[name].tolist() for name in names), strict=True) if names else repeat(())
        sigmas = self.torque_sigma_Nm.tolist() if sigma else repeat(math.nan)
        states = (self.stamps, self.theta_rad, self.omega_rad_s, self.alpha_rad_s2)
        for stamp, theta, omega, alpha, deviation, values in zip(
            *(column.tolist() for column in states), sigmas, columns, strict=False
        ):
            yield Sample(stamp, theta, omega, alpha, deviation, dict(zip(names, values, strict=True)))

    @cached_property
    def torque_sigma_Nm(self) -> FloatArray:
        """(n,) standard deviation of the balancing torque that follows from the shaft state's [N m].

        NaN for a machine without a torque.
        """
        if self._uncertainty is None:
            return np.full(len(self), math.nan)
        if isinstance(self._uncertainty, np.ndarray):
            return self._uncertainty
        sigma, states = np.empty(len(self)), self.states
        for first in range(0, len(self), _PIECE):
            piece = slice(first, first + _PIECE)
            part = ShaftStates(states.stamps[piece], states.rows[piece])
            gradient = self._uncertainty.gradient(part.phase_rad, part.omega_rad_s, part.alpha_rad_s2)
            sigma[piece] = np.sqrt(np.maximum(part.variance_of(gradient), 0.0))
        return sigma


def encoder_settings(encoder: Encoder) -> dict[str, Any]:
    """What a shaft estimator can be told of an encoder, in shaft angle."""
    step = encoder.resolution_rad
    return {
        "period_rad": 2.0 * math.pi * encoder.ratio,  # one turn of the encoder
        "resolution_rad": None if step is None else step * encoder.ratio,
        "stamp_jitter_s": encoder.stamp_jitter_s,
        "teeth": encoder.teeth,
        "tooth_zero_rad": -encoder.zero_rad * encoder.direction * encoder.ratio,
        "pitch_errors_rad": encoder.pitch_errors_rad,
        "cycle_turns": encoder.cycle_turns,
    }


def _span_text(stamps: FloatArray | IntArray) -> str:
    """From when to when; stamps are seconds, or whole numbers of nanoseconds."""
    if not len(stamps):
        return "no time"
    unit = 1e-9 if np.issubdtype(np.asarray(stamps).dtype, np.integer) else 1.0
    return f"{float(stamps[0]) * unit:.3f} to {float(stamps[-1]) * unit:.3f} s"


class Session:
    """A twin that is fed with angle samples of its encoder."""

    def __init__(self, twin: AnyTwin, shaft: str, **settings: Any) -> None:
        self.twin, self.shaft = twin, shaft
        self._encoder = twin.machine.sensors.encoder
        self._factor = self._encoder.direction * self._encoder.ratio
        self._estimator = create_estimator(shaft, **(encoder_settings(self._encoder) | settings))
        self._predictor = twin.predictor(shaft)
        if self._predictor.estimator is not None:
            settings.pop("shaft_lag_s", None)
            self._estimator = create_estimator(
                self._predictor.estimator, **(encoder_settings(self._encoder) | settings)
            )

    def __repr__(self) -> str:
        return f"<Session of {self.twin!r}, shaft '{self.shaft}', {self.report.text()}>"

    @property
    def predictor(self) -> Predictor:
        """What predicts from the shaft's states."""
        return self._predictor

    @property
    def report(self) -> SampleReport:
        """Counts of samples accepted and rejected, and the estimator's state."""
        return self._estimator.report

    @property
    def at_once(self) -> bool:
        """Whether samples one by one cost less than a block of them."""
        return self._predictor.at_once and self._estimator.at_once

    def step(self, stamps: npt.ArrayLike, angles: npt.ArrayLike, velocities: npt.ArrayLike | None = None) -> Samples:
        """Take angle samples and predict.

        stamps: integers [ns] or floats [s]; angles [rad] as the encoder measures them, wrapped or not;
        velocities [rad/s] where the encoder gives them. From the third accepted sample on,
        each accepted sample gets one prediction (with estimators that look ahead: later, or from `finish`).
        """
        angle = (np.asarray(angles, dtype=np.float64) - self._encoder.zero_rad) * self._factor
        velocity = None if velocities is None else np.asarray(velocities, dtype=np.float64) * self._factor
        return self._predict(self._estimator.step(stamps, angle, velocity))

    def step_one(
        self, stamp: int | float, angle: float, velocity: float | None = None, sigma: bool = False
    ) -> Sequence[Sample]:
        """What `step` gives for one sample, without arrays of results: what a live sample takes.

        stamp: [ns], or [s] as a float; angle [rad]; velocity [rad/s] where the encoder gives one; `sigma`: with that
        of the torque. The predictions that are known now, in their order.
        """
        angle = (angle - self._encoder.zero_rad) * self._factor
        velocity = math.nan if velocity is None else velocity * self._factor
        if sigma or not (self._predictor.at_once and self._estimator.serves_one(stamp)):
            states = self._estimator.step(np.array((stamp,)), np.array((angle,)), np.array((velocity,)))
            return tuple(self._predict(states).rows(sigma)) if len(states) else ()
        state = self._estimator.step_one(int(stamp), angle, velocity)
        if state is None:
            return ()
        phase, omega, alpha, turns = state
        theta = turns * TURN + (turns * TURN_TAIL + phase)  # as join_turns
        known = abs(omega) > SENSE_SIGMAS * self._estimator.omega_sigma_rad_s
        outputs = self._predictor.predict_one(stamp, state, known)
        return (Sample(stamp, theta, omega, alpha, math.nan, outputs),)

    def take_events(self) -> Sequence[StampedEvent]:
        """Impacts and touches of a machine with a history since the last time; they are kept until they are taken."""
        return self._predictor.take_events()

    def use(self, twin: AnyTwin) -> None:
        """Go on with another twin of the same machine: other outputs, the shaft's state is kept.

        Raises SceneError for a twin of another machine.
        """
        if twin.machine is not self.twin.machine and twin.machine != self.twin.machine:
            raise SceneError(
                f"the session is of machine '{self.twin.machine.name}', and the twin of a '{twin.machine.name}' that"
                " differs from it; open a session of its own"
            )
        self.twin = twin
        self._predictor = twin.predictor(self.shaft, self._predictor)

    def finish(self) -> Samples:
        """Predictions for the samples that the estimator still holds."""
        return Samples(*self._predictor.finish(self._estimator.finish()))

    def reset(self) -> None:
        """Forget everything."""
        self._estimator.reset()
        self._predictor.reset()

    def _predict(self, states: ShaftStates) -> Samples:
        return Samples(*self._predictor.predict(states))
