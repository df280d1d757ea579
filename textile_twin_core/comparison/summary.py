"""Summary of a comparison in a few lines for a person."""

from __future__ import annotations

import math

from textile_twin_core.comparison.result import Comparison


def summary_rows(comparison: Comparison) -> list[tuple[str, str]]:
    """Return (quantity, value with unit) pairs, in the order in which an engineer asks for them."""
    errors = comparison.errors
    sensors = [(quantity.name, quantity.text) for quantity in comparison.quantities]
    causes = ", ".join(
        f"{number} {cause.replace('_', ' ')}" for cause, number in sorted(comparison.samples.by_cause.items())
    )
    rows = [
        ("RMS error", f"{errors.rms_error_Nm:.4f} N m"),
        ("RMS error over peak", f"{errors.rms_over_peak * 100.0:.2f} %"),
        ("largest error", f"{errors.max_error_Nm:.3f} N m"),
        ("mean error", f"{errors.bias_Nm:+.4f} N m"),
        ("correlation", f"{errors.correlation:.6f}"),
        ("peak, measured", f"{errors.peak_Nm:.3f} N m"),
        *sensors,
        (
            f"RMS, delay {comparison.sensor_delay_s * 1e3:g} ms as configured",
            f"{comparison.errors_configured.rms_error_Nm:.4f} N m",
        ),
        ("RMS, gain and offset fitted", f"{comparison.errors_fitted.rms_error_Nm:.4f} N m"),
        ("revolutions", f"{comparison.revolutions:.1f}"),
        ("samples used", f"{comparison.samples.used} of {comparison.samples.measured}"),
        ("samples rejected", f"{comparison.samples.rejected}" + (f" ({causes})" if causes else "")),
    ]
    return rows + [("note", note) for note in comparison.notes]


def agrees_with_file(comparison: Comparison) -> bool:
    """Return true if the recording was judged and agrees with the machine file; false without a judgement."""
    return not comparison.verdict and bool(comparison.quantities)


def verdict_lines(comparison: Comparison) -> list[str]:
    """Lines of the verdict in plain words, likeliest cause first; one line without a fault or a judgement."""
    if comparison.verdict:
        return [cause.text for cause in comparison.verdict]
    if math.isnan(comparison.explained):
        return ["nothing can be determined from this recording; see the notes"]
    if not agrees_with_file(comparison):
        share = f"{comparison.explained * 100.0:.0f} %"
        return [f"nothing is judged, though the machine explains but {share} of the torque's variance; see the notes"]
    return [f"as the machine file says; it explains {comparison.explained * 100.0:.2f} % of the torque's variance"]
