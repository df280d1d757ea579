"""How the filter judges itself and the shaft: typical times, misfit, gaps, leaps, standstill, process noise."""

from __future__ import annotations

import math

from textile_twin_core.shaft.report import SampleReport
from textile_twin_core.shaft.turns import TURN

KNOCKS_BEFORE_HZ = 0.3
KNOCK_MEMORY_S = 60.0
SETTLING_TURNS = 1.0
SETTLING_SAMPLES = 50
FASTEST_CHANGE_HZ = 60.0
"""No shaft changes its speed faster than by this many times its usual speed per second."""
MISFIT_LOST = 9.0
LOST_SAMPLES = 10
"""Hypotheses of what has just begun need so many samples to gain weight."""
DRIFT_S = 0.25
CALM_S = 0.15
CROWD, DOUBT_TURNS = 5.0, 2.5
"""Events within about two turns that are too many, and for how many turns none is believed then."""
LEAST_INTENSITY, FIRST_INTENSITY, MOST_INTENSITY = math.log(1e-10), math.log(3e-8), math.log(10.0)


class Watch:
    """Running figures over the samples; all scales follow the usual speed of the shaft, none is a machine's.

    Attributes:
        samples: accepted samples.
        turns: turns since the (re)start.
        time_s: time since the first sample.
        period_s: typical time between samples.
        eventful: weight of the hypothesis that something happened of late.
    """

    def __init__(self, report: SampleReport) -> None:
        self._report = report
        self.samples = 0
        self.turns = 0.0
        self.time_s = 0.0
        self.period_s = 0.0
        self.eventful = 0.0
        self._usual = 0.0
        self._since = 0
        self._misfit, self._misfits = 1.0, 0
        self._misfits = 0
        self._drift = 0.0
        self._log_intensity = FIRST_INTENSITY
        self._knocks = KNOCKS_BEFORE_HZ
        self._watched_s = 1.0
        self._leap: float | None = None
        self._leaps = 0
        self._sense = 0
        self._still = False
        self._slow_s = 0.0
        self._calm_s = 0.0
        self._crowd = 0.0
        self._doubt_turns = 0.0

    # Time

    def is_gap(self, step: float, gap_s: float) -> bool:
        """Whether nothing of the old motion can be carried over this pause."""
        return step > gap_s and step > 10.0 * self.period_s

    def tick(self, step: float) -> None:
        """Another sample, `step` after the one before."""
        self.time_s += step
        self._since += 1
        if self.period_s == 0.0:
            self.period_s = step
        else:
            self.period_s += max(0.01, 1.0 / self.samples) * (min(step, 10.0 * self.period_s) - self.period_s)

    def restart(self, speed: float) -> float:
        """Begin to settle anew; the scale of speed."""
        self.turns = 0.0
        self._since = 0
        self._misfit, self._misfits = 1.0, 0
        self.eventful = 0.0
        self._usual = max(self._usual, abs(speed))
        return self.scale

    def travel(self, moved: float) -> None:
        """The shaft moved by so much [rad]."""
        turns = min(abs(moved) / TURN, 1.0)
        self.turns += turns
        self._crowd *= 1.0 - 0.5 * turns
        self._doubt_turns = max(self._doubt_turns - turns, 0.0)

    @property
    def scale(self) -> float:
        """The usual speed [rad/s], from which sizes of events and noises follow."""
        return max(self._usual, 0.5)

    @property
    def settled(self) -> bool:
        """Whether the ripple has been seen once around, or the shaft is at rest."""
        return (self.turns > SETTLING_TURNS and self._since > SETTLING_SAMPLES) or self._still

    # Noise

    def process_noise(self, step: float) -> tuple[float, float]:
        """Variances that a step adds to V' and to w'; the latter while the ripple is being learnt."""
        square = self.scale * self.scale
        burst = 4.0 * square * math.exp(-self.turns / 0.27) * step if self.turns < 4.0 else 0.0
        if self.doubtful:
            burst += 0.3 * square * step
        return math.exp(self._log_intensity) * square * step, burst

    def judge(self, normalised: float, step: float) -> None:
        """Take in one normalised innovation.

        Innovations of a well-tuned filter are white: their slow part, scaled to variance one, drives the intensity of
        the noise on V' up when it is larger and down when it is smaller (after Mehra 1970).
        """
        square = normalised * normalised
        self._misfit += 0.25 * (min(square, 100.0) - self._misfit)
        self._misfits = self._misfits + 1 if self._misfit > MISFIT_LOST else 0
        fade = min(step / DRIFT_S, 0.5)
        self._drift += fade * (normalised - self._drift)
        self._calm_s += step
        if not self.settled or not self.calm:
            return
        ratio = self._drift * self._drift * (2.0 - fade) / fade
        change = (min(ratio, 9.0) - 1.0) * 2.0 * step
        self._log_intensity = min(max(self._log_intensity + change, LEAST_INTENSITY), MOST_INTENSITY)

    @property
    def quiet(self) -> bool:
        """Whether nothing special goes on."""
        return self.eventful < 0.25 and self._misfit < 4.0

    @property
    def doubtful(self) -> bool:
        """Whether events came so thickly that they must be something else: a ripple not yet in the state."""
        return self._doubt_turns > 0.0

    @property
    def calm(self) -> bool:
        """Whether nothing special has gone on for a while."""
        return self.doubtful or (self.quiet and self._calm_s > CALM_S)

    @property
    def lost(self) -> bool:
        """Whether the innovations are beyond what any hypothesis allows."""
        return self._misfits >= LOST_SAMPLES and not self.doubtful

    def found_again(self) -> float:
        """The filter was opened; the scale of speed."""
        self._startle()
        self._report.transients += 1
        return self.scale

    # Events

    @property
    def knock_rate(self) -> float:
        """Knocks per second to reckon with."""
        return self._knocks / self._watched_s

    def knock(self) -> None:
        """A knock was taken in."""
        self._report.knocks += 1
        self._knocks += 1.0
        self._crowd += 1.0
        if self._crowd > CROWD:
            self._crowd, self._doubt_turns = 0.0, DOUBT_TURNS
        self.eventful = 0.0
        self._startle()

    @property
    def crowding(self) -> float:
        """How near another event would come to being one too many, from 0 to 1."""
        return min((self._crowd + 1.0) / CROWD, 1.0) ** 4

    def _startle(self) -> None:
        self._misfit, self._misfits, self._drift, self._calm_s = 1.0, 0, 0.0, 0.0

    def is_leap(self, innovation: float, sigma: float, step: float) -> bool:
        """Whether no shaft can be where the reading says."""
        reach = 8.0 * sigma + 0.02 + 0.5 * FASTEST_CHANGE_HZ * self.scale * step * step
        if abs(innovation) <= reach:
            self._leap, self._leaps = None, 0
            return False
        return True

    def leapt(self, innovation: float) -> bool:
        """Take note of a leap; True when it lasts, so that the reading must be believed."""
        before, self._leap = self._leap, innovation
        self._leaps += 1
        if before is None:
            self._report.outliers += 1
            return False
        if abs(innovation - before) < 0.2 * abs(innovation) + 0.02 or self._leaps > 4:
            self._report.outliers -= self._leaps - 1 if self._leaps <= 4 else 1
            self._leap, self._leaps = None, 0
            return True
        self._report.outliers += 1
        return False

    def moving(self, omega: float) -> None:
        """Follow the speed: usual speed, sense of rotation, standstill."""
        step = self.period_s
        fade = min(step / 5.0, 1.0)
        self._usual = max(self._usual * (1.0 - 0.02 * fade), abs(omega)) if self.settled else max(self._usual, 0.5)
        self._knocks *= 1.0 - step / KNOCK_MEMORY_S
        self._watched_s += step * (1.0 - self._watched_s / KNOCK_MEMORY_S)
        slow = 0.01 * self.scale
        self._slow_s = self._slow_s + step if abs(omega) < slow else 0.0
        if self._slow_s > 0.2 and not self._still:
            self._still = True
            self._report.standstills += 1
        if abs(omega) > 3.0 * slow:
            self._still = False
        if abs(omega) > 10.0 * slow:
            sense = 1 if omega > 0 else -1
            if self._sense == -sense:
                self._report.reversals += 1
            self._sense = sense
        self._report.state = "standstill" if self._still else "running" if self.settled else "settling"
