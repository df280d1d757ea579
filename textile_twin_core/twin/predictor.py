"""Protocols between a session and its twin, and the records that they exchange."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.contact import ContactEvent
from textile_twin_core.machine import AnyMachine
from textile_twin_core.machine.sensitivity import TorqueSensitivity
from textile_twin_core.shaft import OneState, ShaftStates


class StampedEvent(NamedTuple):
    """Impact or touch with its time on the clock of the samples: int [ns] or float [s]."""

    stamp: int | float
    event: ContactEvent


_SHOWN = 4
"""Number of output names in a text."""


def names_text(names: Sequence[str]) -> str:
    """Format the first names and the number of further ones."""
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return f"{', '.join(names[:_SHOWN])}{more}"


def twin_text(kind: str, machine: str, outputs: Sequence[str], method: str) -> str:
    """Format the repr of a twin."""
    return f"<{kind} of '{machine}', {method}: {names_text(outputs)}>"


class Prediction(NamedTuple):
    """Outputs at estimated shaft states.

    Attributes:
        states: (n,) estimated states, or states of a shaft model driven by them.
        outputs: (n,) arrays by name.
        uncertainty: (n,) sigma of the torque [N m], or the sensitivity of the torque to the state; None without
            a torque.
    """

    states: ShaftStates
    outputs: dict[str, FloatArray]
    uncertainty: TorqueSensitivity | FloatArray | None


class Predictor(Protocol):
    """Converter of shaft states, in their order, into outputs."""

    @property
    def at_once(self) -> bool:
        """True if `predict_one` may be called."""
        ...

    @property
    def estimator(self) -> str | None:
        """Only shaft estimator that the predictor accepts; None for any."""
        ...

    def predict(self, states: ShaftStates) -> Prediction:
        """Predict the outputs at states."""
        ...

    def finish(self, states: ShaftStates) -> Prediction:
        """Predict the outputs at the last states of a record and at all states not predicted yet."""
        ...

    def predict_one(self, stamp: int | float, state: OneState, sense_known: bool) -> dict[str, float]:
        """Predict the outputs at one state; `sense_known` is true if it determines the sense of rotation (see
        `sense`).
        """
        ...

    def take_events(self) -> Sequence[StampedEvent]:
        """Remove and return the events since the last call; empty without a history."""
        ...

    def restart(self) -> None:
        """Begin another record on stamps that were set back; call it after `finish`."""
        ...

    def reset(self) -> None:
        """Reset the state."""
        ...


@runtime_checkable
class SecondEncoderPredictor(Protocol):
    """Predictor that uses a second encoder."""

    def take_second(self, stamps: np.ndarray, angles: FloatArray) -> None:
        """Take its readings: (n,) stamps and angles [rad], reduced to the main shaft."""
        ...


class AnyTwin(Protocol):
    """Machine compiled for its outputs, with or without a history."""

    @property
    def machine(self) -> AnyMachine:
        """Machine of the twin."""
        ...

    @property
    def events(self) -> Sequence[ContactEvent]:
        """Impacts and touches of the last `evaluate`; empty without a history."""
        ...

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
        ...

    def predictor(self, shaft: str = "causal", before: Predictor | None = None) -> Predictor:
        """Create the predictor for a shaft estimator; `before` is a predictor whose state continues."""
        ...
