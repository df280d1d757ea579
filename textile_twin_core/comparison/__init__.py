"""Measured against predicted torque: alignment in time, errors by shaft angle, sensor delay and gain."""

from __future__ import annotations

from textile_twin_core.comparison.assess import Assessment, assess
from textile_twin_core.comparison.by_angle import AngleBins, RevolutionErrors, RunningAngleBins
from textile_twin_core.comparison.calibrate import Calibration, calibrate
from textile_twin_core.comparison.compare import compare_torque
from textile_twin_core.comparison.delay import SensorFit
from textile_twin_core.comparison.identified_machine import with_table
from textile_twin_core.comparison.identify import Identification, identify
from textile_twin_core.comparison.readings import Readings
from textile_twin_core.comparison.result import Comparison, ComparisonEvent, SampleCount
from textile_twin_core.comparison.statistics import ErrorStatistics
from textile_twin_core.comparison.summary import is_as_told, summary_rows, verdict_lines
from textile_twin_core.comparison.uncertainty import Estimate
from textile_twin_core.comparison.verdict import Cause
from textile_twin_core.errors import AlignmentError

__all__ = [
    "AlignmentError",
    "AngleBins",
    "Assessment",
    "Calibration",
    "Cause",
    "Comparison",
    "ComparisonEvent",
    "ErrorStatistics",
    "Estimate",
    "Identification",
    "Readings",
    "RevolutionErrors",
    "RunningAngleBins",
    "SampleCount",
    "SensorFit",
    "assess",
    "calibrate",
    "compare_torque",
    "identify",
    "is_as_told",
    "summary_rows",
    "verdict_lines",
    "with_table",
]
