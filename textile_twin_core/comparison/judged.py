"""A judged record: its posterior, the share of the torque that stays unexplained, and what each departure explains."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.comparison.change_in_time import ChangeInTime
from textile_twin_core.comparison.evidence import Evidence
from textile_twin_core.comparison.torque_readings import TimeLine
from textile_twin_core.comparison.uncertainty import Estimate
from textile_twin_core.inference.measurement import Hypothesis
from textile_twin_core.inference.parameter import DELAY, GAIN, OFFSET, ZERO, gain_factor
from textile_twin_core.inference.posterior import Posterior
from textile_twin_core.inference.record import MOST_SAMPLES
from textile_twin_core.inference.settled import Settled, settle, settled_sensors

_ORDERS = 12
"""Highest order of the shaft in `best_periodic`."""
_SHOWN = 2.0
"""Standard deviations below which a covariance of residuals counts as zero, or as that of the uncertain motion."""


@dataclass(frozen=True)
class Judged:
    """A record and its posterior.

    Attributes:
        evidence: the record. posterior: of the record, by samples or block averages.
        ratio: of the encoder over the configured one. encoder_turn_rad: shaft angle of a turn of the encoder.
        explained: share of the torque's variance that the values of the posterior explain, sample by sample.
        torque_by_speed_Nms: fall of the torque with the speed; where it is not 0, delay and inertia look alike.
        lines: of the torque, fixed in time, that were taken out of it.
        changing: force or gain that changes within the record, whose change was taken out of the torque.
    """

    evidence: Evidence
    posterior: Posterior
    ratio: float
    encoder_turn_rad: float
    explained: float
    torque_by_speed_Nms: float
    lines: tuple[TimeLine, ...] = ()
    changing: ChangeInTime | None = None

    @cached_property
    def unexplained(self) -> float:
        """Share of the torque's variance that stays unexplained, without the noise of single samples and of the motion.

        Noise is independent between samples, so the covariance of neighbouring residuals counts; means over a turn
        overlap, so there it is that of every other one. If the machine explains less than its departures from
        nominal cost, noise is no excuse and the whole unexplained share counts.
        """
        p = self.posterior
        m = p.measurement
        residual, good = m.residual(p.hypothesis, p.fit.x)
        means, good = m.means(np.column_stack([residual, m.record.torque_Nm]), good)
        square, variance = float(np.mean(means[good, 0] ** 2)), max(float(np.var(means[good, 1])), 1e-300)
        if not 0.5 * np.count_nonzero(good) * math.log(variance / max(square, 1e-300)) > p.prior_cost:
            return square / variance
        if self.whole_turns:
            product = (means[:-2, 0] * means[2:, 0])[good[:-2] & good[2:]]
        else:
            turning = self.evidence.thinned(self.evidence.time_s.size)
            first = np.unique(np.linspace(0, turning.time_s.size - 2, MOST_SAMPLES // 2).astype(np.int64))
            k = np.concatenate([first, first + 1])
            record = replace(m.record, time_s=turning.time_s[k], torque_Nm=turning.torque_Nm[k], block_s=0.0)
            residual, good = m.on(record).residual(p.hypothesis, p.fit.x)
            (one, other), both = residual.reshape(2, -1), good.reshape(2, -1).all(0)
            product, variance = (one * other)[both], max(float(np.var(turning.torque_Nm[first])), 1e-300)
        if not product.size:
            return 1.0
        shown = float(np.mean(product)) - _SHOWN * float(np.std(product)) / math.sqrt(product.size)
        shown -= (_SHOWN * p.hypothesis.gain * m.uncertain_Nm) ** 2
        return max(shown, 0.0) / variance

    @property
    def whole_turns(self) -> bool:
        """True if means over whole turns were fitted: the machine's torque does not depend on the angle."""
        return not self.posterior.measurement.model.depends_on_angle()

    @cached_property
    def settled(self) -> Settled:
        """Estimates of sensors and friction, given the machine file and its tolerances."""
        return settle(self.posterior, settled_sensors(self.posterior, self.evidence.turns_in_both_directions()))

    @cached_property
    def sensors(self) -> Hypothesis:
        """The hypothesis with the settled values of the sensors."""
        p, found = self.settled, self.posterior.hypothesis
        return replace(
            found,
            zero_rad=found.zero_rad + p.value(ZERO),
            gain=found.gain * gain_factor(p.value(GAIN)),
            offset_Nm=found.shown_offset(p.value(OFFSET)),
            delay_s=found.delay_s + p.value(DELAY),
        )

    @property
    def delay(self) -> Estimate:
        """Delay of the torque [s] in the posterior; at one speed with the departure of the zero, which acts alike."""
        p = self.posterior
        per_value = {DELAY: 1.0}
        if self.evidence.track.at_one_speed:
            per_value[ZERO] = 1.0 / (p.hypothesis.turn * self.evidence.working_speed())
        weights = np.array(list(per_value.values()))
        value = p.hypothesis.delay_s + sum(weight * p.departure(name) for name, weight in per_value.items())
        sigma = math.sqrt(max(float(weights @ p.covariance(list(per_value)) @ weights), 0.0))
        return Estimate.normal(value, sigma)

    @cached_property
    def effects_Nm(self) -> dict[str, float]:
        """Root mean square [N m] of the torque that each departure explains, as fitted; a group under its leader."""
        p = self.posterior
        m = p.measurement
        seen = m.expected(p.hypothesis, p.fit.x, slopes=True)
        assert seen.slopes is not None
        slopes, good = m.means(seen.slopes, seen.good)
        away = p.fit.x - m.nominal
        out: dict[str, FloatArray] = {}
        for k, known in enumerate(m.parameters):
            if away[k]:
                name = known.leader or known.name
                out[name] = out.get(name, 0.0) + slopes[good, k] * away[k]
        return {name: float(np.sqrt(np.mean(torque**2))) for name, torque in out.items()}


def best_periodic(found: Judged) -> float:
    """Share of the torque's mean square about its mean that J(theta) alpha + C(theta) omega^2 + G(theta) can explain.

    J, C and G are any functions with orders up to 12 (J: 4) of the shaft angle, by least squares.
    """
    p, turning = found.posterior, found.evidence.thinned()
    record = replace(p.measurement.record, time_s=turning.time_s, torque_Nm=turning.torque_Nm, block_s=0.0)
    m = p.measurement.on(record)
    plain = replace(p.hypothesis, filters=frozenset())
    theta, omega, alpha, good = m.states(plain, m.values(p.fit.x))[0]
    theta, torque = theta[good], turning.torque_Nm[good]
    omega = omega[good] / max(abs(turning.working_speed()), 1e-300)
    alpha = alpha[good] / max(float(np.std(alpha[good])), 1e-300)
    waves = [np.ones_like(theta)]
    for order in range(1, _ORDERS + 1):
        waves += [np.cos(order * theta), np.sin(order * theta)]
    columns = [*waves, *(wave * omega**2 for wave in waves), *(wave * alpha for wave in waves[:9])]
    matrix = np.stack(columns, axis=1)
    solved = np.linalg.lstsq(matrix, torque, rcond=1e-8)[0]
    residual = torque - matrix @ solved
    freedom = max(torque.size - matrix.shape[1], 1)
    unexplained = float(residual @ residual) / freedom
    return float(1.0 - unexplained / max(float(np.var(torque)), 1e-300))
