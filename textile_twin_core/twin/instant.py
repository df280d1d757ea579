"""Predictions of machines whose outputs depend only on the present state of the shaft."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.errors import MotionError
from textile_twin_core.machine.machine import Machine
from textile_twin_core.machine.sensitivity import TorqueSensitivity
from textile_twin_core.shaft import OneState, ShaftStates
from textile_twin_core.twin.predictor import Prediction
from textile_twin_core.twin.sense import negligible_speed, sense_unknown

_FEW = 80
"""Number of samples up to which single evaluation is faster than arrays."""
_INSIDE = 0.3819
"""Share of the machine's range at which windings are evaluated, away from the usual dead points."""


class InstantTwin(Protocol):
    """Twin that evaluates its outputs at any shaft state (see `Twin`)."""

    @property
    def machine(self) -> Machine:
        """Machine of the twin."""
        ...

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of its outputs."""
        ...

    def evaluate(
        self,
        theta: float | FloatArray,
        omega: float | FloatArray = 0.0,
        alpha: float | FloatArray = 0.0,
        *,
        out: Mapping[str, FloatArray] | None = None,
    ) -> dict[str, Any]:
        """Return the outputs by name."""
        ...


class InstantPredictor:
    """Predictor that evaluates a twin at shaft states, by phase and turns so that long runs lose no digits.

    Dry friction needs the sense of rotation. Where the state does not determine it (see `sense`), dry friction
    is zero, as
    at standstill; all other terms of the speed remain.
    """

    def __init__(self, twin: InstantTwin) -> None:
        self._twin = twin
        self._winding = windings(twin)

    at_once = True
    estimator = None

    @property
    def sensitivity(self) -> TorqueSensitivity | None:
        """Sensitivity of the torque to the state; None for a machine without masses."""
        return self._twin.machine.model.torque_sensitivity

    def predict(self, states: ShaftStates) -> Prediction:
        """Predict the outputs at states."""
        motion = (states.phase_rad, states.omega_rad_s, states.alpha_rad_s2)
        outputs = self._block(motion)
        unknown = np.flatnonzero(sense_unknown(states))
        if unknown.size:
            theta, omega, alpha = (column[unknown] for column in motion)
            standstill = self._block((theta, np.zeros_like(omega), alpha))
            turning = self._block((theta, negligible_speed(omega), alpha))
            for name, values in outputs.items():
                values[unknown] += standstill[name] - turning[name]
        for name, winding in self._winding.items():
            outputs[name] += winding * states.turns
        return Prediction(states, outputs, self.sensitivity)

    finish = predict

    def predict_one(self, stamp: int | float, state: OneState, sense_known: bool) -> dict[str, float]:
        """Predict the outputs at one state."""
        *motion, turns = state
        values = self._single(motion)
        if not sense_known:
            theta, omega, alpha = motion
            standstill = self._single((theta, 0.0, alpha))
            turning = self._single((theta, float(negligible_speed(omega)), alpha))
            values = {name: value + (standstill[name] - turning[name]) for name, value in values.items()}
        for name, winding in self._winding.items():
            values[name] += winding * turns
        return values

    def _block(self, motion: Sequence[FloatArray]) -> dict[str, FloatArray]:
        n, twin = len(motion[0]), self._twin
        outputs = {name: np.empty(n) for name in twin.outputs}
        if n > _FEW and outputs:
            twin.evaluate(*motion, out=outputs)
        else:
            for i, row in enumerate(zip(*(a.tolist() for a in motion), strict=True)):
                for name, value in self._single(row).items():
                    outputs[name][i] = value
        return outputs

    def _single(self, state: Sequence[float]) -> dict[str, float]:
        """Evaluate one sample as in a block: NaN where the motion of the machine is not determined."""
        try:
            return self._twin.evaluate(*state)
        except MotionError:
            return dict.fromkeys(self._twin.outputs, math.nan)

    def take_events(self) -> tuple[()]:
        """Return no events: a single instant has no interval."""
        return ()

    def restart(self) -> None:
        """Do nothing; there is no state."""

    reset = restart


def windings(twin: InstantTwin) -> dict[str, float]:
    """Return the growth over one turn of the outputs that wind up with the shaft, such as its angle.

    Closed forms wind up wherever the linkage closes, even if it closes over a part of the turn only.
    """
    low, high = twin.machine.range_rad
    angle = low + _INSIDE * (high - low)
    begin, end = twin.evaluate(angle, 0.0, 0.0), twin.evaluate(angle + 2.0 * math.pi, 0.0, 0.0)
    return {
        name: 2.0 * math.pi * round((end[name] - begin[name]) / (2.0 * math.pi))
        for name in twin.outputs
        if abs(end[name] - begin[name]) > 1.0
    }
