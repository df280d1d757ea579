"""What a session needs of a twin, and what a twin gives it for its predictions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol

from textile_twin_core.arrays import FloatArray
from textile_twin_core.contact import ContactEvent
from textile_twin_core.machine import AnyMachine
from textile_twin_core.machine.sensitivity import TorqueSensitivity
from textile_twin_core.shaft import OneState, ShaftStates


class StampedEvent(NamedTuple):
    """An impact or touch, and when it was as the samples are stamped: int [ns] or float [s]."""

    stamp: int | float
    event: ContactEvent


_SHOWN = 4
"""Names of outputs that a text lists."""


def names_text(names: Sequence[str]) -> str:
    """The first names, and how many more there are."""
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return f"{', '.join(names[:_SHOWN])}{more}"


def twin_text(kind: str, machine: str, outputs: Sequence[str], method: str) -> str:
    """What a twin prints as."""
    return f"<{kind} of '{machine}', {method}: {names_text(outputs)}>"


class Prediction(NamedTuple):
    """What a predictor makes of estimated shaft states.

    states: (n,) the estimated ones, or what a model of the shaft makes of them. outputs: (n,) arrays by name.
    uncertainty: (n,) sigma of the torque [N m], or how the torque follows the state; None without a torque.
    """

    states: ShaftStates
    outputs: dict[str, FloatArray]
    uncertainty: TorqueSensitivity | FloatArray | None


class Predictor(Protocol):
    """What turns shaft states into outputs, in their order."""

    @property
    def at_once(self) -> bool:
        """Whether `predict_one` may be called."""
        ...

    @property
    def estimator(self) -> str | None:
        """The only shaft estimator whose states it takes; None for any."""
        ...

    def predict(self, states: ShaftStates) -> Prediction:
        """Predictions at states."""
        ...

    def finish(self, states: ShaftStates) -> Prediction:
        """Predictions at the last states of a record, and what is held."""
        ...

    def predict_one(self, stamp: int | float, state: OneState, sense_known: bool) -> dict[str, float]:
        """Outputs at one state; `sense_known`: whether it tells the sense of rotation (see `sense`)."""
        ...

    def take_events(self) -> Sequence[StampedEvent]:
        """What has happened since the last time; nothing without a history."""
        ...

    def reset(self) -> None:
        """Begin anew."""
        ...


class AnyTwin(Protocol):
    """A machine compiled for its outputs, with or without a history."""

    @property
    def machine(self) -> AnyMachine:
        """Whose twin it is."""
        ...

    @property
    def events(self) -> Sequence[ContactEvent]:
        """The impacts and touches of the last `evaluate`; none without a history."""
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
        """The outputs by name at shaft states; only a machine with a history asks when they are."""
        ...

    def predictor(self, shaft: str = "causal", before: Predictor | None = None) -> Predictor:
        """Predictions from here on for a shaft estimator; `before`: the predictor whose state they go on with."""
        ...
