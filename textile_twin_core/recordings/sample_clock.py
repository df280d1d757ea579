"""Samples stamped in bursts: detection, and the even times at which the device took them.

A serial bridge, a field bus or a coarse clock stamps several samples together and then pauses. A device that samples
evenly takes sample n at a + n T. Each burst holds the samples taken up to the instant at which it was sent, so that its
last sample is at most a period T old: `a <= t_burst - n T < a + T` for the number n of its last sample. The clock is
the offset and period that satisfy this with the fewest lost samples. A constant latency of the link shows in no stamp.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray
from textile_twin_core.comparison.stamp_timing import StampBursts
from textile_twin_core.shaft.turns import TURN

LONGEST_PAUSE_S = 0.25  # longer intervals are gaps of the record
SHORT, LONG = 0.7, 1.3  # of the local mean interval: intervals inside a burst, and pauses
SHORT_SHARE, LONG_SHARE = 0.25, 0.4  # part of the intervals, and of the time, from which stamps come in bursts
FEWEST = 64  # samples below which nothing is detected
AROUND = 128  # samples over which the local mean interval is taken
PHASES = 24  # offsets tried in a period
FIRST_BURSTS = 384  # bursts in which the period is searched
MOST_LOST, FINENESS = 0.06, 0.25  # maximum part of lost samples; part of a period, error at the end of the search
LATE_BURSTS = 3  # bursts of which at least one is on time
LASTING = 7  # bursts of the median over which a loss of samples persists
SEGMENT_S, GAP_S = 600.0, 1.0  # length over which a clock counts as even; pauses that end a segment
# [%] percentiles of the bursts' last samples between which the offset lies: the others were late or lost
SOONEST, LATEST = 4.0, 92.0
MOST_SHOWN = 0.15  # maximum part of lost samples that the moves may show: more are uneven moves
MOST_CHANGES = 0.6  # maximum part of the bursts that follow a lost sample
UNEVEN = 0.3  # of a period, deviation of stamps that are even
PROBE = 4096  # samples of a long record in which uneven intervals are examined first
UNEVEN_SINGLE = 0.1  # of the mean, deviation of the intervals from which single samples count as uneven
RARE = 0.1  # part of uneven intervals up to which a bridge of single samples is busy all the time
SMOOTHER = 0.5  # ratio of roughness up to which uneven intervals are no lost samples
OTHER_INTERVAL, SAME_PERIOD = 0.1, 1e-3  # of the companion's period: difference of another interval; of an equal period
ROUGHER = 1.1  # ratio of roughness from which the samples were not taken evenly
AS_FEW = 1.1  # times the fewest lost samples, up to which an offset is acceptable
# times the fewest losses, and part of the bursts, up to which a known period is acceptable
ALIKE, ALIKE_BURSTS = 2.0, 0.05
FINE_MOVE = 4.0  # rounding steps in a move, from which moves show a lost sample


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
        stamps_ns: (n,) stamps [ns] in the order of the samples; those older than one before are ignored.
        uneven: count uneven intervals between single samples, which may also be lost samples.

    Returns:
        The pattern; None for evenly spread stamps, or fewer than FEWEST.
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
        step = step[step > 0.0]  # rows that a logger wrote twice are no samples
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
        values: (n,) sampled values; angles [rad] show lost samples by the moves between them.
        angles: True if the values are angles.
        period_s: sampling period of a companion of the same device, tried first.
        bridge_ns: (m,) rising stamps of everything that comes over the same bridge, these samples included.

    Returns:
        The times; the pattern alone where no even clock fits the samples; None without bursts, or where the values
        show that the samples were taken when they are stamped.
    """
    bursts = find_bursts(stamps_ns, uneven=True)
    if bursts is None:
        return None
    single = bursts.samples == 1
    if single and stamps_ns.size > 2 * PROBE:  # mostly lost samples, visible in a part of the record
        middle = slice(stamps_ns.size // 2 - PROBE // 2, stamps_ns.size // 2 + PROBE // 2)
        if not isinstance(even_times(stamps_ns[middle], values[middle], angles, period_s, bridge_ns), EvenTimes):
            return None
    # A stamp older than one before does not enter the clock, and keeps its time.
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
    else:  # noisy values decide nothing: the intervals must differ from the companion's period
        same = abs(max(found)[1] - period_s) < SAME_PERIOD * period_s
        uneven = same and abs(bursts.pause_s - period_s) > OTHER_INTERVAL * period_s
    if smooth > ROUGHER * stamped or (single and not uneven):
        return None
    best = max(found)
    half = 0.5 * max(width for *_, width, _ in found)
    if single and np.mean(np.abs(np.diff(time) - best[1]) > UNEVEN * best[1]) < RARE:
        half = max(half, best[1])  # a bridge that is always busy: no pause shows that it waits for samples
    if bursts.repeated:  # the tick before the samples, or the instant at which they arrived
        times += 0.5 * bursts.period_s
        half += 0.5 * bursts.period_s
    whole = stamps_ns.copy()
    whole[good] = stamps[0] + np.rint(times * 1e9).astype(np.int64)
    return EvenTimes(bursts, whole, best[1], half, sum(lost for *_, lost in found))


def sampling_period(stamps_ns: IntArray) -> float | None:
    """Return the period [s] of samples with right stamps (n,), some of them lost; None where they are not even."""
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
    """Return the mean of the intervals (n,) around each."""
    width = min(AROUND, step.size)
    sums = np.cumsum(np.concatenate([[0.0], step]))
    first = np.clip(np.arange(step.size) - width // 2, 0, step.size - width)
    return np.asarray((sums[first + width] - sums[first]) / width)


def _moves(angles: FloatArray) -> FloatArray:
    """Return the sampling periods (n - 1,) between angles (n,), each move beside its neighbours; 1 where unclear."""
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
    # An outlier moves there and back.
    back = np.minimum(np.roll(periods, 1), np.roll(periods, -1)) < 1.0
    return np.where((periods < 1.0) | (periods > 50.0) | back, 1.0, periods)


def _sent(bridge: FloatArray, time: FloatArray) -> FloatArray:
    """Return the first time in `bridge` (m,) of the burst to which each time (n,) belongs."""
    step = np.diff(bridge)
    first = np.concatenate([[0], np.flatnonzero(step > _local_mean(step)) + 1])
    return np.asarray(bridge[first[np.maximum(np.searchsorted(bridge[first], time, side="right") - 1, 0)]])


def _clock(
    time: FloatArray, begins: FloatArray, moves: FloatArray, near_s: float | None, single: bool
) -> tuple[FloatArray, float, float, int] | None:
    """Fit even times to stamps `time` (n,); return them, the period, the width of the offset's interval, samples lost.

    Args:
        begins: (n,) time at which the burst of each begins.
        moves: (n - 1,) sampling periods from each sample to the next, as far as the values show them.
        near_s: the period of a companion.
        single: True if each sample counts as a burst.
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
    # Lost samples whose place is unknown count as lost before the first sample of the burst.
    burst = np.repeat(np.arange(first.size), last - first + 1)
    numbers = number + extra[burst]
    places = np.arange(time.size)
    numbers = np.maximum.accumulate(numbers - places) + places
    lost = int(numbers[-1] - numbers[0]) - (time.size - 1)
    return offset + period * numbers, period, high - low, lost


def _search(sent: FloatArray, count: FloatArray, shown: bool, near_s: float | None) -> tuple[float, float, bool] | None:
    """Search period and offset of bursts `sent` (b,) with last samples `count` (b,) for the fewest losses.

    The third value is True if the period is `near_s`.

    Args:
        shown: True if the values have shown lost samples.
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
    # A longer period hides lost samples: the known period is preferred unless it needs far more of them.
    few, offset = _fewest(sent, count - middle, near_s)
    alike = few <= ALIKE * best + ALIKE_BURSTS * sent.size
    return (near_s, offset - near_s * middle, True) if alike else (*found, False)


def _fewest(sent: FloatArray, count: FloatArray, period: float) -> tuple[float, float]:
    """Return the fewest changes of the number of lost samples for a period, and the middle of such offsets."""
    phases = (np.arange(PHASES) + 0.5) / PHASES
    late = _on_time(sent - period * count) / period
    changes = np.abs(np.diff(np.floor(late[None, :] - phases[:, None]), axis=1)).sum(axis=1)
    few = float(changes.min())
    serve = phases[changes <= AS_FEW * few + 2.0] * TURN
    return few, float(np.angle(np.mean(np.exp(1j * serve)))) / TURN * period


def _on_time(late: FloatArray) -> FloatArray:
    """Return the least of `late` (b,) at each burst and the next ones: a single burst may be sent late."""
    padded = np.pad(late, (0, LATE_BURSTS - 1), mode="edge")
    return np.asarray(np.lib.stride_tricks.sliding_window_view(padded, LATE_BURSTS).min(axis=1))


def _lost(sent: FloatArray, count: FloatArray, period: float, offset: float) -> FloatArray:
    """Return the samples lost up to each burst, beyond those counted, from an offset in the middle of its interval."""
    late = (_on_time(sent - period * count) - offset) / period
    padded = np.pad(np.floor(late), LASTING // 2, mode="reflect")
    return np.asarray(np.median(np.lib.stride_tricks.sliding_window_view(padded, LASTING), axis=1))


def _offsets(late: FloatArray, period: float) -> tuple[float, float]:
    """Return the interval [s] of the clock's offset, from the age (b,) of the last sample of each burst."""
    high = float(np.percentile(late, SOONEST))
    # Ages beyond a period belong to bursts sent late: their delay is the uncertainty of the offset.
    width = max(high - (float(np.percentile(late, LATEST)) - period), float(np.percentile(late, 99.0)) - period - high)
    return high - min(max(width, 0.0), period), high


def _roughness(time: FloatArray, values: FloatArray, angles: bool, at: BoolArray | None = None) -> float:
    """Return the mean distance of values (n,) from lines through their neighbours in time; angles are unwrapped.

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
