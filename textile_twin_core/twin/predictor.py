"""What a session needs of a twin, and what a twin gives it for its predictions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from textile_twin_core.arrays import FloatArray
from textile_twin_core.contact import ContactEvent
from textile_twin_core.machine import AnyMachine
from textile_twin_core.machine.sensitivity import TorqueSensitivity
from textile_twin_core.shaft import ShaftStates


class Predictor(Protocol):
    """What turns shaft states into outputs, in their order."""

    @property
    def sensitivity(self) -> TorqueSensitivity | None:
        """How the torque follows the state; None for a machine without one."""
        ...

    def predict(self, states: ShaftStates) -> dict[str, FloatArray]:
        """Outputs at states, arrays (n,)."""
        ...

    def predict_one(self, states: ShaftStates) -> dict[str, float]:
        """Outputs at the one state there is."""
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

    def predictor(self) -> Predictor:
        """Predictions from here on, with a state of their own."""
        ...
