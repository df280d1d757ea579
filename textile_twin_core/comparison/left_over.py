"""What an explanation leaves that repeats with the shaft's angle: a machine that is not quite that of its file."""

from __future__ import annotations

import numpy as np

from textile_twin_core.comparison.explain import ALL_SAMPLES, Explanation
from textile_twin_core.comparison.search import what_can_vary
from textile_twin_core.comparison.settings_fit import fit_settings
from textile_twin_core.comparison.unmodelled import unmodelled_torque

_LEAST = 0.005
"""Part of the torque's size below which what is left is not worth a word."""


def repeating_torque(found: Explanation) -> float:
    """The largest torque that is left and repeats with the shaft's angle [N m]; 0 where none is significant."""
    evidence = found.weighed.thinned(ALL_SAMPLES)
    # What is too small to be named repeats as well, as long as it is not taken off.
    fit = fit_settings(evidence, found.settings, {*found.fit.free, *what_can_vary(evidence)})
    good, gain = fit.good, fit.settings.gain
    left = unmodelled_torque(fit.theta[good], fit.residual[good] / gain, fit.turn[good])
    largest = float(np.max(np.abs(left.torque_Nm)))
    size = float(np.percentile(np.abs(fit.measured[good] / gain), 95.0))
    return largest if left.significant and largest > _LEAST * size else 0.0


def repeating_note(torque_Nm: float) -> str:
    """What is to be said of it."""
    return (
        f"the torque that is left repeats with the shaft's angle, up to {torque_Nm:.2g} N m: wrong masses, friction of"
        " a joint or a load that the machine file does not have look like this, and settings of the sensors may make"
        " up for them by more than their +- says; identify shows it by angle"
    )
