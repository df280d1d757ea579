"""Result of a comparison: sample by sample for the views, in numbers for the report."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray
from textile_twin_core.comparison.statistics import (
    AngleBins,
    ErrorStatistics,
    OrderSpectrum,
    RevolutionErrors,
    SpeedBins,
)
from textile_twin_core.comparison.uncertainty import Estimate
from textile_twin_core.inference.learned_curve import LearnedCurve
from textile_twin_core.machine import Event

if TYPE_CHECKING:
    from textile_twin_core.comparison.cause import Cause, Quantity


@dataclass(frozen=True)
class ComparisonEvent(Event):
    """An event of the turn; `jump` is true if the predicted torque is discontinuous there."""

    jump: bool


@dataclass(frozen=True, slots=True)
class SampleCount:
    """Numbers of samples that entered the comparison, and of the rejected ones by cause.

    `rejected` counts measured samples by the causes below, and angles that the caller rejected before prediction
    (causes `angle_...`).

    Causes: `not_finite` (the torque is nan or infinite), `stamp_not_increasing` (repeated or older stamp),
    `no_prediction` (stamp - delay is before the first or after the last prediction), `prediction_gap`
    (inside a gap of the predictions), `load_jump` (so close to a discontinuity of the load that its side is
    uncertain), `not_settled` (the shaft estimator had not converged,
    or the filter of the torque sensor not settled), `prediction_not_usable` (predictions with
    nan or a repeated stamp).
    """

    measured: int
    predicted: int
    used: int
    rejected: int
    by_cause: Mapping[str, int]


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """Measured against predicted torque.

    Sample by sample, m measured samples that had a usable stamp and value; then in numbers.

    Attributes:
        stamps_ns: (m,) stamps of the measured samples.
        measured_Nm: (m,) as measured.
        expected_Nm: (m,) expected reading: gain * filtered prediction(stamp - delay) + offset, with the configured
            filter, gain and offset and the estimated delay; nan where not used.
        residual_Nm: (m,) measured - expected; nan where not used.
        theta_rad: (m,) unwrapped shaft angle at stamp - delay; nan where there is no prediction.
        used: (m,) true for the samples that entered the numbers.
        predicted_stamps_ns, predicted_Nm, predicted_theta_rad, predicted_sigma_Nm: (n,) the usable predictions,
            the sigma nan where none was given.
        predicted_reading_Nm: (n,) what the sensor as configured reads of them, its delay later.
        sensor_delay_s, sensor_gain, sensor_offset_Nm: the sensor as the machine configures it.
        delay: of the fit of the verdict [s]; the configured one, with sigma nan, without a verdict.
        fitted_gain, fitted_offset_Nm: of a line through measured over predicted torque, at that delay.
        errors: at that delay. errors_configured: at the configured one. errors_fitted: about that line.
        by_angle, by_revolution, by_order, by_speed: the residual at the estimated delay, sorted; by angle and by
            order while the shaft turns.
        samples: used and rejected. revolutions: turns of the shaft from the first used sample to the last.
        events: the turn's events. notes: remarks on the numbers.
        verdict: faults of the recording or the machine file, likeliest first; empty without a fault.
        explained: share of the torque's variance that the corrected machine explains; nan without a verdict.
        quantities: estimates of sensors, friction and forces, each once; empty without a verdict.
        curves: force laws by name that explain what constant forces do not.

    Examples:
        >>> import numpy as np
        >>> from textile_twin_core.comparison import compare_torque
        >>> stamps = np.arange(5000) * 2_000_000  # [ns]
        >>> theta = 16.76 * stamps * 1e-9  # [rad]
        >>> sorted(compare_torque(stamps, np.sin(theta), stamps, np.sin(theta), theta).to_json())[:2]
        ['by_angle', 'by_order']
    """

    stamps_ns: IntArray
    measured_Nm: FloatArray
    expected_Nm: FloatArray
    residual_Nm: FloatArray
    theta_rad: FloatArray
    used: BoolArray
    predicted_stamps_ns: IntArray
    predicted_Nm: FloatArray
    predicted_reading_Nm: FloatArray
    predicted_theta_rad: FloatArray
    predicted_sigma_Nm: FloatArray
    sensor_delay_s: float
    sensor_gain: float
    sensor_offset_Nm: float
    delay: Estimate
    fitted_gain: float
    fitted_offset_Nm: float
    errors: ErrorStatistics
    errors_configured: ErrorStatistics
    errors_fitted: ErrorStatistics
    by_angle: AngleBins
    by_revolution: RevolutionErrors
    by_order: OrderSpectrum
    by_speed: SpeedBins
    samples: SampleCount
    revolutions: float
    events: tuple[ComparisonEvent, ...]
    notes: tuple[str, ...] = ()
    verdict: tuple[Cause, ...] = ()
    explained: float = math.nan
    quantities: tuple[Quantity, ...] = ()
    curves: Mapping[str, LearnedCurve] = dataclasses.field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """Return the numbers as one object of plain lists and numbers; nan is null."""
        torque: dict[str, Any] = {
            **dataclasses.asdict(self.errors),
            "delay_s": self.delay.value,
            "delay_sigma_s": self.delay.sigma,
            "delay_identifiable": math.isfinite(self.delay.sigma),
            "gain": self.fitted_gain,
            "offset_Nm": self.fitted_offset_Nm,
            "configured": {
                "delay_s": self.sensor_delay_s,
                "gain": self.sensor_gain,
                "offset_Nm": self.sensor_offset_Nm,
                **dataclasses.asdict(self.errors_configured),
            },
            "fitted": dataclasses.asdict(self.errors_fitted),
        }
        first, last = self.stamps_ns[self.used][[0, -1]]
        plain_numbers: dict[str, Any] = plain(
            {
                "torque": torque,
                "samples": {
                    "measured": self.samples.measured,
                    "predicted": self.samples.predicted,
                    "used": self.samples.used,
                    "rejected": self.samples.rejected,
                    "rejected_by_cause": dict(self.samples.by_cause),
                },
                "revolutions": self.revolutions,
                "time": {"start_ns": first, "end_ns": last, "duration_s": (last - first) * 1e-9},
                "by_angle": dataclasses.asdict(self.by_angle),
                "by_revolution": dataclasses.asdict(self.by_revolution),
                "by_order": dataclasses.asdict(self.by_order),
                "by_speed": dataclasses.asdict(self.by_speed),
                "events": [dataclasses.asdict(event) for event in self.events],
                "notes": list(self.notes),
                "verdict": [dataclasses.asdict(cause) for cause in self.verdict],
                "explained": self.explained,
                "quantities": [dataclasses.asdict(quantity) for quantity in self.quantities],
                "curves": {name: curve_json(curve) for name, curve in self.curves.items()},
            }
        )
        return plain_numbers


def curve_json(curve: LearnedCurve) -> dict[str, Any]:
    """Return the numbers of a force law, as plain lists."""
    work_in, sigma_in, work_out, sigma_out = curve.work_J()
    found: dict[str, Any] = plain(
        {
            "measure": curve.measure,
            "knots": curve.knots,
            "in_N": curve.in_N,
            "in_sigma_N": curve.in_sigma_N,
            "out_N": curve.out_N,
            "out_sigma_N": curve.out_sigma_N,
            "covariance_N2": curve.covariance,
            "speed_power": curve.speed_power,
            "at_speed_rad_s": curve.at_speed_rad_s,
            "in_determined": ~curve.undetermined(True),
            "out_determined": ~curve.undetermined(False),
            "work_in_J": work_in,
            "work_in_sigma_J": sigma_in,
            "work_out_J": work_out,
            "work_out_sigma_J": sigma_out,
        }
    )
    return found


def plain(value: Any) -> Any:
    """Turn arrays into lists, numpy numbers into Python's, and nan or infinity into None."""
    if isinstance(value, dict):
        return {key: plain(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(entry) for entry in value]
    if isinstance(value, np.ndarray):
        return [plain(entry) for entry in value.tolist()]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
