"""Session: state between samples. Angle samples enter in blocks of any size; predictions come out.

Nodes and recordings use the same `Session`, made by the `session` method of a twin. One thread at a time may use a
session. tests/twin/test_session.py compares blocks of any size with single samples.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import repeat
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray
from textile_twin_core.contact import ContactEvent
from textile_twin_core.errors import SceneError
from textile_twin_core.machine import AnyMachine, Machine
from textile_twin_core.machine.sensitivity import TorqueSensitivity
from textile_twin_core.machine.sensors import Encoder
from textile_twin_core.shaft import SampleReport, ShaftStates, create_estimator
from textile_twin_core.shaft.turns import TURN, TURN_TAIL
from textile_twin_core.twin.predictor import Predictor, StampedEvent, names_text
from textile_twin_core.twin.restart import RestartWatch
from textile_twin_core.twin.sense import SENSE_SIGMAS

_PIECE = 65_536
"""Samples per copy of covariances, to bound the memory of long recordings."""


class Sample(NamedTuple):
    """Prediction at one accepted sample, as plain numbers."""

    stamp: Any
    """Stamp of the input sample: int [ns] or float [s]."""
    theta_rad: float
    omega_rad_s: float
    alpha_rad_s2: float
    torque_sigma_Nm: float
    """Standard deviation of the torque; NaN unless requested."""
    outputs: Mapping[str, float]


@dataclass(frozen=True)
class Samples:
    """Predictions at accepted samples, each with the stamp of its sample.

    Attributes:
        states: Estimated states of the shaft (stamps, index, omega_rad_s, alpha_rad_s2, covariance, settled).
        outputs: (n,) arrays by output name, which ends with the unit.

    Examples:
        >>> import textile_twin_core as ttc
        >>> session = ttc.compile(ttc.machines.tufting(), ["balancing_torque_Nm"]).session()
        >>> samples = session.step([0, 2_000_000, 4_000_000], [0.00, 0.03, 0.06])  # stamps [ns], angles [rad]
        >>> len(samples), samples["balancing_torque_Nm"].shape
        (1, (1,))
    """

    states: ShaftStates
    outputs: Mapping[str, FloatArray]
    _uncertainty: TorqueSensitivity | FloatArray | None

    def __getstate__(self) -> dict[str, Any]:
        # A compiled sensitivity belongs to its process, so its result is stored instead.
        return {**self.__dict__, "torque_sigma_Nm": self.torque_sigma_Nm, "_uncertainty": None}

    def __repr__(self) -> str:
        return f"<Samples: {len(self)}, {_span_text(self.stamps)}; outputs {names_text(tuple(self.outputs))}>"

    def __len__(self) -> int:
        return len(self.states)

    def __getitem__(self, name: str) -> FloatArray:
        return self.outputs[name]

    @property
    def stamps(self) -> FloatArray | IntArray:
        """(n,) stamps of the input samples."""
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
        """(n,) true where the estimator has converged."""
        return self.states.settled

    def rows(self, sigma: bool = False) -> Iterator[Sample]:
        """Iterate over single samples; `sigma` adds the standard deviation of the torque."""
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
        """(n,) standard deviation of the balancing torque, propagated from the state of the shaft [N m].

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

    @classmethod
    def join(cls, parts: Sequence[Samples]) -> Samples:
        """Concatenate predictions of one session."""
        states = ShaftStates.join([part.states for part in parts])
        outputs = {name: np.concatenate([part[name] for part in parts]) for name in parts[0].outputs}
        uncertainty = parts[0]._uncertainty
        if isinstance(uncertainty, np.ndarray):
            uncertainty = np.concatenate([part.torque_sigma_Nm for part in parts])
        return cls(states, outputs, uncertainty)


def encoder_settings(encoder: Encoder) -> dict[str, Any]:
    """Return the settings of a shaft estimator for an encoder, in terms of the shaft angle."""
    step = encoder.resolution_rad
    return {
        "period_rad": 2.0 * math.pi * encoder.ratio,  # one turn of the encoder
        "resolution_rad": None if step is None else step * encoder.ratio,
        "stamp_jitter_s": encoder.stamp_jitter_s,
        "teeth": encoder.teeth,
        "tooth_zero_rad": -encoder.zero_rad * encoder.factor,
        "pitch_errors_rad": encoder.pitch_errors_rad,
        "cycle_turns": encoder.cycle_turns,
        "reading_at": encoder.reading_at if encoder.is_corrected else None,
    }


def has_second_encoder(machine: AnyMachine) -> bool:
    """True for a machine with a second encoder on its elastic shaft."""
    return isinstance(machine, Machine) and machine.shaft is not None and machine.shaft.second_encoder_at is not None


def _span_text(stamps: FloatArray | IntArray) -> str:
    """Format the time span; stamps are seconds, or integers in nanoseconds."""
    if not len(stamps):
        return "no time"
    unit = 1e-9 if np.issubdtype(np.asarray(stamps).dtype, np.integer) else 1.0
    return f"{float(stamps[0]) * unit:.3f} to {float(stamps[-1]) * unit:.3f} s"


class AnyTwin(ABC):
    """Machine compiled for its outputs, with or without a history.

    Attributes:
        events: Impacts and touches of the last `evaluate`; empty without a history.
    """

    machine: AnyMachine
    outputs: tuple[str, ...]
    method: str
    events: Sequence[ContactEvent] = ()

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of '{self.machine.name}', {self.method}: {names_text(self.outputs)}>"

    @abstractmethod
    def evaluate(
        self,
        theta: float | FloatArray,
        omega: float | FloatArray = 0.0,
        alpha: float | FloatArray = 0.0,
        *,
        time: float | FloatArray | None = None,
        out: Mapping[str, FloatArray] | None = None,
    ) -> dict[str, Any]:
        """Return the outputs by name at shaft states; only a machine with a history needs `time`."""

    @abstractmethod
    def predictor(self, shaft: str = "causal", before: Predictor | None = None) -> Predictor:
        """Create the predictor for a shaft estimator; `before` is a predictor whose state continues."""

    def session(self, shaft: str = "causal", **settings: Any) -> Session:
        """Create a session, which takes angle samples and returns predictions, with state between blocks.

        An elastic shaft has an observer in place of `causal` and `lag`; `smooth` observes the whole record twice, the
        second time with the drive and its torque known from the first.

        Args:
            shaft: Shaft estimator: "causal", "lag" or "smooth".
            **settings: Settings of the estimator.

        Raises:
            SceneError: The estimator or a setting is unknown.
        """
        return Session(self, shaft, **settings)


class Session:
    """Session of a twin that takes angle samples of its encoder.

    It keeps all state between samples: blocks of any size give the same predictions. A prediction begins with the third
    accepted sample.

    Args:
        twin: The twin.
        shaft: Estimator of the shaft's motion: `causal`, `lag` or `smooth` (see `create_estimator`).
        **settings: Other arguments of `create_estimator`; a setting overrides that of the machine's encoder.

    Raises:
        SceneError: For an unknown estimator or setting.

    Examples:
        >>> import numpy as np
        >>> import textile_twin_core as ttc
        >>> twin = ttc.compile(ttc.machines.tufting(), ["balancing_torque_Nm"])
        >>> session = twin.session(shaft="causal")
        >>> stamps = np.arange(500) / 500.0  # [s]; integers are [ns]
        >>> samples = session.step(stamps, 16.76 * stamps)  # [rad]
        >>> len(samples)
        498
    """

    def __init__(self, twin: AnyTwin, shaft: str, **settings: Any) -> None:
        self.twin, self.shaft = twin, shaft
        self._encoder = twin.machine.sensors.encoder
        self._estimator = create_estimator(shaft, **(encoder_settings(self._encoder) | settings))
        self._predictor = twin.predictor(shaft)
        self._restarts = RestartWatch()
        # an elastic shaft is observed from causal states in every view; the name `shaft` has been checked above
        if self._predictor.estimator is not None:
            settings.pop("shaft_lag_s", None)
            self._estimator = create_estimator(
                self._predictor.estimator, **(encoder_settings(self._encoder) | settings)
            )

    def __repr__(self) -> str:
        return f"<Session of {self.twin!r}, shaft '{self.shaft}', {self.report.text()}>"

    @property
    def predictor(self) -> Predictor:
        """Predictor that evaluates the states of the shaft."""
        return self._predictor

    @property
    def report(self) -> SampleReport:
        """Counts of accepted and rejected samples, and the state of the estimator."""
        return self._estimator.report

    @property
    def restarts(self) -> int:
        """Number of times that the stamps were set back; each begins another record."""
        return self._restarts.count

    @property
    def at_once(self) -> bool:
        """True if single samples cost less than a block of them."""
        return self._predictor.at_once and self._estimator.at_once

    def step(self, stamps: npt.ArrayLike, angles: npt.ArrayLike, velocities: npt.ArrayLike | None = None) -> Samples:
        """Process angle samples and predict.

        From the third accepted sample on, each accepted sample gets one prediction. Estimators that look ahead return
        it later, or from `finish`. Samples that are not finite or not newer than the last are rejected (see `report`).
        Stamps that were set back by more than a second begin another record, as after `finish`, with the tenth of them.

        Args:
            stamps: (n,) integers [ns] or floats [s].
            angles: (n,) measured angles of the encoder [rad], wrapped or not.
            velocities: (n,) measured speeds [rad/s], where the encoder has them.

        Returns:
            The predictions that are available now.

        Raises:
            MotionError: Arrays of different lengths, or stamps that change between integers and floats.
        """
        stamp = np.asarray(stamps)
        angle = self._encoder.shaft_angle(angles)
        velocity = None if velocities is None else self._encoder.shaft_speed(angles, velocities)
        parts, begin = [], 0
        for place in self._restarts.restarts(stamp):
            before = slice(begin, place)
            known = None if velocity is None else velocity[before]
            parts += [self._predict(self._estimator.step(stamp[before], angle[before], known)), self._begin_record()]
            begin = place
        if not parts:
            return self._predict(self._estimator.step(stamp, angle, velocity))
        known = None if velocity is None else velocity[begin:]
        return Samples.join([*parts, self._predict(self._estimator.step(stamp[begin:], angle[begin:], known))])

    def take_second(self, stamps: npt.ArrayLike, angles: npt.ArrayLike) -> None:
        """Take readings of the second encoder of an elastic shaft; call it before `step`.

        A sample of the first encoder uses the latest reading stamped after the previous sample and not after its own.

        Args:
            stamps: (n,) on the clock of the angle samples, integers [ns] or floats [s].
            angles: (n,) measured angles [rad], wrapped or not.

        Raises:
            SceneError: The machine has no second encoder.
        """
        if not has_second_encoder(self.twin.machine):
            raise SceneError(
                f"machine '{self.twin.machine.name}' has no second encoder: name its station as second_encoder_at"
                " under `shaft`"
            )
        encoder = self.twin.machine.sensors.second_encoder
        self._predictor.take_second(np.asarray(stamps), encoder.shaft_angle(angles))

    def step_one(
        self, stamp: int | float, angle: float, velocity: float | None = None, sigma: bool = False
    ) -> Sequence[Sample]:
        """Process one sample as `step` does, without arrays; made for live samples.

        Args:
            stamp: Integer [ns] or float [s].
            angle: Measured angle of the encoder [rad].
            velocity: Measured speed [rad/s], where the encoder has it.
            sigma: Include the standard deviation of the torque.

        Returns:
            The predictions that are available now, in order.
        """
        if self._restarts.restarted(stamp):
            last = tuple(self._begin_record().rows(sigma))
            return (*last, *self._step_one(stamp, angle, velocity, sigma))
        return self._step_one(stamp, angle, velocity, sigma)

    def _step_one(self, stamp: int | float, angle: float, velocity: float | None, sigma: bool) -> Sequence[Sample]:
        angle, velocity = self._encoder.shaft_reading(angle, math.nan if velocity is None else velocity)
        if sigma or not (self._predictor.at_once and self._estimator.serves_one(stamp)):
            states = self._estimator.step(np.array((stamp,)), np.array((angle,)), np.array((velocity,)))
            return tuple(self._predict(states).rows(sigma)) if len(states) else ()
        state = self._estimator.step_one(int(stamp), angle, velocity)
        if state is None:
            return ()
        phase, omega, alpha, turns = state
        theta = turns * TURN + (turns * TURN_TAIL + phase)  # same as join_turns
        sense_known = abs(omega) > SENSE_SIGMAS * self._estimator.omega_sigma_rad_s
        outputs = self._predictor.predict_one(stamp, state, sense_known)
        return (Sample(stamp, theta, omega, alpha, math.nan, outputs),)

    def take_events(self) -> Sequence[StampedEvent]:
        """Remove and return the impacts and touches since the last call; empty for a machine without contacts."""
        return self._predictor.take_events()

    def use(self, twin: AnyTwin) -> None:
        """Continue with another twin of the same machine, for other outputs; the state of the shaft remains.

        Raises:
            SceneError: The twin is of another machine.
        """
        if twin.machine is not self.twin.machine and twin.machine != self.twin.machine:
            raise SceneError(
                f"the session is of machine '{self.twin.machine.name}', and the twin is of a different machine"
                f" '{twin.machine.name}'; open a new session for it"
            )
        self.twin = twin
        self._predictor = twin.predictor(self.shaft, self._predictor)

    def finish(self) -> Samples:
        """End the record and return the waiting predictions; later samples begin another record in the same report."""
        return Samples(*self._predictor.finish(self._estimator.finish()))

    def _begin_record(self) -> Samples:
        """End the record, as `finish` does, and accept older stamps from here on."""
        last = self.finish()
        self._estimator.forget_newest()
        self._predictor.restart()
        return last

    def reset(self) -> None:
        """Reset everything, the report and the newest stamp included."""
        self._estimator.reset()
        self._predictor.reset()
        self._restarts.reset()

    def _predict(self, states: ShaftStates) -> Samples:
        return Samples(*self._predictor.predict(states))
