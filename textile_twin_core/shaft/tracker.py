"""The recursive shaft estimator behind `causal` and `lag`, sample by sample."""

from __future__ import annotations

import math

from textile_twin_core.arrays import FloatArray
from textile_twin_core.shaft.encoder import EncoderNoise
from textile_twin_core.shaft.filter import ShaftFilter
from textile_twin_core.shaft.gate import Unwrapper
from textile_twin_core.shaft.hypotheses import LEAVING, HypothesisBank, Verdict
from textile_twin_core.shaft.past import Estimate, Past
from textile_twin_core.shaft.report import SampleReport
from textile_twin_core.shaft.settings import TrackerSettings
from textile_twin_core.shaft.watch import Watch

BANK_WIDTH = 20
MINDED = 0.8
"""From this weight of "something happened" on, the state reckons with it."""
FIRST_READING_RAD = 2e-3
FAR_RAD = 1e4
TEND_EVERY = 64
HOPELESS = 1e4
"""Variance of the angle [rad^2] and speed [rad/s] beyond which the filter has lost everything."""


class ShaftTracker:
    """Takes one sample after the other; `ready` collects the states, `lag_s` after their samples.

    An extended Kalman filter on the model of `ripple`, with the readings of `encoder`, the events of `hypotheses` and
    the caution of `watch`.
    """

    def __init__(self, settings: TrackerSettings, report: SampleReport, lag_s: float = 0.0) -> None:
        self._settings, self._report = settings, report
        self._noise = EncoderNoise(settings.step_rad, settings.stamp_jitter_s, settings.period_rad)
        self._unwrap = Unwrapper(settings.wrapping, settings.period_rad)
        self._watch = Watch(report)
        orders = list(range(1, settings.harmonics + 1))
        self._bank = HypothesisBank(BANK_WIDTH, list(range(settings.harmonics + 1, settings.max_harmonics + 1)))
        self._past = Past() if lag_s > 0 else None
        self._lag = lag_s
        self._filter = ShaftFilter(orders, settings.response_s, self._bank, self._past)
        self._first = 0.0
        self._speed_noise = 0.0
        self._until_birth = 0
        self._minded: Verdict | None = None
        self.ready: list[Estimate] = []

    def sample(self, step: float, raw: float, velocity: float) -> None:
        """Take one accepted sample, `step` seconds after the one before; a velocity of NaN is none."""
        watch, own = self._watch, self._filter
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
            self._restart(self._unwrap.local(raw, own.angle + own.level * step), own.level)
        else:
            watch.travel(own.predict(step, watch.turns > 1.0))
            own.disturb(*watch.process_noise(step), step)
            self._correct(self._unwrap.local(raw, own.angle), step)
        if not math.isnan(velocity):
            self._correct_speed(velocity)
        own.look()
        self._decide()

    def _begin(self, step: float, raw: float) -> None:
        if self._watch.samples == 1:
            self._first = self._unwrap.begin(raw)
            return
        local = self._unwrap.local(raw, self._first)
        speed = (local - self._first) / step
        self._watch.tick(step)
        self._restart(local, speed)
        known = self._noise.step if self._noise.known else FIRST_READING_RAD
        self._filter.start_from_two(known**2 + (speed * self._noise.jitter) ** 2 + 1e-12, step)

    def _restart(self, angle: float, speed: float, forget: bool = False) -> None:
        scale = self._watch.restart(speed)
        sigma = max(FIRST_READING_RAD, self._noise.step)
        self._filter.start(angle, speed, forget or self._watch.samples <= 2, scale, sigma)
        self._minded = None

    # Readings

    def _correct(self, angle: float, step: float) -> None:
        own, watch, noise = self._filter, self._watch, self._noise
        seen, column = own.angle_row()
        innovation = angle - own.angle
        predicted = max(float(column[0]), 0.0)
        if not (predicted < HOPELESS and abs(own.level) < HOPELESS):  # readings that follow no motion at all
            self._restart(angle, 0.0, forget=True)
            return
        if watch.is_leap(innovation, math.sqrt(predicted) + noise.step, step):
            if watch.leapt(innovation):
                self._jump(innovation)
            return
        innovation, variance, share = noise.reading(innovation, predicted, own.speed)
        if variance == math.inf:
            return
        net, spread = self._explained(seen, innovation, variance)
        own.correct(seen, column / variance, innovation, variance)
        watch.judge(net / math.sqrt(spread), step)
        if watch.quiet:
            noise.learn(net * net / spread, share)

    def _explained(self, seen: FloatArray, innovation: float, variance: float) -> tuple[float, float]:
        """The innovation less what the minded hypotheses expect of it, and its variance with theirs."""
        verdict = self._minded
        if verdict is None:
            return innovation, variance
        events = seen[self._filter.size : self._filter.size + self._bank.events]
        expected = float(events @ verdict.mean)
        return innovation - expected, variance + max(float((events * events) @ verdict.moment) - expected**2, 0.0)

    def _correct_speed(self, velocity: float) -> None:
        """Take the sensor's own speed as a further reading, of a noise that is learnt."""
        omega, seen, column = self._filter.speed_row()
        predicted = float(seen[: self._filter.size] @ self._filter.speed_gradient)
        if self._speed_noise == 0.0:
            self._speed_noise = (0.02 * max(abs(omega), 1.0)) ** 2
        innovation, variance = velocity - omega, predicted + self._speed_noise
        self._filter.correct(seen, column / variance, innovation, variance)
        surprise = min(innovation * innovation / variance, 100.0) - 1.0
        self._speed_noise *= math.exp(0.01 * self._speed_noise / variance * surprise)

    # What follows from them

    def _decide(self) -> None:
        """Weigh the hypotheses, write down the state, and take in the bank's oldest events before they are replaced."""
        watch, bank, own = self._watch, self._bank, self._filter
        if watch.lost:
            scale = watch.found_again()
            own.open_motion(0.02 * scale, 4.0 * scale, 2.0 * scale)
            self._startle(0.003)
        if watch.samples % TEND_EVERY == 0:
            own.tend()
            place = bank.best_order() if watch.settled and watch.calm else None
            if place is not None:
                own.take_in_order(place)
        verdict = None
        if watch.settled and not watch.doubtful:
            self._until_birth -= 1
            if self._until_birth <= 0:
                stride = max(1, round(self._settings.memory_s / BANK_WIDTH / watch.period_s))
                self._until_birth = stride
                bank.born(own.hypotheses, watch.knock_rate * watch.period_s * stride)
            watch.eventful = bank.weigh(watch.scale)
            if watch.eventful > LEAVING:
                verdict = bank.verdict(watch.eventful)
        else:
            watch.eventful = 0.0
        self._minded = verdict if verdict is not None and verdict.weight > MINDED else None
        self._write()
        if verdict is not None and self._until_birth <= 1 and bank.leaving(verdict):
            own.take_in(verdict, watch.crowding)
            self._minded = None
            watch.knock()

    def _write(self) -> None:
        watch, own, past, minded = self._watch, self._filter, self._past, self._minded
        (angle, omega, alpha), across, covariance = own.observed()
        watch.moving(omega)
        estimate = Estimate(angle, omega, alpha, covariance, self._unwrap.origin, watch.settled, watch.time_s)
        if past is not None:
            own.hold(past, estimate, across)
            while len(past) and past.oldest_time_s <= watch.time_s - self._lag:
                self.ready.append(own.let_go(past, minded))
        else:
            if minded is not None:
                shift, spread = own.blend(across, minded)
                estimate.move(shift, spread)
            self.ready.append(estimate)
        if abs(angle) > FAR_RAD:
            own.state[0] = self._unwrap.rebase(angle)

    def release(self) -> None:
        """Let go of every held state: nothing more will be learnt of them."""
        if self._past is not None:
            while len(self._past):
                self.ready.append(self._filter.let_go(self._past, self._minded))

    def _jump(self, leap: float) -> None:
        """The reading has leapt for good: the shaft is taken to run on as before, from another angle."""
        self._report.jumps += 1
        self.release()
        self._restart(self._filter.angle + leap, self._filter.level)
        self._filter.open_ripple(0.01)

    def _startle(self, ripple: float) -> None:
        self._filter.open_ripple(ripple)
        self._bank.clear(self._filter.hypotheses)
        self._minded = None

    def tell(self) -> None:
        """Bring the report up to date."""
        report, noise = self._report, self._noise
        report.resolution_rad = noise.step if noise.known else 0.0
        report.stamp_jitter_s = noise.jitter
        report.period_s = self._watch.period_s
        report.ripple = self._filter.amplitudes()
