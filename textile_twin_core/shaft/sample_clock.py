"""The clock of samples that were stamped in bursts: detection, and the even times at which the device took them.

A serial bridge, a field bus or a coarse clock stamps several samples together and then pauses. A device that samples
evenly takes sample n at a + n T. Each burst holds the samples taken up to the instant at which it was sent, so that its
last sample is at most a period T old: `a <= t_burst - n T < a + T` for the number n of its last sample. Offset and
period that keep to this with the fewest lost samples are the clock. A constant latency of the link shows in no stamp.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray
from textile_twin_core.shaft.turns import TURN

LONGEST_PAUSE_S = 0.25  # longer intervals are gaps of the record
SHORT, LONG = 0.7, 1.3  # of the local mean interval: intervals inside a burst, and pauses
SHORT_SHARE, LONG_SHARE = 0.25, 0.4  # of the intervals, and of the time, from which stamps come in bursts
FEWEST = 64  # samples, without which nothing is detected
AROUND = 128  # samples whose mean interval is the local one
REPEATED = 1e-6  # [s] inside a burst up to which stamps count as repeated: a coarse clock
PHASES = 24  # offsets tried, in a period
FIRST_BURSTS = 384  # bursts in which the period is searched
MOST_LOST, FINENESS = 0.06, 0.25  # part of the samples that may be lost; of a period, error at the end of the search
LATE_BURSTS = 3  # of so many bursts one is on time
LASTING = 7  # bursts over whose median a loss of samples lasts
SEGMENT_S, GAP_S = 600.0, 1.0  # a clock is taken for even so long; pauses that end a segment
SOONEST, LATEST = (
    4.0,
    92.0,
)  # [%] of the bursts, between which their last samples tell the offset: others were late or lost
MOST_SHOWN = 0.15  # part of the samples that the moves may show as lost: more of them are uneven moves
MOST_CHANGES = 0.6  # of the bursts that may begin after a lost sample
UNEVEN = 0.3  # of a period, deviation of stamps that are even
PROBE = 4096  # samples of a long record in which uneven intervals are looked at first
UNEVEN_SINGLE = 0.1  # of the mean, deviation of the intervals from which single samples come at uneven times
RARE = 0.1  # part of the intervals that are uneven, up to which a bridge of single samples is busy all the time
SMOOTHER = 0.5  # ratio of roughness up to which uneven intervals are no lost samples
OTHER_INTERVAL, SAME_PERIOD = 0.1, 1e-3  # of the companion's period: an interval that is another; a period that is not
ROUGHER = 1.1  # ratio of roughness from which the samples were not taken evenly
AS_FEW = 1.1  # times the fewest lost samples, up to which an offset serves as well
ALIKE, ALIKE_BURSTS = 2.0, 0.05  # times the fewest losses, and part of the bursts, up to which a known period serves
FINE_MOVE = 4.0  # rounding steps in a move, from which a lost sample shows in the moves


@dataclass(frozen=True)
class StampBursts:
    """How stamps come in bursts.

    Attributes:
        samples: samples in a burst, median.
        inside_s: time from the first to the last of them, median [s].
        pause_s: time to the next burst, median [s]; of single samples the shorter of the usual intervals.
        longer_s: of single samples, which come at uneven intervals, the longer of the usual intervals [s].
    """

    samples: int
    inside_s: float
    pause_s: float
    longer_s: float = 0.0

    @property
    def period_s(self) -> float:
        """Time from burst to burst [s]."""
        return self.inside_s + self.pause_s

    @property
    def repeated(self) -> bool:
        """Whether the stamps inside a burst are equal, as of a coarse clock."""
        return self.samples > 1 and self.inside_s <= REPEATED

    @property
    def text(self) -> str:
        """The pattern in words, with its numbers."""
        pause = f"{self.pause_s * 1e3:.3g} ms"
        if self.samples == 1:
            return f"even samples at intervals of {pause} or {self.longer_s * 1e3:.3g} ms: stamped on arrival"
        if self.repeated:
            return f"{self.samples} samples with one stamp, the next {pause} later: stamped by a coarse clock"
        inside = f"{self.inside_s * 1e3:.2g} ms" if self.inside_s > 1e-5 else f"{self.inside_s * 1e6:.2g} us"
        return f"{self.samples} samples within {inside}, then {pause}: stamped on arrival"


@dataclass(frozen=True)
class EvenTimes:
    """Times of samples that were stamped in bursts, as the device took them.

    Attributes:
        bursts: the pattern of the stamps.
        times_ns: (n,) time of each sample [ns]; the stamp where it belongs to no even stretch.
        period_s: sampling period [s].
        half_width_s: half the width of the interval in which the common offset of the times lies [s].
        lost: samples that the device took and the record lacks.
    """

    bursts: StampBursts
    times_ns: IntArray
    period_s: float
    half_width_s: float
    lost: int


def find_bursts(stamps_ns: IntArray, uneven: bool = False) -> StampBursts | None:
    """Detect stamps that come in bursts.

    Args:
        stamps_ns: (n,) stamps [ns] in the order of the samples; those older than one before are left out.
        uneven: whether uneven intervals between single samples count, which may as well be lost samples.

    Returns:
        The pattern; None where stamps are spread evenly, or where there are fewer than FEWEST.
    """
    stamps = stamps_ns[stamps_ns >= np.maximum.accumulate(stamps_ns)] if stamps_ns.size else stamps_ns
    if stamps.size < FEWEST:
        return None
    step = np.diff(stamps) * 1e-9
    step = step[step <= LONGEST_PAUSE_S]
    if step.size < FEWEST - 1 or not step.any():
        return None
    mean = _local_mean(step)
    short, long = step < SHORT * mean, step > LONG * mean
    if np.mean(short) < SHORT_SHARE or step[long].sum() < LONG_SHARE * step.sum():
        if not uneven or np.std(step) < UNEVEN_SINGLE * np.mean(step):
            return None
        usual = np.percentile(step, (10.0, 90.0))
        alike = usual[1] - usual[0] < OTHER_INTERVAL * mean.mean()
        return StampBursts(1, 0.0, *(np.percentile(step, (1.0, 99.0)) if alike else usual).tolist())
    begins = np.flatnonzero(step > mean)
    if begins.size < 3:
        return None
    pauses = step[begins]
    inside = np.add.reduceat(np.append(step, 0.0), begins)[:-1] - pauses[:-1]
    return StampBursts(round(float(np.median(np.diff(begins)))), float(np.median(inside)), float(np.median(pauses)))


def even_times(
    stamps_ns: IntArray,
    values: FloatArray,
    angles: bool,
    period_s: float | None = None,
    bridge_ns: IntArray | None = None,
) -> EvenTimes | StampBursts | None:
    """Reconstruct the times of samples that were stamped in bursts.

    Args:
        stamps_ns: (n,) stamps [ns] in the order of the samples.
        values: (n,) what was sampled; angles [rad] show lost samples by the moves between them.
        angles: whether the values are angles.
        period_s: sampling period of a companion of the same device, tried first.
        bridge_ns: (m,) rising stamps of everything that comes over the same bridge, these samples included.

    Returns:
        The times; the pattern alone where the samples keep to no even clock; None where stamps come in no bursts, or
        where the values say that the samples were taken when they are stamped.
    """
    bursts = find_bursts(stamps_ns, uneven=True)
    if bursts is None:
        return None
    single = bursts.samples == 1
    if single and stamps_ns.size > 2 * PROBE:  # mostly lost samples, which a part of the record shows
        middle = slice(stamps_ns.size // 2 - PROBE // 2, stamps_ns.size // 2 + PROBE // 2)
        if not isinstance(even_times(stamps_ns[middle], values[middle], angles, period_s, bridge_ns), EvenTimes):
            return None
    # A stamp that is older than one before is of no use for the clock, and keeps its time.
    good = stamps_ns >= np.maximum.accumulate(stamps_ns)
    stamps, seen = stamps_ns[good], values[good]
    time: FloatArray = (stamps - stamps[0]) * 1e-9
    sent = time if single or bridge_ns is None else _sent((bridge_ns - stamps[0]) * 1e-9, time)
    moves = _moves(seen) if angles else np.ones(seen.size - 1)
    times = time.copy()
    found: list[tuple[int, float, float, int]] = []
    edges = np.flatnonzero(np.diff(time) > GAP_S) + 1
    for part in np.split(np.arange(time.size), edges):
        pieces = max(1, round(float(time[part[-1]] - time[part[0]]) / SEGMENT_S))
        for piece in np.array_split(part, pieces):
            if piece.size < FEWEST:
                continue
            clock = _clock(time[piece], sent[piece], moves[piece[:-1]], period_s, single)
            if clock is not None:
                times[piece], period, width, lost = clock
                found.append((piece.size, period, width, lost))
    if sum(size for size, *_ in found) < 0.5 * time.size:
        even = np.linspace(0.0, time[-1], time.size)
        follow = angles and _roughness(time, seen, True) < SMOOTHER * _roughness(even, seen, True)
        return None if single or follow else bursts
    smooth, stamped = _roughness(times, seen, angles), _roughness(time, seen, angles)
    if angles or period_s is None:
        other = np.abs(np.diff(times) - np.diff(time)) > UNEVEN * max(found)[1]
        uneven = _roughness(times, seen, angles, other) < SMOOTHER * _roughness(time, seen, angles, other)
    else:  # a torque's noise hides it: the intervals must be other ones than the companion's period
        same = abs(max(found)[1] - period_s) < SAME_PERIOD * period_s
        uneven = same and abs(bursts.pause_s - period_s) > OTHER_INTERVAL * period_s
    if smooth > ROUGHER * stamped or (single and not uneven):
        return None
    best = max(found)
    half = 0.5 * max(width for *_, width, _ in found)
    if single and np.mean(np.abs(np.diff(time) - best[1]) > UNEVEN * best[1]) < RARE:
        half = max(half, best[1])  # a bridge that is busy all the time: no pause shows when it waits for samples
    if bursts.repeated:  # the tick before the samples, or the instant at which they arrived
        times += 0.5 * bursts.period_s
        half += 0.5 * bursts.period_s
    whole = stamps_ns.copy()
    whole[good] = stamps[0] + np.rint(times * 1e9).astype(np.int64)
    return EvenTimes(bursts, whole, best[1], half, sum(lost for *_, lost in found))


def sampling_period(stamps_ns: IntArray) -> float | None:
    """The period [s] of samples with right stamps (n,), of which some are lost; None where they are not even."""
    step = np.diff(stamps_ns) * 1e-9
    step = step[step > 0.0]
    if step.size < FEWEST:
        return None
    number = np.concatenate([[0.0], np.cumsum(np.rint(step / np.median(step)))])
    time = np.concatenate([[0.0], np.cumsum(step)])
    if number[-1] < FEWEST:
        return None
    period, start = np.polyfit(number, time, 1)
    return float(period) if np.std(time - start - period * number) < UNEVEN * period else None


def _local_mean(step: FloatArray) -> FloatArray:
    """Mean of the intervals (n,) around each."""
    width = min(AROUND, step.size)
    sums = np.cumsum(np.concatenate([[0.0], step]))
    first = np.clip(np.arange(step.size) - width // 2, 0, step.size - width)
    return np.asarray((sums[first + width] - sums[first]) / width)


def _moves(angles: FloatArray) -> FloatArray:
    """Sampling periods (n - 1,) between angles (n,), by the move of each beside those around it; 1 where unclear."""
    move = np.diff(angles)
    move = move - TURN * np.rint(move / TURN)
    change = np.abs(np.diff(move))
    change = change[change > 1e-9]
    if move.size < 8 or change.size < 8:
        return np.ones(move.size)
    rounding = float(np.percentile(change, 10.0))
    padded = np.pad(move, 3, mode="edge")
    usual = np.median(np.lib.stride_tricks.sliding_window_view(padded, 7), axis=1)
    with np.errstate(all="ignore"):
        periods = np.where(np.abs(usual) > FINE_MOVE * rounding, move / usual, 1.0)
    periods = np.where(np.isfinite(periods), np.rint(periods), 1.0)
    # A wrong reading moves there and back.
    back = np.minimum(np.roll(periods, 1), np.roll(periods, -1)) < 1.0
    return np.where((periods < 1.0) | (periods > 50.0) | back, 1.0, periods)


def _sent(bridge: FloatArray, time: FloatArray) -> FloatArray:
    """The first time in `bridge` (m,) of the burst to which each time (n,) belongs."""
    step = np.diff(bridge)
    first = np.concatenate([[0], np.flatnonzero(step > _local_mean(step)) + 1])
    return np.asarray(bridge[first[np.maximum(np.searchsorted(bridge[first], time, side="right") - 1, 0)]])


def _clock(
    time: FloatArray, begins: FloatArray, moves: FloatArray, near_s: float | None, single: bool
) -> tuple[FloatArray, float, float, int] | None:
    """Even times of samples stamped at `time` (n,), the period, the width of the offset's interval, samples lost.

    Args:
        begins: (n,) time at which the burst of each begins.
        moves: (n - 1,) sampling periods from each sample to the next, as far as the values show.
        near_s: the period of a companion.
        single: whether each sample counts as a burst.
    """
    step = np.diff(time)
    first = np.concatenate([[0], np.flatnonzero(single | (step > _local_mean(step))) + 1])
    last = np.append(first[1:], time.size) - 1
    if first.size < 8:
        return None
    number = np.concatenate([[0.0], np.cumsum(moves)])
    sent, count = begins[first], number[last]
    if single and near_s is None:
        near_s = float(np.polyfit(number, sent, 1)[0])
    found = _search(sent[:-1][:FIRST_BURSTS], count[:-1][:FIRST_BURSTS], bool(np.any(moves > 1.0)), near_s)
    if found is None:
        return None
    period, offset, known = found
    extra = np.zeros(sent.size)
    size = min(FIRST_BURSTS, sent.size)
    while True:
        for _ in range(3):
            extra[:size] = _lost(sent[:size], count[:size], period, offset)
            numbers = count[:size] + extra[:size]
            if not known:
                period = float(np.polyfit(numbers - numbers.mean(), sent[:size], 1)[0])
            low, high = _offsets(sent[:size] - period * numbers, period)
            offset = 0.5 * (low + high)
        if size == sent.size:
            break
        size = min(2 * size, sent.size)
    extra[-1] = extra[-2]  # the record may end within a burst
    changes = np.count_nonzero(np.diff(extra))
    if changes > MOST_CHANGES * sent.size or number[-1] > (1.0 + MOST_SHOWN) * time.size:
        return None
    # Samples that nothing shows where they were lost are taken for lost before the first of the burst.
    burst = np.repeat(np.arange(first.size), last - first + 1)
    numbers = number + extra[burst]
    places = np.arange(time.size)
    numbers = np.maximum.accumulate(numbers - places) + places
    lost = int(numbers[-1] - numbers[0]) - (time.size - 1)
    return offset + period * numbers, period, high - low, lost


def _search(sent: FloatArray, count: FloatArray, shown: bool, near_s: float | None) -> tuple[float, float, bool] | None:
    """Period and offset with which the bursts `sent` (b,), whose last samples are `count` (b,), begin fewest losses.

    The third is whether the period is `near_s`.

    Args:
        shown: whether the values have shown lost samples.
        near_s: the period of a companion.
    """
    span = float(count[-1] - count[0])
    if span <= 0.0:
        return None
    mean = float(sent[-1] - sent[0]) / span
    fine = FINENESS / span
    least = 1.0 - (0.5 * MOST_LOST if shown else MOST_LOST)
    periods = mean * np.arange(least, 1.0 + 2.5 / span + fine, fine)
    middle = 0.5 * (count[0] + count[-1])
    tried = [_fewest(sent, count - middle, float(period)) for period in periods]
    best = min(few for few, _ in tried)
    serve = [k for k, (few, _) in enumerate(tried) if few == best]
    k = serve[len(serve) // 2]
    found = float(periods[k]), tried[k][1] - float(periods[k]) * middle
    if near_s is None or not periods[0] <= near_s <= periods[-1]:
        return *found, False
    # A longer period hides lost samples: the known one serves unless it needs far more of them.
    few, offset = _fewest(sent, count - middle, near_s)
    alike = few <= ALIKE * best + ALIKE_BURSTS * sent.size
    return (near_s, offset - near_s * middle, True) if alike else (*found, False)


def _fewest(sent: FloatArray, count: FloatArray, period: float) -> tuple[float, float]:
    """The fewest changes of the number of lost samples that a period allows, and the middle of such offsets."""
    phases = (np.arange(PHASES) + 0.5) / PHASES
    late = _on_time(sent - period * count) / period
    changes = np.abs(np.diff(np.floor(late[None, :] - phases[:, None]), axis=1)).sum(axis=1)
    few = float(changes.min())
    serve = phases[changes <= AS_FEW * few + 2.0] * TURN
    return few, float(np.angle(np.mean(np.exp(1j * serve)))) / TURN * period


def _on_time(late: FloatArray) -> FloatArray:
    """The least of `late` (b,) at each burst and the next ones: a single burst may be sent late."""
    padded = np.pad(late, (0, LATE_BURSTS - 1), mode="edge")
    return np.asarray(np.lib.stride_tricks.sliding_window_view(padded, LATE_BURSTS).min(axis=1))


def _lost(sent: FloatArray, count: FloatArray, period: float, offset: float) -> FloatArray:
    """Samples lost up to each burst, beyond those counted, from an offset in the middle of its interval."""
    late = (_on_time(sent - period * count) - offset) / period
    padded = np.pad(np.floor(late), LASTING // 2, mode="reflect")
    return np.asarray(np.median(np.lib.stride_tricks.sliding_window_view(padded, LASTING), axis=1))


def _offsets(late: FloatArray, period: float) -> tuple[float, float]:
    """The interval [s] of the clock's offset, from the age (b,) of the last sample of each burst."""
    high = float(np.percentile(late, SOONEST))
    # Ages beyond a period are those of bursts that were sent late: the offset is as uncertain as these are late.
    width = max(high - (float(np.percentile(late, LATEST)) - period), float(np.percentile(late, 99.0)) - period - high)
    return high - min(max(width, 0.0), period), high


def _roughness(time: FloatArray, values: FloatArray, angles: bool, at: BoolArray | None = None) -> float:
    """Mean distance of values (n,) from lines through their neighbours in time; angles are unwrapped.

    Args:
        at: (n - 1,) moves that count; None: all.
    """
    move = np.diff(values)
    if angles:
        move = move - TURN * np.rint(move / TURN)
    step = np.diff(time)
    known = np.isfinite(move)
    move = np.where(known, move, 0.0)
    width = min(20, move.size)
    kernel = np.ones(width)
    slope = np.convolve(move, kernel, mode="same") / np.maximum(np.convolve(step, kernel, mode="same"), 1e-9)
    good: BoolArray = known & (step <= LONGEST_PAUSE_S)
    good = good if at is None else good & at
    return float(np.mean(np.abs(move - slope * step)[good])) if good.any() else 0.0
