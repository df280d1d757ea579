"""Measured against predicted torque: alignment in time, errors by shaft angle, sensor delay and gain."""

from __future__ import annotations

from typing import TYPE_CHECKING

from textile_twin_core.lazy import listing_of, names_of

if TYPE_CHECKING:
    from textile_twin_core.comparison.assessment import Assessment, assess
    from textile_twin_core.comparison.calibration import Calibration, calibrate
    from textile_twin_core.comparison.cause import Cause
    from textile_twin_core.comparison.compare import compare_torque
    from textile_twin_core.comparison.identification import Identification, identify
    from textile_twin_core.comparison.identified_machine import with_table
    from textile_twin_core.comparison.readings import Readings
    from textile_twin_core.comparison.result import Comparison, ComparisonEvent, SampleCount
    from textile_twin_core.comparison.statistics import AngleBins, ErrorStatistics, RevolutionErrors, RunningAngleBins
    from textile_twin_core.comparison.summary import agrees_with_file, summary_rows, verdict_lines
    from textile_twin_core.comparison.uncertainty import Estimate

__all__ = [
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
    "agrees_with_file",
    "assess",
    "calibrate",
    "compare_torque",
    "identify",
    "summary_rows",
    "verdict_lines",
    "with_table",
]

# Each name is imported on first use, so that nodes and commands start without what they do not need.
__dir__ = listing_of(__all__)
__getattr__ = names_of(
    __name__,
    {
        "AngleBins": "statistics",
        "Assessment": "assessment",
        "Calibration": "calibration",
        "Cause": "causes",
        "Comparison": "result",
        "ComparisonEvent": "result",
        "ErrorStatistics": "statistics",
        "Estimate": "uncertainty",
        "Identification": "identification",
        "Readings": "readings",
        "RevolutionErrors": "statistics",
        "RunningAngleBins": "statistics",
        "SampleCount": "result",
        "assess": "assessment",
        "calibrate": "calibration",
        "compare_torque": "compare",
        "identify": "identification",
        "agrees_with_file": "summary",
        "summary_rows": "summary",
        "verdict_lines": "summary",
        "with_table": "identified_machine",
    },
)
