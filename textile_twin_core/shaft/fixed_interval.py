"""Fixed-interval smoothing of a whole record, with the model selected stretch by stretch (view `smooth`)."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from textile_twin_core.arrays import BoolArray, FloatArray
from textile_twin_core.shaft import layout
from textile_twin_core.shaft.constants import (
    BETTER,
    CHANGED,
    CONVERGENCE,
    FEWEST_HELD,
    FEWEST_ROWS,
    FINEST_RAD2,
    FIRST_LOOK,
    FIRST_WEIGHT,
    HELD_CLIP,
    HELD_EVERY,
    HELD_PARTS,
    INDEPENDENT,
    LEAST_JITTER,
    LEAST_LED,
    LEAST_LEFT,
    LESS_NOISE,
    LESS_SURE,
    LOOK_EVERY,
    MODEL_PARTS,
    MODEL_ROWS,
    MOST_CORRELATED,
    MOST_KNOWN,
    NORMAL_MEDIAN,
    OVERLAP,
    PENALTY,
    PITCH_PASSES,
    REPEATING,
    SEEN_CYCLES,
    UNSURE,
)
from textile_twin_core.shaft.encoder import ToothWheel
from textile_twin_core.shaft.estimator import PIECE, Part, ShaftEstimator, joined, states_of
from textile_twin_core.shaft.filter import Block
from textile_twin_core.shaft.measurement_noise import measurement_variance
from textile_twin_core.shaft.residual_orders import add_omitted, set_sensor_power
from textile_twin_core.shaft.ripple import set_second
from textile_twin_core.shaft.rts_smoother import adopt_weight, new_smoother, scale_covariances, smooth_model
from textile_twin_core.shaft.states import ShaftStates
from textile_twin_core.shaft.status import ROW, STATE, STRETCH, Records, Stamps
from textile_twin_core.shaft.turns import TURN


class SmoothEstimator(ShaftEstimator):
    """Filters while samples come in and smooths at `finish`."""

    at_once = False

    def _begin(self) -> None:
        # Copies of the status where each ripple was known best; `received` is the last sample with this ripple.
        self._known: list[Records] = []
        self._taken, self._due = 0, FIRST_LOOK
        self._guessed = 0.0  # samples for which the encoder's step was a guess
        self._blocks: list[Part] = []
        self._new: list[Part] = []
        self._count = 0

    def step(self, stamps: ArrayLike, angles: ArrayLike, velocities: ArrayLike | None = None) -> ShaftStates:
        """Process a block of samples; no state is ready before `finish`."""
        parts = self._walk(stamps, angles, velocities)
        self._new.extend(parts)
        self._count += sum(len(rows) for _, rows in parts)
        if self._count >= PIECE:  # the system reclaims the memory of large arrays, not of many small ones
            self._blocks.append(joined(self._new))
            self._count = 0
        return ShaftStates.empty(self._last)

    def _piece(self) -> int:
        return min(super()._piece(), self._due - self._taken)

    def _take(self, block: Block, ready: Stamps, rows: Records) -> int:
        count = super()._take(block, ready, rows)
        self._taken += block.stamps.size
        if self._status["noise"]["guessed"][0] > 0.0:
            self._guessed = self._status["counts"]["received"][0]
        if self._taken == self._due:
            self._due += min(self._taken, LOOK_EVERY)
            self._keep_ripple()
        return count

    def _keep_ripple(self) -> None:
        """Store the status if its ripple is certain: it replaces the last one unless the ripple changed."""
        ripple, sigma, reading = _ripple(self._confirmed)
        if not 0.0 < sigma < CHANGED * reading:
            return
        if self._known:
            before, sigma_before, _ = _ripple(self._known[-1])
            if _rms(ripple - before) < max(CHANGED * reading, UNSURE * float(np.hypot(sigma, sigma_before))):
                if sigma > LESS_SURE * sigma_before:
                    self._known[-1]["counts"]["received"] = self._confirmed["counts"]["received"]
                    return
                self._known.pop()
        self._known.append(self._confirmed.copy())
        if len(self._known) > MOST_KNOWN:
            del self._known[1::2]

    @property
    def _confirmed(self) -> Records:
        """The filter's status without a provisional reading."""
        return self._status[1:] if self._status["gate"]["provisional"][0] > 0.0 else self._status[:1]

    def finish(self) -> ShaftStates:
        """Return the states of all samples from the third on."""
        blocks = self._blocks + self._new
        if not blocks:
            return ShaftStates.empty(self._last)
        self._blocks, self._new = [], []  # `joined` releases their memory
        stamps, rows = joined(blocks)
        self._keep_ripple()
        if not self._known or self._known[-1]["counts"]["received"][0] != self._confirmed["counts"]["received"][0]:
            self._known.append(self._confirmed.copy())
        for status in self._known:  # ripple changes, the sensor does not
            set_sensor_power(status[0], float(self._confirmed["orders"]["sensor_power"][0]))
        self._correct_standstills(rows)
        self._smooth(rows)
        super().finish()
        return states_of([(stamps, _compact(rows))])

    def _correct_standstills(self, rows: Records) -> None:
        """Correct the noise of readings at standstill before the encoder's step was known, to that of the step.

        At standstill filters rely on the guessed step; while the shaft turns they estimate the noise.
        """
        noise, step = self._status["noise"][0], self._finder.step
        if step:
            known = max(MOST_CORRELATED * step**2 / 12.0, noise["additive"], noise["standstill"]) + FINEST_RAD2
            still = (rows["index"] < self._guessed) & (rows["noise"] == rows["unit"]) & (rows["unit"] > known)
            rows["noise"][still] = rows["unit"][still] = known

    def _smooth(self, rows: Records) -> None:
        """Smooth each stretch; repeat with a toothed wheel, whose pitch errors are estimated from the residuals."""
        if self._status["repeats"]["share"][0] > REPEATING:
            _reject_copies(rows, float(self._status["repeats"]["longest"][0]))
        cuts = np.flatnonzero(rows["cut"] >= STRETCH).tolist()
        stretches = [rows[first:end] for first, end in pairwise([*cuts, len(rows)])]
        for stretch in stretches:
            self._choose_first_memories(stretch[: 2 * CONVERGENCE + 1])
        wheel = self._wheel
        self._lowered = False  # whether a part of the record has less noise than the filter stated
        passes = PITCH_PASSES if wheel is not None and wheel.learning and rows.size else 0
        for done in range(passes + 1):
            for stretch in stretches:
                if len(stretch) >= FEWEST_ROWS:
                    self._smooth_stretch(stretch, done == passes)
            if wheel is not None and done < passes:
                self._learn_wheel(wheel, rows, done == 0)
        weight = np.array(FIRST_WEIGHT)
        scale_covariances(weight, rows)
        if self._lowered:
            _set_jitter(self._status["noise"], rows)
        adopt_weight(self._status, weight)

    def _choose_first_memories(self, rows: Records) -> None:
        """Set memories of the first half of rows to the second half's shortest, unless the bank's are much likelier."""
        if len(rows) < FEWEST_ROWS:
            return
        first, smoother = len(rows) // 2, new_smoother(self._settings, len(rows))
        own, fits = rows["memory"][:first].copy(), []
        for memories in (own, np.min(rows["memory"][first:], axis=0)):
            rows["memory"][:first] = memories
            fits.append(smooth_model(smoother, self._known[-1]["bank"][0], layout.PLAIN, rows, 1, 0))
        if fits[0] > fits[1] + PENALTY * first:
            rows["memory"][:first] = own

    def _learn_wheel(self, wheel: ToothWheel, rows: Records, first: bool) -> None:
        """Remove pitch errors from the readings; at first also from their noise and from the stored ripples."""
        residual = rows["reading"] - rows["phase"] - (rows["turns"] - rows["origin"]) * TURN
        change = wheel.learn(rows["reading"], residual)
        rows["reading"] += change
        if not first:
            return
        left = np.median((residual + change) ** 2) / max(np.median(residual**2), FINEST_RAD2)
        for field in ("noise", "unit"):
            rows[field] *= np.clip(left, LEAST_LEFT, 1.0)
        last = self._known[-1]["bank"][0]
        mine = last["models"]["sensor_ripple"][int(last["models"]["leading"])].copy()
        for status in [*self._known, self._status]:
            filters, models = status["bank"][0]["filters"], status["bank"][0]["models"]
            for f in range(1, layout.MODELS):
                ripple, waves = filters["ripple"][:, models["best"][f]], int(models["waves"][f])
                ripple[: 2 * waves] -= mine[: 2 * waves]
                set_second(ripple, waves, float(last["wave"]["lowest"]), models["second"][f])
            models = status["bank"]["models"]
            models["sensor_ripple"], models["shaft_second"] = 0.0, models["second"]

    def _smooth_stretch(self, rows: Records, last: bool) -> None:
        """Smooth a stretch in parts of one model each, selected wherever the stored ripple changed.

        The `last` smoothing of a record corrects the noise of the readings first.
        """
        known, estimated = self._known, self._settings.stamp_jitter_s is None
        changes = np.searchsorted(rows["index"], [status["counts"]["received"][0] for status in known[:-1]])
        led = np.bincount(rows["leading"].astype(np.int64), minlength=layout.MODELS) > LEAST_LED * len(rows)
        parts: list[tuple[int, Records, int]] = []
        for i, (first, end) in enumerate(pairwise([0, *changes.tolist(), len(rows)])):
            if end > first:
                near = known[max(i - 1, 0) : i + 2]
                status, model = self._likeliest(rows[max(first - OVERLAP, 0) : end + OVERLAP], led, near)
                if not parts or parts[-1][1] is not status or parts[-1][2] != model:
                    parts.append((first, status, model))
        ends = [first for first, _, _ in parts[1:]] + [len(rows)]
        for (first, status, model), end in zip(parts, ends, strict=True):
            begin = max(first - OVERLAP, 0)
            begin += int(np.argmax(rows["noise"][begin:] > 0.0))
            unit = self._unit_of_less_noise(rows[first:end], status, model) if last and estimated else 0.0
            if unit > 0.0:
                _lower_noise(rows[first:end])
            part = rows[begin : end + OVERLAP]
            if len(part) >= FEWEST_ROWS:
                smoother = new_smoother(self._settings, len(part))
                smoother.bank["filters"]["scale"][0, layout.SMOOTHER] = unit or 1.0
                written = rows[max(first, begin + 1) : end]
                written["systematic"] = 0.0
                smooth_model(smoother, status["bank"][0], model, part, max(first - begin, 1), end - begin - 1)
                if last:
                    add_omitted(written, status, model)
            if unit > 0.0:
                self._lowered = True
                rows["noise"][first:end] *= unit

    def _unit_of_less_noise(self, rows: Records, status: Records, model: int) -> float:
        """Return the variance of unit weight with much less noise, if that predicts held-out readings better, else 0.

        The filter's noise scale contains the motion that it does not follow, of which the smoother follows more.
        """
        parts = _model_parts(rows, HELD_PARTS)
        smoother = new_smoother(self._settings, max(map(len, parts)))
        errors: list[list[FloatArray]] = [[], []]
        variances: list[FloatArray] = []
        for part in parts:
            held = np.flatnonzero(part["noise"] > 0.0)[2:-2:HELD_EVERY]
            held = held[part["correlated"][held] < INDEPENDENT]
            for found, lower in zip(errors, (False, True), strict=True):
                trial = part.copy()
                if lower:
                    _lower_noise(trial)
                noise = trial["noise"][held]
                trial["noise"][held] = 0.0
                smooth_model(smoother, status["bank"][0], model, trial, 1, len(trial) - 1)
                found.append(trial["residual"][held] ** 2)
            variances.append(trial["covariance"][held, 0] + noise)
        before, after, variance = (np.concatenate(found) for found in (*errors, variances))
        if before.size < FEWEST_HELD:
            return 0.0
        most = HELD_CLIP * np.median(before)
        better = np.mean(np.minimum(after, most)) < BETTER * np.mean(np.minimum(before, most))
        return float(np.median(after / variance) / NORMAL_MEDIAN) if better else 0.0

    def _likeliest(self, rows: Records, led: BoolArray, known: list[Records]) -> tuple[Records, int]:
        """Select ripple and model by likelihood, penalised by the number of coefficients (Schwarz 1978).

        Candidates are the stored ripples of models that led, and the plain model: all ripples may be wrong here.
        """
        least, models = SEEN_CYCLES * (self._settings.cycle_turns * TURN), range(1, layout.MODELS)
        tried = [
            (status, f)
            for status in known
            for f in models
            if led[f] and status["bank"]["models"]["travelled"][0][f] >= least
        ]
        if len(tried) != 1 or led[0]:
            tried.insert(0, (self._known[-1], layout.PLAIN))
        if len(tried) < 2:
            return tried[0]
        parts = _model_parts(rows)
        smoother, penalty = new_smoother(self._settings, max(map(len, parts))), np.log(sum(map(len, parts)))
        fits = [sum(smooth_model(smoother, status["bank"][0], f, part, 1, 0) for part in parts) for status, f in tried]
        waves = np.array([status["bank"]["models"]["waves"][0][f] for status, f in tried])
        return tried[int(np.argmax(np.asarray(fits) - penalty * waves))]


def _lower_noise(rows: Records) -> None:
    """Lower the noise of the readings; the filter's remains the measure of outliers."""
    rows["gate_noise"] = rows["noise"]
    for field in ("noise", "unit"):
        rows[field] *= LESS_NOISE


def _set_jitter(noise: Records, rows: Records) -> None:
    """Set the estimated jitter to the median of all readings of the moving shaft, beyond rounding."""
    moving = rows[(rows["noise"] > 0.0) & (np.abs(rows["speed"]) * rows["step"] > 3.0 * np.sqrt(rows["noise"]))]
    if len(moving) and noise["jitter_configured"][0] == 0.0:
        rounding = moving["correlated"] * noise["resolution"][0] ** 2 / 12.0
        excess = np.maximum(moving["noise"] - rounding, LEAST_JITTER * moving["noise"])
        noise["jitter"] = np.median(excess / moving["speed"] ** 2)


def _ripple(status: Records) -> tuple[FloatArray, float, float]:
    """Return coefficients (WIDEST,) of the leading ripple, their sigma (RMS over a turn) and a measurement's [rad]."""
    now = status[0]
    filters, models = now["bank"]["filters"], now["bank"]["models"]
    index, width = int(models["best"][models["leading"]]), 2 * int(models["waves"][models["leading"]])
    ripple, scale = (
        np.where(np.arange(layout.WIDEST) < width, filters["ripple"][:, index], 0.0),
        filters["scale"][index],
    )
    sigma = _rms(filters["factor"][:width, :width, index]) * np.sqrt(scale)
    return ripple, sigma, float(np.sqrt(scale * measurement_variance(now["noise"], now["track"]["speed"])))


def _rms(coefficients: FloatArray) -> float:
    """Return the RMS over a turn of the ripple with these coefficients."""
    return float(np.sqrt(0.5 * np.sum(coefficients**2)))


def _reject_copies(rows: Records, longest_repeat: float) -> None:
    """Reject repeated readings from before the repetitions of the sensor were known; longer repeats are stops."""
    repeats = np.append(False, rows["reading"][1:] == rows["reading"][:-1])
    run = np.cumsum(~repeats)
    rows["noise"][repeats & (np.bincount(run)[run] <= longest_repeat + 2.0)] = 0.0


def _compact(rows: Records) -> Records:
    """Return the states of the rows, in the memory of the rows: hours of both would be too much."""
    if not rows.flags.owndata:
        rows = rows.copy()
    width, fields, count = ROW.itemsize // 8, STATE.itemsize // 8, len(rows)
    numbers = rows.view(np.float64).reshape(-1)
    for first in range(0, count, PIECE):
        part = numbers[first * width : (first + PIECE) * width].reshape(-1, width)[:, :fields].copy()
        numbers[first * fields : first * fields + part.size] = part.reshape(-1)
    del numbers
    rows.resize(-(-count * fields // width), refcheck=False)
    return rows.view(np.float64).reshape(-1)[: count * fields].view(STATE)


def _model_parts(rows: Records, most: int = MODEL_PARTS) -> list[Records]:
    """Return rows to select a model by: parts evenly spaced in a long stretch, each from an accepted reading on."""
    parts = [rows]
    if len(rows) > most * MODEL_ROWS:
        starts = np.linspace(0, len(rows) - MODEL_ROWS, most).astype(np.int64)
        parts = [rows[start : start + MODEL_ROWS] for start in starts]
    return [part[int(np.argmax(part["noise"] > 0.0)) :] for part in parts]
