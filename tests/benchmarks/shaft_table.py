"""Table of the shaft estimators: error of the torque computed from encoder angles, against latency and cost."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from tests.benchmarks.shaft_signal import KNOCKS, MANY_ORDERS, STEADY, EncoderSignal, encoder_signal
from textile_twin_core.arrays import FloatArray
from textile_twin_core.bench.timing import clock, one_core
from textile_twin_core.dynamics import INPUTS
from textile_twin_core.expression.loop import Loop
from textile_twin_core.machine import Machine
from textile_twin_core.machine.sensitivity import TorqueSensitivity
from textile_twin_core.shaft import ShaftStates, create_estimator

LAGS_S = {"causal": 0.0, "lag 20 ms": 0.02, "lag 40 ms": 0.04, "lag 80 ms": 0.08, "smooth": math.inf}
"""Estimators and their look-ahead; `smooth` uses the whole record."""
NO_ALPHA = "acceleration left out"
"""Row with the true angle and speed but without acceleration."""
BITS = (8, 10, 12, 14, 16)
DRAWN_BITS = (8, 12, 16)
SPEEDS = (0.125, 0.375, 2.5)
"""Speeds over the nominal speed of the machine."""
RECORD_S, SETTLED_S = 12.0, 2.0
"""Length of a record, and of its start, which is excluded [s]."""
_FIRST_SEED = 7000
_RPM = 30.0 / math.pi


@dataclass(frozen=True)
class ShaftRow:
    """One estimator on records of one condition. The last three attributes are None for a row without an estimator.

    Attributes:
        torque_rms_Nm: RMS error of the torque of inertia and weight, a smooth function of the shaft state [N m].
        torque_rms_over_peak: The same over the peak of that torque.
        inside_sigma: Share of samples whose error is below the estimated sigma (0.68 is correct).
        latency_s: Look-ahead [s]; half the record for `smooth`.
        us_per_sample: Median over the records, each processed in one block [us].
    """

    estimator: str
    machine: str
    bits: int
    rpm: float
    load: str
    torque_rms_Nm: float
    torque_rms_over_peak: float
    inside_sigma: float | None
    latency_s: float | None
    us_per_sample: float | None


@dataclass(frozen=True)
class Condition:
    """Condition of records: bits of the encoder, speed of the shaft [rad/s], and load (`LOADS`)."""

    bits: int
    speed_rad_s: float
    load: str

    def records(self, count: int, duration_s: float) -> list[EncoderSignal]:
        """Generate records that differ in phase, noise, lost samples and shocks."""
        return [
            encoder_signal(_FIRST_SEED + k, self.speed_rad_s, self.bits, self.load, duration_s) for k in range(count)
        ]


class SmoothTorque:
    """Torque of inertia and weight by its closed form, and its gradient by the shaft state."""

    def __init__(self, machine: Machine) -> None:
        torque = machine.model.output("torque_inertial_Nm") + machine.model.output("torque_gravity_Nm")
        self._program = Loop([torque], INPUTS)
        self._sensitivity = TorqueSensitivity(torque)

    def __call__(self, theta: FloatArray, omega: FloatArray, alpha: FloatArray) -> FloatArray:
        """Return the torque (n,) [N m]."""
        out = np.empty(theta.size)
        self._program([theta, omega, alpha], [out])
        return out

    def sigma(self, states: ShaftStates) -> FloatArray:
        """Return the standard deviation (n,) propagated from the covariance of the states [N m]."""
        gradient = self._sensitivity.gradient(states.phase_rad, states.omega_rad_s, states.alpha_rad_s2)
        return np.sqrt(np.maximum(states.variance_of(gradient), 0.0))


@dataclass
class _Tally:
    """Errors [N m], their positions relative to sigma, and times [us per sample], accumulated for one row."""

    errors: list[FloatArray] = field(default_factory=list)
    inside: list[FloatArray] = field(default_factory=list)
    times: list[float] = field(default_factory=list)


def conditions(machine: Machine) -> list[tuple[Condition, tuple[str, ...]]]:
    """List the conditions with their estimators: all bits at nominal speed, other speeds at 16 bits, for each load."""
    nominal = machine.nominal_speed_rad_s
    few = ("causal", "lag 40 ms", "smooth")
    found = []
    for load in (STEADY, KNOCKS):
        found += [(Condition(bits, nominal, load), tuple(LAGS_S) if bits in DRAWN_BITS else few) for bits in BITS]
        found += [(Condition(16, share * nominal, load), few) for share in SPEEDS]
    return found + [(Condition(bits, nominal, MANY_ORDERS), few) for bits in DRAWN_BITS]


@one_core()
def shaft_table(
    machine: Machine,
    records: int = 2,
    record_s: float = RECORD_S,
    wanted: Iterable[tuple[Condition, Sequence[str]]] | None = None,
    progress: Callable[[int, int], object] = lambda done, total: None,
) -> list[ShaftRow]:
    """Measure all conditions, or the wanted ones; in each record the estimators take turns.

    The truth is the closed form at the true state, so that the error is that of the estimator. `progress` is
    called with the
    numbers of finished and total records.
    """
    chosen = list(conditions(machine) if wanted is None else wanted)
    torque = SmoothTorque(machine)
    rows: list[ShaftRow] = []
    done = 0
    for condition, estimators in chosen:
        tallies = {name: _Tally() for name in (NO_ALPHA, *estimators)}
        peak = 0.0
        for signal in condition.records(records, record_s):
            true = torque(*signal.truth)
            peak = max(peak, float(np.abs(true).max()))
            theta, omega, alpha = signal.truth
            late = signal.time_s > SETTLED_S
            tallies[NO_ALPHA].errors.append((torque(theta, omega, np.zeros_like(alpha)) - true)[late])
            for name in estimators:
                _judge(tallies[name], name, signal, true, torque)
            done += 1
            progress(done, records * len(chosen))
        for name, tally in tallies.items():
            latency = None if name == NO_ALPHA else min(LAGS_S[name], record_s / 2.0)
            rows.append(_row(name, machine.name, condition, tally, peak, latency))
    return rows


def _judge(tally: _Tally, name: str, signal: EncoderSignal, true: FloatArray, torque: SmoothTorque) -> None:
    kind, *_ = name.split()
    estimator = create_estimator(kind, **({"shaft_lag_s": LAGS_S[name]} if kind == "lag" else {}))
    begin = clock()
    parts = [estimator.step(signal.stamps_ns, signal.angles_rad), estimator.finish()]
    spent = clock() - begin
    states = ShaftStates.join([part for part in parts if len(part)])
    error = torque(states.phase_rad, states.omega_rad_s, states.alpha_rad_s2) - true[states.index]
    late = signal.time_s[states.index] > SETTLED_S
    tally.errors.append(error[late])
    tally.inside.append((np.abs(error) <= torque.sigma(states))[late].astype(np.float64))
    tally.times.append(1e6 * spent / signal.stamps_ns.size)


def _row(name: str, machine: str, condition: Condition, tally: _Tally, peak: float, latency: float | None) -> ShaftRow:
    rms = float(np.sqrt(np.mean(np.concatenate(tally.errors) ** 2)))
    return ShaftRow(
        name,
        machine,
        condition.bits,
        round(condition.speed_rad_s * _RPM, 9),
        condition.load,
        rms,
        rms / peak,
        float(np.mean(np.concatenate(tally.inside))) if tally.inside else None,
        latency,
        statistics.median(tally.times) if tally.times else None,
    )
