"""Predictors of the outputs at shaft states, and the records that they exchange with a session."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.contact import ContactEvent
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


class Predictor(ABC):
    """Converter of shaft states, in their order, into outputs.

    Attributes:
        at_once: True if `predict_one` may be called.
        estimator: Only shaft estimator that the predictor accepts; None for any.
    """

    at_once = True
    estimator: str | None = None

    @abstractmethod
    def predict(self, states: ShaftStates) -> Prediction:
        """Predict the outputs at states."""

    def finish(self, states: ShaftStates) -> Prediction:
        """Predict the outputs at the last states of a record and at all states not predicted yet."""
        return self.predict(states)

    @abstractmethod
    def predict_one(self, stamp: int | float, state: OneState, sense_known: bool) -> dict[str, float]:
        """Predict the outputs at one state; `sense_known` is true if it determines the sense of rotation (see
        `sense`).
        """

    def take_second(self, stamps: np.ndarray, angles: FloatArray) -> None:
        """Take readings of a second encoder: (n,) stamps and angles [rad], before the states that they belong to."""
        raise NotImplementedError("a rigid shaft has no second encoder")

    def take_events(self) -> Sequence[StampedEvent]:
        """Remove and return the events since the last call; empty without a history."""
        return ()

    @abstractmethod
    def restart(self) -> None:
        """Begin another record on stamps that were set back; call it after `finish`."""

    @abstractmethod
    def reset(self) -> None:
        """Reset the state."""
