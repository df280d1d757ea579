"""Twins of machines whose state depends on the past: bodies between springs and stops."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from textile_twin_core.arrays import FloatArray
from textile_twin_core.contact import ContactEvent
from textile_twin_core.errors import MotionError, SceneError
from textile_twin_core.machine import ContactMachine
from textile_twin_core.machine.contact_motion import ContactMotion, measured_error
from textile_twin_core.shaft import OneState, ShaftStates
from textile_twin_core.twin.motion_arrays import arrays_for, flat_columns
from textile_twin_core.twin.predictor import Prediction, Predictor, StampedEvent
from textile_twin_core.twin.session import AnyTwin

_MOST_EVENTS = 100_000
"""Capacity of a session for impacts and touches that are not taken yet."""


class HistoryTwin(AnyTwin):
    """Machine with history, integrated event by event in the order of the samples.

    Attributes:
        method: Always "exact": exact between events.
        tolerance: Tolerance of the integrator in the rubber pad.
        events: Impacts and touches of the last `evaluate`, with their impulses.
    """

    method = "exact"

    def __init__(self, machine: ContactMachine, outputs: tuple[str, ...], tolerance: float) -> None:
        self.machine: ContactMachine = machine
        self.outputs, self.tolerance = outputs, tolerance
        self.events: list[ContactEvent] = []
        if not 1e-14 <= tolerance <= 1e-3:
            raise SceneError(f"a machine with history takes a tolerance between 1e-14 and 1e-3, not {tolerance!r}")
        self._motion()  # raises for unknown outputs

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.machine, self.outputs, self.tolerance), {"events": self.events}

    def evaluate(
        self,
        theta: float | FloatArray,
        omega: float | FloatArray = 0.0,
        alpha: float | FloatArray = 0.0,
        *,
        time: float | FloatArray | None = None,
        out: Mapping[str, FloatArray] | None = None,
    ) -> dict[str, Any]:
        """Evaluate the outputs at samples (n,) of shaft angle, speed, acceleration and time, in order.

        The driven element follows its law of motion at theta. At the first sample the machine is in its declared
        start state.

        Args:
            theta: Shaft angles [rad].
            omega: Shaft speeds [rad/s].
            alpha: Shaft accelerations [rad/s^2].
            time: Increasing times [s]; optional for a constant, non-zero speed.
            out: Arrays to write into, by output.

        Returns:
            The outputs by name.

        Raises:
            MotionError: Times do not increase or are missing, or arrays do not fit.
        """
        motion: dict[str, npt.ArrayLike] = {"theta": theta, "omega": omega, "alpha": alpha}
        if time is not None:
            motion["time"] = time
        shape, columns = flat_columns(motion)
        result = arrays_for(self.outputs, shape, out, columns)
        times = _steady_time(*columns) if time is None else columns[3]
        machine_motion = self._motion()
        found = machine_motion.step(times, *columns[:3])
        self.events = machine_motion.take_events()
        for name, values in found.items():
            result[name][...] = values.reshape(shape)
        return result if shape or out is not None else {name: float(values) for name, values in result.items()}

    @cached_property
    def reached_error(self) -> float:
        """Error over peak of the worst output over one cycle, against a tolerance a thousand times tighter."""
        return measured_error(self.machine, self.outputs, self.tolerance)

    def describe(self) -> str:
        """Describe the integrated motion and its method."""
        model = self.machine.model
        bodies = ", ".join(body.name for body in model.bodies)
        return "\n".join(
            [
                f"{self.machine.name}: {', '.join(self.outputs)}",
                f"integrated in the order of time: {bodies}, driven by {model.drive}",
                f"{len(model.springs)} springs with dampers, {len(model.stops)} stops, {len(model.pads)} pad",
                f"between events: closed form; in the pad: adaptive, tolerance {self.tolerance:.0e}",
            ]
        )

    def predictor(self, shaft: str = "causal", before: Predictor | None = None) -> HistoryPredictor:
        """Create the predictor of a session; the history starts with it."""
        return HistoryPredictor(self._motion())

    def _motion(self) -> ContactMotion:
        return ContactMotion(self.machine, self.outputs, self.tolerance)


class HistoryPredictor(Predictor):
    """Predictor at shaft states in their order."""

    def __init__(self, motion: ContactMotion) -> None:
        self.motion = motion
        self._first: Any = None
        self._events: deque[StampedEvent] = deque(maxlen=_MOST_EVENTS)

    def predict(self, states: ShaftStates) -> Prediction:
        """Predict the outputs at states."""
        if len(states) == 0:
            return Prediction(states, {name: np.empty(0) for name in self.motion.outputs}, None)
        outputs = self._step(states.stamps, states.phase_rad, states.omega_rad_s, states.alpha_rad_s2)
        return Prediction(states, outputs, None)

    def predict_one(self, stamp: int | float, state: OneState, sense_known: bool) -> dict[str, float]:
        """Predict the outputs at one state; such a machine has no friction that follows the sense of rotation."""
        *motion, _ = (np.array((value,)) for value in (stamp, *state))
        return {name: values.item() for name, values in self._step(*motion).items()}

    def _step(self, stamps: npt.NDArray[Any], *motion: FloatArray) -> dict[str, FloatArray]:
        if self._first is None:
            self._first = stamps[0]
        elapsed: npt.NDArray[Any] = stamps - self._first
        whole = np.issubdtype(elapsed.dtype, np.integer)
        outputs = self.motion.step(elapsed * 1e-9 if whole else elapsed, *motion)
        for event in self.motion.take_events():
            stamp = int(self._first) + round(event.time_s * 1e9) if whole else float(self._first) + event.time_s
            self._events.append(StampedEvent(stamp, event))
        return outputs

    def take_events(self) -> list[StampedEvent]:
        """Remove and return the events since the last call (the latest 100 000), with stamps on the clock of the
        states.
        """
        taken = list(self._events)
        self._events.clear()
        return taken

    def restart(self) -> None:
        """Begin another record with the machine in its start state; waiting events remain."""
        self.motion.reset()
        self._first = None

    def reset(self) -> None:
        """Reset the machine to its start state."""
        self.restart()
        self._events.clear()


def _steady_time(theta: FloatArray, omega: FloatArray, alpha: FloatArray) -> FloatArray:
    if omega.size == 0:
        return theta
    speed = float(omega[0])
    if not (math.isfinite(speed) and speed != 0.0 and np.all(omega == speed) and np.all(alpha == 0.0)):
        raise MotionError("a machine with history needs the time of each sample: give time= (time_s in a table)")
    times: FloatArray = (theta - theta[0]) / speed
    return times
