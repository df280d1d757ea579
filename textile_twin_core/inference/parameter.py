"""Parameter of the measurement model: its nominal value, its tolerance, and the prior of a departure."""

from __future__ import annotations

import math
from dataclasses import dataclass

ZERO = "sensors.encoder.zero_rad"
DELAY = "sensors.torque.delay_s"
DRIFT = "sensors.torque.drift"
GAIN = "sensors.torque.gain"
OFFSET = "sensors.torque.offset_Nm"
COULOMB = "loads.shaft_friction.coulomb_Nm"
VISCOUS = "loads.shaft_friction.viscous_Nms"
ROTOR = "bodies.main_shaft.inertia_kgm2"
HELD = "standstill.held_Nm"
"""Torque that holds the shaft at standstill only, as a brake's; not a number of the file."""
CURVE, EDGE = "curve", "edge"
OF_A_LAW = (CURVE, EDGE)
"""Kinds of the parameters of a force law: its coefficients, and the places where it sets in and ends."""
SENSORS = (ZERO, DELAY, DRIFT, GAIN, OFFSET)
"""Parameters whose values are departures from the configured sensor; for the gain see `gain_factor`."""
BESIDE = (COULOMB, VISCOUS, ROTOR)
"""Parameters of every machine, declared in its file or not."""


@dataclass(frozen=True)
class ModelParameter:
    """A number of the machine or of its sensors.

    Attributes:
        name: dotted path into the machine file.
        kind: key of the table of priors, such as `mass`.
        nominal: value in the machine file.
        tolerance: standard deviation of an everyday error of the nominal value.
        departure: standard deviation of a mistake; `widest`: that of the largest mistakes that occur.
        probability: of a mistake in this number.
        threshold: smallest departure that is reported.
        unit: of value, tolerance and departure.
        low: least possible value.
    """

    name: str
    kind: str
    nominal: float
    tolerance: float
    departure: float
    widest: float
    probability: float
    threshold: float
    unit: str
    low: float = -math.inf

    @property
    def log_odds(self) -> float:
        """Logarithm of the odds of a departure."""
        return math.log(self.probability / (1.0 - self.probability))

    def spread(self, value: float) -> float:
        """Standard deviation of a departure of this size: a scale mixture, so that large mistakes stay possible."""
        return min(max(abs(value - self.nominal), self.departure), self.widest)


def gain_factor(value: float) -> float:
    """Factor on the torque sensor's gain for a value of the parameter `GAIN`, 1 / (1 - value).

    With the inverse of the gain as parameter, a gain and the torques that compensate it lie on a straight line, which
    suits the steps of a fit.
    """
    return 1.0 / (1.0 - value)


def gain_value(factor: float) -> float:
    """Value of the parameter `GAIN` for a factor."""
    return 1.0 - 1.0 / factor
