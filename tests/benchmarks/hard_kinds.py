"""Recordings that are hard to judge: errors of all stated values in their sigmas, and false causes.

Run from the root of the repository: python -m tests.benchmarks.hard_kinds FIRST_SEED LAST_SEED [KIND ..]

Every second recording of a mill has a wrong gain and delay, and every second pair of seeds is of the loom. The truth
is by equations of its own; the machine file is exact.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from tests.benchmarks.identification import truly
from tests.generators.bridged_samples import Sampled, bridged
from tests.generators.configured_machine import configured_machine
from tests.generators.mill_recordings import Case, healthy, record
from tests.generators.speed_controlled_motion import speed_controlled_motion
from textile_twin_core.comparison import Assessment, Calibration, Estimate, Readings, assess, calibrate, identify
from textile_twin_core.comparison.cause import Cause
from textile_twin_core.errors import RecordingError
from textile_twin_core.inference.parameter import COULOMB, DELAY, GAIN, ROTOR, VISCOUS
from textile_twin_core.recordings.logged_run import evenly_timed
from textile_twin_core.recordings.recorded_clock import on_one_clock
from textile_twin_core.recordings.samples import AngleSamples, TorqueSamples

_BEYOND = 3.0
_NOISE_NM, _BITS = 0.05, 13
_PATHS = {"delay": DELAY, "torque_gain": GAIN, "unmodelled_inertia": ROTOR}
SOURCES = ("verdict", "calibrate", "given the file", "identify")


@dataclass(frozen=True)
class Hard:
    """A recording, its truth, and the causes that are right to name."""

    case: Case
    readings: Readings
    right: frozenset[str]


def _drawn(seed: int) -> tuple[Case, np.random.Generator, frozenset[str]]:
    """A case, healthy or with a wrong gain and delay, a generator of random numbers, and the right causes."""
    rng = np.random.default_rng([seed, 4711])
    case = healthy("loom" if seed // 2 % 2 else "tufting", seed)
    if seed % 2 == 0:
        return case, rng, frozenset()
    gain = 1.0 + float(rng.uniform(0.05, 0.2) * rng.choice([-1.0, 1.0]))
    late = float(rng.uniform(0.0015, 0.008))
    return replace(case, torque=replace(case.torque, gain=gain, delay_s=late)), rng, frozenset({"torque_gain", "delay"})


def _recorded(case: Case) -> Readings:
    made = record(case)
    return Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque)


def _speed_controlled(seed: int, added: bool) -> Hard:
    """13 bits and torque at 1 kHz, under a stiff or a soft controller of the speed, with two speeds."""
    rng = np.random.default_rng([seed, 13])
    case = healthy("loom" if seed % 2 else "tufting", seed, duration_s=24.0)
    late = 0.0 if added else float(rng.uniform(0.002, 0.01))
    if added:
        case = replace(case, added_inertia_kgm2=float(np.exp(rng.uniform(np.log(0.02), np.log(0.2)))))
    case = replace(case, torque=replace(case.torque, delay_s=late))
    gain_Nms = float(np.exp(rng.uniform(np.log(2.0), np.log(40.0))))
    low = float(rng.uniform(8.0, 10.0))
    fine, angle, _, torque = speed_controlled_motion(case, gain_Nms, (low, low + float(rng.uniform(3.0, 6.0))))
    time, step = np.arange(0.1, case.duration_s - 0.1, 0.001), 2.0 * np.pi / 2**_BITS
    true = time + 3e-5 * rng.standard_normal(time.size)
    read = np.rint(np.interp(true, fine, angle) / step) * step
    shown = np.interp(true - late, fine, torque) + _NOISE_NM * rng.standard_normal(time.size)
    stamps = np.rint(time * 1e9).astype(np.int64)
    right = frozenset({"unmodelled_inertia" if added else "delay"})
    return Hard(case, Readings(stamps, read, stamps, shown), right)


def controlled_with_a_delay(seed: int) -> Hard:
    """A speed-controlled drive, whose torque is measured 2 to 10 ms late."""
    return _speed_controlled(seed, added=False)


def controlled_with_an_inertia(seed: int) -> Hard:
    """A speed-controlled drive, and a rotor of 0.02 to 0.2 kg m2 that the file lacks."""
    return _speed_controlled(seed, added=True)


def late_stamps(seed: int) -> Hard:
    """All stamps 0 to 1 ms late, evenly distributed."""
    case, rng, right = _drawn(seed)
    seen = _recorded(case)
    stamps = [each + rng.integers(0, 1_000_000, each.size) for each in (seen.angle_stamps_ns, seen.torque_stamps_ns)]
    return Hard(case, replace(seen, angle_stamps_ns=stamps[0], torque_stamps_ns=stamps[1]), right)


def late_torque(seed: int) -> Hard:
    """Stamps of the torque 1 ms late."""
    case, _, right = _drawn(seed)
    case = replace(case, torque=replace(case.torque, delay_s=1e-3))
    return Hard(case, _recorded(case), right | {"delay"})


def nine_bits(seed: int) -> Hard:
    """Encoder of 512 steps a turn."""
    case, _, right = _drawn(seed)
    case = replace(case, encoder=replace(case.encoder, bits=9))
    return Hard(case, _recorded(case), right)


def cut_off(seed: int) -> Hard:
    """Torque cut off at 50 to 90 % of its largest value."""
    case, rng, right = _drawn(seed)
    seen = _recorded(case)
    largest = float(rng.uniform(0.5, 0.9) * np.max(np.abs(seen.torque)))
    return Hard(case, replace(seen, torque=np.clip(seen.torque, -largest, largest)), right)


def bursts(seed: int) -> Hard:
    """Stamps of a bridge that sends every 14 to 18 ms, replaced by even times."""
    case, rng, right = _drawn(seed)
    seen = _recorded(replace(case, loss=0.01))
    start = int(seen.angle_stamps_ns[0])
    taken = [(stamps - start) * 1e-9 for stamps in (seen.angle_stamps_ns, seen.torque_stamps_ns)]
    logged = Sampled(taken[0], seen.angle, taken[1], seen.torque, seen.angle_stamps_ns, seen.torque_stamps_ns)
    sent = bridged(logged, float(rng.uniform(0.014, 0.018)), 2e-4, seed=seed)
    stamped = replace(seen, angle_stamps_ns=sent.angle_stamps, torque_stamps_ns=sent.torque_stamps)
    return Hard(case, _as_the_commands_read(case, stamped), right - {"delay"} | {"stamps_in_bursts"})


def clock_set_back(seed: int) -> Hard:
    """The clock of both signals, in every third recording that of the torque alone, set back by 1.5 to 4 s."""
    case, rng, right = _drawn(seed)
    seen = _recorded(case)
    after, by = float(rng.uniform(9.0, 15.0)), round(rng.uniform(1.5, 4.0) * 1e9)
    start = int(seen.angle_stamps_ns[0])
    angle, torque = (
        stamps - by * ((stamps - start) * 1e-9 > after) for stamps in (seen.angle_stamps_ns, seen.torque_stamps_ns)
    )
    kept = seen.angle_stamps_ns if seed % 3 == 0 else angle
    seen = replace(seen, angle_stamps_ns=kept, torque_stamps_ns=torque)
    return Hard(case, _as_the_commands_read(case, seen), right)


def _as_the_commands_read(case: Case, seen: Readings) -> Readings:
    """Samples on one clock, and on even times where the stamps come in bursts."""
    angles = AngleSamples("/angle", seen.angle_stamps_ns, seen.angle, None)
    torque, _ = on_one_clock(angles, TorqueSamples("/torque", seen.torque_stamps_ns, seen.torque))
    angles, torque, timings = evenly_timed(angles, torque, configured_machine(case))
    return Readings(angles.stamps, angles.angles_rad, torque.stamps, torque.torque_Nm, stamped=tuple(timings))


KINDS: dict[str, Callable[[int], Hard]] = {
    each.__name__: each
    for each in (
        controlled_with_a_delay,
        controlled_with_an_inertia,
        late_stamps,
        late_torque,
        nine_bits,
        cut_off,
        bursts,
        clock_set_back,
    )
}


def _truth(case: Case) -> dict[str, float]:
    """True value of everything that verdict, `calibrate` and `identify` may state."""
    sensor, friction = case.torque, case.friction
    truth = {"zero_rad": 0.0, "torque.gain": sensor.gain, "torque.delay_s": sensor.delay_s, "torque.offset_Nm": 0.0}
    truth |= {"encoder_zero": 0.0, "torque_gain": sensor.gain, "delay": sensor.delay_s, "torque_offset": 0.0}
    truth |= {"unmodelled_inertia": case.added_inertia_kgm2, "added_inertia_kgm2": case.added_inertia_kgm2}
    truth |= {"clocks_drift": 0.0, "unmodelled_friction": 0.0, "load_force": 1.0}
    truth |= {"friction at working speed": 0.0, "force": case.backing.force_N}
    truth |= {"backing_force_N": case.backing.force_N, "free_force_N": case.backing.free_force_N}
    truth |= {"shaft_viscous_Nms": friction.viscous_Nms, "shaft_coulomb_Nm": friction.coulomb_Nm}
    truth |= {"torque_sensor_gain": sensor.gain, "torque_sensor_delay_s": sensor.delay_s}
    truth |= {"torque_sensor_offset_Nm": 0.0, "encoder_zero_rad": 0.0}
    return truth | {name: value for name, value in _EVENTS.items() if name.endswith("_angle_rad")}


_EVENTS = truly()


def _of_verdict(found: Assessment, right: frozenset[str]) -> Iterator[tuple[str, float, float]]:
    """Value and sigma of each cause and quantity; causes for which a right one is named as equivalent are left out."""
    for cause in found.verdict:
        if isinstance(cause.value, float) and math.isfinite(cause.sigma) and not _is_equivalent(cause, right):
            yield cause.cause, cause.value, cause.sigma
    if found.found is None:
        return
    settled, speed = found.found.settled, abs(found.found.evidence.working_speed())
    friction = settled.departure(COULOMB) + speed * settled.departure(VISCOUS)
    yield "friction at working speed", friction, settled.sigma({COULOMB: 1.0, VISCOUS: speed})
    for known in settled.posterior.measurement.parameters:
        if known.kind == "force":
            yield "force", settled.value(known.name), settled.sigma(known.name)


def _of_calibration(found: Calibration) -> dict[str, Estimate]:
    return {
        "zero_rad": found.zero_rad,
        "torque.gain": found.gain,
        "torque.delay_s": found.delay_s,
        "torque.offset_Nm": found.offset_Nm,
    }


def _is_equivalent(cause: Cause, right: frozenset[str]) -> bool:
    """True for a cause that is not right and is that of a right parameter, or names it as equivalent."""
    paths = (cause.parameter, *cause.equivalents)  # at one speed a delay is a zero or delay
    return cause.cause not in right and any(_PATHS.get(each) in paths for each in right)


def _stated(hard: Hard) -> tuple[Assessment, list[tuple[str, str, float, float]]]:
    """Assess, calibrate and identify: the verdict, and source, name, value and sigma of every stated value."""
    machine, stated = configured_machine(hard.case), list[tuple[str, str, float, float]]()
    try:
        calibration = calibrate(hard.readings, machine)
    except RecordingError as error:
        print(f"  {SOURCES[1]}: {error}")
        found = assess(hard.readings, machine)
    else:
        found = calibration.assessment
        stated += [(SOURCES[1], name, each.value, each.sigma) for name, each in _of_calibration(calibration).items()]
        stated += [(SOURCES[2], name, each.value, each.sigma) for name, each in calibration.given_file.items()]
    stated += [(SOURCES[0], *each) for each in _of_verdict(found, hard.right)]
    try:
        identified = identify(hard.readings, machine).parameters
        stated += [(SOURCES[3], name, each.value, each.sigma) for name, each in identified.items()]
    except RecordingError as error:
        print(f"  {SOURCES[3]}: {error}")
    return found, stated


def main(first: int, last: int, asked: list[str]) -> None:
    """Print each error beyond three sigmas and each wrong verdict, and a row for each kind."""
    rows = []
    for kind in asked or KINDS:
        count, beyond, false, missed = dict.fromkeys(SOURCES, 0), dict.fromkeys(SOURCES, 0), 0, 0
        for seed in range(first, last):
            hard = KINDS[kind](seed)
            truth = _truth(hard.case)
            found, stated = _stated(hard)
            right = {c.cause for c in found.verdict if c.cause in hard.right}
            alike = [c.cause for c in found.verdict if _is_equivalent(c, hard.right)]
            other = [c.cause for c in found.verdict if c.cause not in hard.right and c.cause not in alike]
            lost = hard.right - right if not alike else set()
            false += bool(other)
            missed += bool(lost)
            print(f"{kind} {seed} {hard.case.machine}: right {len(right)} of {len(hard.right)}", end="")
            print("".join(f", {what} {each}" for what, each in (("FALSE", other), ("as equivalent", alike)) if each))
            for source, name, value, sigma in stated:
                if math.isfinite(sigma) and name in truth:  # numbers of bodies count as false causes alone
                    z = (value - truth[name]) / sigma
                    count[source] += 1
                    beyond[source] += abs(z) > _BEYOND
                    if abs(z) > _BEYOND:
                        print(f"  {source}: {name} {value:.6g} +- {sigma:.2g} instead of {truth[name]:.6g}: {z:+.1f}")
            sys.stdout.flush()
        each = " | ".join(f"{beyond[source]} of {count[source]}" for source in SOURCES)
        rows.append(f"| {kind} | {last - first} | {false} | {missed} | {each} |")
        print(rows[-1], flush=True)
    print("| kind | recordings | with a false cause | with a cause not named |", *(f"{each} |" for each in SOURCES))
    print("|---" * (4 + len(SOURCES)) + "|")
    print("\n".join(rows))


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3:])
