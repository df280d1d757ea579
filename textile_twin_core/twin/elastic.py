"""Twins of machines with an elastic main shaft: the state of the chain lives between the samples."""

from __future__ import annotations

import math
from collections.abc import Mapping
from difflib import get_close_matches
from functools import cached_property
from typing import Any

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.driveline import ElasticShaft, elastic_shaft, follow_motion
from textile_twin_core.driveline.observer import ShaftObserver
from textile_twin_core.errors import MotionError, SceneError
from textile_twin_core.machine import Machine
from textile_twin_core.shaft import ShaftStates
from textile_twin_core.shaft.turns import TURN
from textile_twin_core.twin.compiled import Twin
from textile_twin_core.twin.elastic_motion import ElasticMotion, ElasticOutputs, set_angle, state_rows
from textile_twin_core.twin.elastic_predictor import ElasticPredictor
from textile_twin_core.twin.motion_arrays import arrays_for, flat_columns
from textile_twin_core.twin.predictor import Predictor
from textile_twin_core.twin.session import AnyTwin

_MOMENT_S = 1e-6
"""Time over which a single sample is followed."""


class ElasticTwin(AnyTwin):
    """A machine with an elastic main shaft, compiled for its outputs.

    The usual outputs speak of the first linkage at its own station, `balancing_torque_Nm` of the piece whose torque the
    sensor shows; sums over linkages take each at its own station's angle.
    """

    method = "exact"

    def __init__(self, machine: Machine, outputs: tuple[str, ...], tolerance: float) -> None:
        self.machine: Machine = machine
        self.outputs, self.tolerance = outputs, tolerance
        for name in outputs:
            if name not in machine.outputs:
                near = get_close_matches(name, machine.outputs, n=3) or machine.outputs[:6]
                raise SceneError(f"machine '{machine.name}' has no output '{name}'; did you mean {' or '.join(near)}?")
        self.results = ElasticOutputs(machine, outputs)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.machine, self.outputs, self.tolerance)

    @cached_property
    def elastic(self) -> ElasticShaft:
        """The chain."""
        return elastic_shaft(self.machine)

    def evaluate(
        self,
        theta: float | FloatArray,
        omega: float | FloatArray = 0.0,
        alpha: float | FloatArray = 0.0,
        *,
        time: float | FloatArray | None = None,
        out: Mapping[str, FloatArray] | None = None,
    ) -> dict[str, Any]:
        """The outputs by name at samples of the shaft's motion: angle [rad], speed, acceleration, and time [s].

        With `time` the encoder's station follows the motion in the order of the samples (n,), and the chain begins with
        the twist of uniform rotation. Without it the shaft counts as rigid at every sample, which has neither twist nor
        torque of a piece. Raises MotionError as `follow_motion`, for outputs of the elastic shaft without `time`, and
        for arrays that do not fit.
        """
        if time is None:
            if self.results.of_the_shaft:
                raise MotionError(
                    f"{self.results.of_the_shaft[0]} depends on the motion before: give time= (time_s in a table)"
                )
            return self._rigid.evaluate(theta, omega, alpha, out=out)
        shape, columns = flat_columns({"theta": theta, "omega": omega, "alpha": alpha, "time": time})
        result = arrays_for(self.outputs, shape, out, columns)
        if columns[0].size:
            for name, values in self.results.at(self._followed(columns[3], *columns[:3])).items():
                result[name][...] = values.reshape(shape)
        return result if shape or out is not None else {name: float(values) for name, values in result.items()}

    @cached_property
    def _rigid(self) -> Twin:
        return Twin(self.machine, self.outputs, self.method, self.tolerance)

    def _followed(self, times: FloatArray, *motion: FloatArray) -> ElasticMotion:
        count = times.size
        if count == 1:
            theta, omega, alpha = (float(each[0]) for each in motion)
            passed = np.array((0.0, _MOMENT_S))
            times, turned = times[0] + passed, theta + omega * passed + 0.5 * alpha * passed**2
            motion = (turned, omega + alpha * passed, np.full(2, alpha))
        moved = follow_motion(self.elastic, times, *motion)
        states = state_rows(np.zeros((count, 9)))
        set_angle(states, motion[0][:count], np.zeros(count))
        states["speed"], states["acceleration"] = motion[1][:count], motion[2][:count]
        ratios = self.elastic.ratios
        return ElasticMotion(
            ShaftStates(times[:count], states),
            moved.theta_rad[:count] / ratios - TURN * states["turns"][:, None],
            moved.omega_rad_s[:count] / ratios,
            moved.alpha_rad_s2[:count] / ratios,
            moved.piece_torque_Nm[:count],
        )

    @cached_property
    def reached_error(self) -> float:
        """Error of the torque over its root mean square that the observer's time step leaves, at nominal speed."""
        return self.observer().scales.numeric_error

    def describe(self) -> str:
        """Description of the integrated chain and its method."""
        observer = self.observer()
        scales, shaft = observer.scales, self.elastic.shaft
        known = {"inertia": shaft.drive.inertia_kgm2, "slip": shaft.drive.slip_Nms_rad}
        damping = f"damping {scales.damping_ratio:.3g}" if scales.damping_ratio > 0.0 else "undamped: it never settles"
        unknown = " and ".join(name for name, value in known.items() if value is None)
        return "\n".join(
            [
                f"{self.machine.name}: {', '.join(self.outputs)}",
                f"elastic main shaft: {self.elastic.stations} stations, {len(self.machine.linkages)} linkages",
                f"first mode {scales.first_mode_rad_s / (2.0 * math.pi):.1f} Hz, {damping}",
                f"time step {1e6 * scales.substep_s:.0f} us, which leaves {scales.numeric_error:.1g} of the torque",
                f"of the drive estimated: {unknown or 'its torque'}",
            ]
        )

    def observer(self) -> ShaftObserver:
        """An observer before its first reading."""
        period = TURN * self.machine.sensors.second_encoder.ratio
        return ShaftObserver(self.elastic, self.machine.nominal_speed_rad_s, second_period_rad=period)

    def predictor(self, shaft: str = "causal", before: Predictor | None = None) -> ElasticPredictor:
        """Predictor of a session; `before`: the predictor whose state it continues."""
        if isinstance(before, ElasticPredictor):
            return before.with_outputs(self.results)
        return ElasticPredictor(self.elastic, self.observer(), self.results, shaft == "smooth")
