"""Parameter of the measurement model: its nominal value, its tolerance, and the prior of a departure."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass

ZERO = "sensors.encoder.zero_rad"
DELAY = "sensors.torque.delay_s"
DRIFT = "sensors.torque.drift"
GAIN = "sensors.torque.gain"
OFFSET = "sensors.torque.offset_Nm"
COULOMB = "loads.shaft_friction.coulomb_Nm"
VISCOUS = "loads.shaft_friction.viscous_Nms"
ROTOR = "bodies.main_shaft.inertia_kgm2"
LOW_PASS = "sensors.torque.low_pass_s"
BUTTERWORTH = "sensors.torque.low_pass_hz"
HIGH_PASS = "sensors.torque.high_pass_hz"
FILTERS = (LOW_PASS, BUTTERWORTH, HIGH_PASS)
"""Filters of the torque sensor. Values: time constants of the low passes [s], 1 / (2 pi corner) for the Butterworth of
the second order, so that 0 is no filter; corner of the high pass [Hz]."""
ECCENTRICITY = "sensors.encoder.eccentricity_rad"
ECCENTRIC = (f"{ECCENTRICITY}[0]", f"{ECCENTRICITY}[1]")
"""Errors of the encoder once and twice a turn of its own: the cosine's amplitude, which the sine's follows."""
MOTION = "motion.order"
"""Prefix of the ripple of the shaft's angle that the readings leave uncertain; no number of the file."""
OF_CHAIN = ("eccentricity", "low_pass", "high_pass")
"""Kinds of the parameters of the measuring chain beside zero, delay, gain and offset."""
START = "motion.start"
"""Prefix of the state in which a high pass enters each run of a record; no number of the file."""
OF_LOAD = ".load"
"""Suffix of the ripple that loads cause, whose angle is inverse to the squared speed."""
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
        leader: parameter with which this one departs, as the sine of an order with its cosine; empty for none.
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
    leader: str = ""

    @property
    def log_odds(self) -> float:
        """Logarithm of the odds of a departure; 0 for a parameter that follows another."""
        return math.log(self.probability / (1.0 - self.probability)) if self.may_depart else 0.0

    def spread(self, value: float) -> float:
        """Standard deviation of a departure of this size: a scale mixture, so that large mistakes stay possible."""
        return min(max(abs(value - self.nominal), self.departure), self.widest)

    @property
    def may_depart(self) -> bool:
        """True if a departure of its own is possible: not for one that follows another, or is uncertain by nature."""
        return not self.leader and self.probability > 0.0

    def departs(self, off_nominal: Collection[str]) -> bool:
        """Return true if the parameter, or the one that it follows, is among the departures."""
        return (self.leader or self.name) in off_nominal


def gain_factor(value: float) -> float:
    """Factor on the torque sensor's gain for a value of the parameter `GAIN`, 1 / (1 - value).

    With the inverse of the gain as parameter, a gain and the torques that compensate it lie on a straight line, which
    suits the steps of a fit.
    """
    return 1.0 / (1.0 - value)


def gain_value(factor: float) -> float:
    """Value of the parameter `GAIN` for a factor."""
    return 1.0 - 1.0 / factor
