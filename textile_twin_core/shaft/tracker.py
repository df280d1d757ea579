"""The recursive shaft filter behind `causal` and `lag`: extended Kalman filter, event hypotheses, rows of the past."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.shaft.encoder import EncoderNoise
from textile_twin_core.shaft.gate import Unwrapper
from textile_twin_core.shaft.hypotheses import HypothesisBank, Verdict
from textile_twin_core.shaft.past import Estimate, Past
from textile_twin_core.shaft.report import SampleReport
from textile_twin_core.shaft.ripple import (
    DIP,
    DIP_RATE,
    FIRST_RIPPLE,
    LEVEL,
    LOG_RESPONSE,
    SLOPE,
    THETA,
    Ripple,
    advance,
    blank_gradient,
    observe,
)
from textile_twin_core.shaft.turns import TURN
from textile_twin_core.shaft.watch import Watch

BANK_WIDTH = 20
RIPPLE_AT_START = 0.03
RIPPLE_AFTER_EVENT = 1e-4
"""Each event opens the ripple's coefficients by this much, so that a wrong ripple cannot live on as a row of events."""
MINDED = 0.5
"""From this weight of "something happened" on, the state reckons with it."""
FIRST_READING_RAD = 2e-3
FAR_RAD = 1e4
LONGEST_ARC = 0.3
"""Of an order's wave in one integration step [rad]."""
MOST_PARTS = 8
LARGEST_RIPPLE = 0.3


@dataclass(frozen=True)
class TrackerSettings:
    """Settings of the recursive estimators; the defaults need no tuning.

    Attributes:
        harmonics: orders of ripple from 1 on that are in the state from the start.
        max_harmonics: orders up to this one join when the samples show them.
        encoder_bits: bits of the encoder per turn; None: found.
        resolution_rad: or its step.
        stamp_jitter_s: standard deviation of the stamps; None: learnt.
        response_s: time constant of the drive's answer to a load knock, to begin with; it is learnt.
        wrapping: "auto", "wrapped" or "unwrapped".
        period_rad: what a wrapping angle wraps by.
        gap_s: pause after which the estimator starts anew.
        memory_s: how long after an event its time stays open.
    """

    harmonics: int = 2
    max_harmonics: int = 8
    encoder_bits: float | None = None
    resolution_rad: float | None = None
    stamp_jitter_s: float | None = None
    response_s: float = 0.04
    wrapping: str = "auto"
    period_rad: float = TURN
    gap_s: float = 1.0
    memory_s: float = 0.04

    @property
    def step_rad(self) -> float | None:
        """The encoder's step, when given."""
        return self.resolution_rad if self.encoder_bits is None else self.period_rad / 2.0**self.encoder_bits


class ShaftTracker:
    """Takes one sample after the other; `ready` collects the states, `lag_s` after their samples.

    The error matrix holds, row by row, the filter's state and below it (theta, omega, alpha) of each held sample; column
    by column, the state's covariance and one column per hypothesis. One rank-one step per sample updates all of it; the
    rows of the past make it a fixed-lag smoother (Biswas and Mahalanabis 1973).
    """

    def __init__(self, settings: TrackerSettings, report: SampleReport, lag_s: float = 0.0) -> None:
        self._settings, self._report = settings, report
        self._noise = EncoderNoise(settings.step_rad, settings.stamp_jitter_s, settings.period_rad)
        self._unwrap = Unwrapper(settings.wrapping, settings.period_rad)
        self._watch = Watch(report)
        self._orders = list(range(1, settings.harmonics + 1))
        self._bank = HypothesisBank(BANK_WIDTH, list(range(settings.harmonics + 1, settings.max_harmonics + 1)))
        self._past = Past() if lag_s > 0 else None
        self._lag = lag_s
        size = FIRST_RIPPLE + 2 * settings.harmonics
        self._state = np.zeros(size)
        self._state[LOG_RESPONSE] = math.log(settings.response_s)
        self._error = np.zeros((size, size + self._bank.columns))
        self._resize()
        self._speed_noise = 0.0
        self._until_birth = 0
        self._minded: Verdict | None = None
        self.ready: list[Estimate] = []

    def _resize(self) -> None:
        self._size = size = self._state.size
        self._transition = np.eye(size)
        self._gradient = blank_gradient(size)
        self._ripple = self._ripple_here()

    def _ripple_here(self) -> Ripple:
        return Ripple(float(self._state[THETA]), self._orders, self._state[FIRST_RIPPLE:].tolist())

    # One sample

    def sample(self, step: float, raw: float, velocity: float) -> None:
        """Take one accepted sample, `step` seconds after the one before; a velocity of NaN is none."""
        watch, state = self._watch, self._state
        self._noise.look(raw)
        watch.samples += 1
        if watch.samples <= 2:
            self._begin(step, raw)
            return
        gap = watch.is_gap(step, self._settings.gap_s)
        watch.tick(step)
        if gap:
            self._report.gaps += 1
            self.release()
            expected = float(state[THETA] + state[LEVEL] * step)
            self._restart(self._unwrap.local(raw, expected), float(state[LEVEL]))
        else:
            self._predict(step)
            self._correct(self._unwrap.local(raw, float(state[THETA])), step)
        if velocity == velocity:
            self._correct_speed(velocity)
        self._ripple = self._ripple_here()
        self._decide(step)

    def _begin(self, step: float, raw: float) -> None:
        state = self._state
        if self._watch.samples == 1:
            state[THETA] = self._unwrap.begin(raw)
            return
        local = self._unwrap.local(raw, float(state[THETA]))
        speed = (local - float(state[THETA])) / step
        self._watch.tick(step)
        self._restart(local, speed)
        error = self._error
        known = FIRST_READING_RAD if not self._noise.known else self._noise.step
        variance = known**2 + (speed * self._noise.jitter) ** 2 + 1e-12
        error[THETA, THETA] = variance
        error[LEVEL, LEVEL] = 2 * variance / step**2
        error[THETA, LEVEL] = error[LEVEL, THETA] = variance / step

    def _restart(self, angle: float, speed: float) -> None:
        """Start anew at an angle with a guess of the speed; what was learnt of ripple, response and encoder stays."""
        state, error, size = self._state, self._error, self._size
        first = self._watch.samples <= 2
        ripple = error[FIRST_RIPPLE:size, FIRST_RIPPLE:size].copy()
        response = float(error[LOG_RESPONSE, LOG_RESPONSE])
        error[:] = 0.0
        self._bank.clear(error[:size, size:])
        self._minded = None
        state[THETA], state[LEVEL] = angle, speed
        state[SLOPE] = state[DIP] = state[DIP_RATE] = 0.0
        scale = self._watch.restart(speed)
        at = np.arange(FIRST_RIPPLE, size)
        if first:
            ripple = np.zeros_like(ripple)
            response = 0.1
        error[FIRST_RIPPLE:size, FIRST_RIPPLE:size] = ripple
        error[at, at] += RIPPLE_AT_START**2 if first else 1e-6
        error[THETA, THETA] = max(FIRST_READING_RAD, self._noise.step) ** 2
        error[LEVEL, LEVEL] = (0.3 * scale) ** 2
        error[SLOPE, SLOPE] = (0.5 * scale) ** 2
        error[LOG_RESPONSE, LOG_RESPONSE] = response

    def _predict(self, step: float) -> None:
        state, error, size = self._state, self._error, self._size
        watch = self._watch
        highest = self._orders[-1] if self._orders else 1
        arc = abs(float(state[LEVEL])) * step * highest
        parts = 1 + min(int(arc / LONGEST_ARC), MOST_PARTS - 1)
        before = float(state[THETA])
        for part in range(parts):
            ripple = self._ripple if part == 0 else self._ripple_here()
            advance(state, ripple, step / parts, self._transition)
            error[:size] = self._transition @ error[:size]
            error[:, :size] = error[:, :size] @ self._transition.T
        moved = float(state[THETA]) - before
        watch.travel(moved)
        idle = self._bank.idle
        if idle and watch.turns > 1.0:
            middle = before + moved / 2
            wave = [f(k * middle) * moved for k in idle for f in (math.cos, math.sin)]
            error[THETA, size + self._bank.events :] += wave
        jerk, burst = watch.process_noise(step)
        error[SLOPE, SLOPE] += jerk
        cross = jerk * step / 2
        error[LEVEL, SLOPE] += cross
        error[SLOPE, LEVEL] += cross
        error[LEVEL, LEVEL] += jerk * step * step / 3
        error[DIP_RATE, DIP_RATE] += burst

    def _correct(self, angle: float, step: float) -> None:
        state, error, watch, noise = self._state, self._error, self._watch, self._noise
        innovation = angle - float(state[THETA])
        predicted = max(float(error[THETA, THETA]), 0.0)
        if watch.is_leap(innovation, math.sqrt(predicted) + noise.step, step):
            if watch.leapt(innovation):
                self._jump(innovation)
            return
        speed = (float(state[LEVEL]) + float(state[DIP])) * self._ripple.value
        innovation, variance, share = noise.reading(innovation, predicted, speed)
        if variance == math.inf:
            return
        seen = error[THETA].copy()
        column = error[:, THETA]
        seen[: self._size] = column[: self._size]  # so that rounding cannot make the covariance drift out of symmetry
        net, spread = self._explained(seen, innovation, variance)
        self._rank_one(seen, column / variance, innovation, variance)
        watch.judge(net / math.sqrt(spread), step)
        if watch.quiet:
            noise.learn(net * net / spread, share)

    def _explained(self, seen: FloatArray, innovation: float, variance: float) -> tuple[float, float]:
        """The innovation less what the minded hypotheses expect of it, and its variance with theirs."""
        verdict = self._minded
        if verdict is None:
            return innovation, variance
        events = seen[self._size : self._size + self._bank.events]
        expected = float(events @ verdict.mean)
        return innovation - expected, variance + max(float((events * events) @ verdict.moment) - expected**2, 0.0)

    def _correct_speed(self, velocity: float) -> None:
        """Take the sensor's own speed as a further reading, of a noise that is learnt."""
        size = self._size
        ripple = self._ripple_here()
        _, omega, _ = observe(self._state, ripple, self._gradient)
        gradient = self._gradient[1]
        seen = gradient @ self._error[:size]
        predicted = float(seen[:size] @ gradient)
        innovation = velocity - omega
        if self._speed_noise == 0.0:
            self._speed_noise = (0.02 * max(abs(omega), 1.0)) ** 2
        column = self._error[:, :size] @ gradient
        variance = predicted + self._speed_noise
        self._rank_one(seen, column / variance, innovation, variance)
        share = self._speed_noise / variance
        self._speed_noise *= math.exp(0.01 * share * (min(innovation * innovation / variance, 100.0) - 1.0))

    def _rank_one(self, seen: FloatArray, gain: FloatArray, innovation: float, variance: float) -> None:
        size = self._size
        if self._past is not None:
            past, mended = self._past, gain[size:].reshape(-1, 3)
            past.mean += mended * innovation
            past.covariance -= mended[:, :, None] * mended[:, None, :] * variance
        self._state += gain[:size] * innovation
        self._error -= gain[:, None] * seen
        self._bank.see(seen[size:], innovation, variance)

    # What follows from it

    def _decide(self, step: float) -> None:
        """Weigh the hypotheses, write down the state, and let the bank's oldest events go or take them in."""
        watch, bank, size = self._watch, self._bank, self._size
        if watch.lost:
            self._open()
        if watch.samples % 64 == 0:
            self._tend()
        verdict = None
        if watch.settled:
            self._until_birth -= 1
            if self._until_birth <= 0:
                stride = max(1, round(self._settings.memory_s / BANK_WIDTH / watch.period_s))
                self._until_birth = stride
                bank.born(self._error[:, size:], watch.knock_rate * watch.period_s * stride)
            verdict = bank.verdict(watch.scale)
            watch.eventful = verdict.weight
        self._minded = verdict if verdict is not None and verdict.weight > MINDED else None
        self._write(self._minded)
        if verdict is not None and self._until_birth <= 1 and bank.leaving(verdict):
            self._take_in(verdict)

    def _write(self, minded: Verdict | None) -> None:
        watch, size = self._watch, self._size
        gradient = self._gradient
        angle, omega, alpha = observe(self._state, self._ripple, gradient)
        across = gradient @ self._error[:size]
        covariance = across[:, :size] @ gradient.T
        watch.moving(omega)
        estimate = Estimate(angle, omega, alpha, covariance, self._unwrap.origin, watch.settled, watch.time_s)
        past = self._past
        if past is not None:
            if past.full:
                self._grow(past)
            row = size + 3 * past.push(estimate)
            self._error[row : row + 3] = across
            while len(past) and past.oldest_time_s <= watch.time_s - self._lag:
                self._let_go(past, minded)
        else:
            if minded is not None:
                shift, spread = _blend(across[:, size : size + self._bank.events], minded)
                estimate.angle += float(shift[0])
                estimate.omega += float(shift[1])
                estimate.alpha += float(shift[2])
                estimate.covariance = covariance + spread
            self.ready.append(estimate)
        if abs(angle) > FAR_RAD:
            self._state[THETA] = self._unwrap.rebase(angle)

    def _let_go(self, past: Past, verdict: Verdict | None) -> None:
        row = self._size + 3 * past.oldest
        rows = self._error[row : row + 3]
        if verdict is None:
            shift, spread = np.zeros(3), np.zeros((3, 3))
        else:
            shift, spread = _blend(rows[:, self._size : self._size + self._bank.events], verdict)
        self.ready.append(past.pop(shift, spread))
        rows[:] = 0.0

    def _grow(self, past: Past) -> None:
        size = self._size
        rows = past.grow()
        error = np.zeros((size + 3 * past.capacity, self._error.shape[1]))
        error[:size] = self._error[:size]
        error[size : size + rows.size] = self._error[size:][rows]
        self._error = error

    def release(self) -> None:
        """Let go of every held state: nothing more will be learnt of them."""
        if self._past is not None:
            while len(self._past):
                self._let_go(self._past, self._minded)

    def _take_in(self, verdict: Verdict) -> None:
        """Replace the mixture of what may have happened by one Gaussian, of the same mean and covariance."""
        size, error, bank = self._size, self._error, self._bank
        columns = error[:, size : size + bank.events]
        shift = columns @ verdict.mean
        error[:, :size] += (columns * verdict.moment) @ columns[:size].T - shift[:, None] * shift[:size]
        if self._past is not None:
            rows = columns[size:].reshape(-1, 3, bank.events)
            moved = shift[size:].reshape(-1, 3)
            self._past.covariance += (rows * verdict.moment) @ rows.transpose(0, 2, 1)
            self._past.covariance -= moved[:, :, None] * moved[:, None, :]
            self._past.mean += moved
        self._state += shift[:size]
        self._open_ripple(RIPPLE_AFTER_EVENT)
        bank.clear(error[:, size:])  # the idle orders too: an event looks like some of each
        self._minded = None
        self._watch.knock()
        self._ripple = self._ripple_here()

    def _open(self) -> None:
        """The state has lost the shaft: open it to whatever speed and acceleration the next samples show."""
        error, size, scale = self._error, self._size, self._watch.found_again()
        error[LEVEL, LEVEL] += (0.02 * scale) ** 2
        error[SLOPE, SLOPE] += (4.0 * scale) ** 2
        error[DIP_RATE, DIP_RATE] += (2.0 * scale) ** 2
        self._open_ripple(0.003)
        self._bank.clear(error[:, size:])
        self._minded = None

    def _jump(self, leap: float) -> None:
        """The reading has leapt for good: the shaft is taken to run on as before, from another angle."""
        self._report.jumps += 1
        self.release()
        speed = float(self._state[LEVEL])
        self._restart(float(self._state[THETA]) + leap, speed)
        self._error[LEVEL, LEVEL] = (0.05 * self._watch.scale) ** 2
        self._open_ripple(0.01)

    def _open_ripple(self, sigma: float) -> None:
        """Let the ripple's coefficients change by so much, within what they were trusted to be at the start."""
        at = np.arange(FIRST_RIPPLE, self._size)
        own = self._error[at, at]
        self._error[at, at] = np.maximum(own, np.minimum(own + sigma**2, RIPPLE_AT_START**2))

    def _tend(self) -> None:
        """Now and then: keep the covariance symmetric and open, and take in orders of ripple that have shown."""
        size, error = self._size, self._error
        error[:size, :size] = (error[:size, :size] + error[:size, :size].T) / 2
        at = np.arange(FIRST_RIPPLE, size)
        error[at, at] += 1e-12
        error[LOG_RESPONSE, LOG_RESPONSE] = min(float(error[LOG_RESPONSE, LOG_RESPONSE]) + 1e-6, 0.1)
        if np.abs(self._state[FIRST_RIPPLE:]).max(initial=0.0) > LARGEST_RIPPLE:  # no shaft: what looked like ripple was not
            self._state[FIRST_RIPPLE:] = 0.0
            error[at] = 0.0
            error[:, at] = 0.0
            error[at, at] = RIPPLE_AT_START**2
        self._state[LOG_RESPONSE] = min(max(float(self._state[LOG_RESPONSE]), math.log(0.004)), math.log(1.0))
        place = self._bank.best_order() if self._watch.settled and self._watch.calm else None
        if place is not None:
            self._take_in_order(place)

    def _take_in_order(self, place: int) -> None:
        size, bank = self._size, self._bank
        at = size + bank.events + 2 * place
        columns = self._error[:, at : at + 2]
        order, mean, variance = bank.remove_order(place)
        shift = columns @ mean
        block = self._error[:, :size] + (columns * variance) @ columns[:size].T
        own = columns * variance
        kept = np.delete(self._error[:, size:], [at - size, at - size + 1], axis=1)
        rows = np.zeros((2, size + 2 + kept.shape[1]))
        rows[:, :size] = own[:size].T
        rows[:, size : size + 2] = np.diag(variance)
        wide = np.concatenate([block, own, kept], axis=1)
        self._error = np.concatenate([wide[:size], rows, wide[size:]])
        self._state = np.concatenate([self._state + shift[:size], mean])
        if self._past is not None:
            moved = shift[size:].reshape(-1, 3)
            past_rows = columns[size:].reshape(-1, 3, 2)
            self._past.mean += moved
            self._past.covariance += (past_rows * variance) @ past_rows.transpose(0, 2, 1)
        self._orders.append(order)
        self._resize()

    def tell(self) -> None:
        """Bring the report up to date."""
        report, noise = self._report, self._noise
        report.resolution_rad = noise.step if noise.known else 0.0
        report.stamp_jitter_s = noise.jitter
        report.period_s = self._watch.period_s
        pairs = self._state[FIRST_RIPPLE:].reshape(-1, 2)
        size = dict(zip(self._orders, np.hypot(pairs[:, 0], pairs[:, 1]).tolist(), strict=True))
        report.ripple = tuple(size.get(k, 0.0) for k in range(1, max(self._orders, default=0) + 1))


def _blend(rows: FloatArray, verdict: Verdict) -> tuple[FloatArray, FloatArray]:
    """Shift and spread that the hypotheses add to a state with the given (3, events) error rows."""
    shift = rows @ verdict.mean
    return shift, (rows * verdict.moment) @ rows.T - shift[:, None] * shift
