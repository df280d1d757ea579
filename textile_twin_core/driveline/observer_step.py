"""Observer of an elastic shaft, compiled: one reading of the encoder after another.

The chain turns freely under the drive torque. A bank of Kalman filters (`drive_bank`) corrects all stations alike and
tracks the drive. A corrected drive torque comes with its static twist, so no correction sets the shaft vibrating,
whatever the bandwidth of the filters; the vibration that a true change of that size leaves counts in the torque's
sigma. Before the motion is known, at standstill and after a gap the chain instead stands statically twisted at the
estimated motion of the encoder's station.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import by_reference, compiled_in_place
from textile_twin_core.driveline.chain import ShaftChain
from textile_twin_core.driveline.drive_bank import (
    TORQUE,
    DriveBank,
    begin_bank,
    covariance_of,
    innovation_variance,
    predict,
    release,
    update,
)
from textile_twin_core.driveline.runs import Outputs, observe, twist_statically
from textile_twin_core.driveline.second_encoder import (
    SecondEncoder,
    add_twist,
    advance_second,
    restart_second,
    take_second,
)
from textile_twin_core.driveline.step import ChainState, dry_friction, midpoint_step

Record: TypeAlias = Any
Records: TypeAlias = np.ndarray[Any, np.dtype[Any]]
FOLLOWING, OBSERVING = 0.0, 1.0
_SENSE_SIGMAS = 3.0
_STILL_SAMPLES = 25.0
"""Samples without a known sense of rotation until the shaft is at standstill."""
_GAP_SAMPLES = 50.0
_INTERVAL_SAMPLES = 500.0
"""Memory of the mean interval, of the torque's mean square and of the innovations."""
_LEAST_TURN = 1e-4
"""Angle [rad] between two samples from which the load's change over it is a slope."""
_LEAST_DRIVE, _MOST_DRIVE = 0.02, 1e4
"""Bounds of an unknown drive's inertia, over that of all else."""
_RETRY_SAMPLES, _NO_BETTER = 1000.0, 0.5
"""Learning begins again where so many samples have not brought the innovations' mean square down to this share."""
_SURE = 0.1
"""Sigma of the torque over its root mean square up to which a prediction counts as settled."""
NEW_STRETCH = 2.0
_LOST_RAD = math.pi
"""Distance from the shaft estimator's angle at which the chain is lost."""
FIRST_DRIVE = 0.3
"""beta before the first reading, over its largest possible value: a drive 2.3 times as heavy as all else."""
LEAD = 1.0 / 6.0
_RECENT, _IMPROBABLE = 16.0, 4.0
"""Readings over which the normalised innovation squared is averaged, and its largest mean of a settled state: noise of
this many exceeds 2.2 once in 1e4 times, a slow shaft's error of half a step of the encoder is 3."""
_CHECK_SAMPLES, _FALLING, _MISFIT = 250.0, 0.7, 4.0
"""Samples between two looks at the scale of the noise, factor below which it is falling: still learning, and scale from
which the chain with the estimated drive does not explain the readings."""

_ONE_SPEED = 0.03
"""Change of the mean speed of a turn with which an unknown drive is estimated again: its reference has changed, too."""

OBSERVER = np.dtype(
    [
        (name, np.float64)
        for name in (
            "mode", "theta", "omega",  # FOLLOWING or OBSERVING; reference motion [rad, rad/s]
            "d", "lam", "beta",  # the drive, see `drive_bank`
            "learning", "since_begin", "since_release",  # 1 once the drive is estimated; times [s]
            "early", "early_count", "recent", "tried",  # mean squares of innovations before learning, and of late
            "natural", "decay",  # first mode [rad/s] and its decay [1/s]
            "swing", "swing_rate",  # vibration of the torque if corrections were events, its rate over `natural` [N m]
            "turn_begin", "turn_time", "turn_speed",  # of the present turn [rad, s]; mean speed of the first [rad/s]
            "surprise", "calm_begin", "calm",  # mean squared normalised innovation; angle, time since it was improbable
            "last", "vibration",  # torque of the sample before, amplitude of its vibration [N m]
            "checked", "scale", "converged",  # samples since the last look, scale then; 1 once it has stopped falling
            "load", "load_at", "load_slope",  # torque of all but the drive [N m], at an angle [rad]; its slope
            "interval", "still", "torque_square",
            "others", "side",  # mean inertia of all but the drive, and beyond the torque sensor from the drive
            "ground", "drive_ground", "drive_disc",  # viscous friction of all stations, of the drive's; its own disc
            "known_inertia", "known_slip", "inertia", "slip",  # 1 where given; values
            "drive", "encoder", "second", "piece", "sign",  # stations; the sensor's piece
            "substep", "numeric", "wait", "ring",  # [s]; integration error over RMS torque; times [s], see `observer`
        )
    ]
)  # fmt: skip
STATE = np.dtype(
    [(name, np.float64) for name in ("angle", "speed", "acceleration", "settled", "rung", "sigma")]
    + [("covariance", np.float64, (9,))]
)
"""What the observer makes of a reading: the encoder's station (angle relative to the record's origin), 1 where the
start has rung off, whatever the readings say (`rung`), and the torque sensor's sigma [N m]."""


@by_reference
class ShaftReadings(NamedTuple):
    """Accepted readings with the motion that the shaft estimator found, arrays (n,) and (n, 9)."""

    step: FloatArray
    """time since the reading before [s]"""
    reading: FloatArray
    """unwrapped [rad]"""
    variance: FloatArray
    """of a reading [rad^2]"""
    used: FloatArray
    """0 for a reading that was rejected, else positive"""
    cut: FloatArray
    """2 or more where the record begins again"""
    settled: FloatArray
    angle: FloatArray
    speed: FloatArray
    acceleration: FloatArray
    covariance: FloatArray
    second: FloatArray
    """the second encoder's latest reading since the sample before [rad]; NaN where there is none"""
    late: FloatArray
    """time from the second encoder's reading to the sample [s]"""


def shaft_readings(rows: Records, second: FloatArray | None = None, late: FloatArray | None = None) -> ShaftReadings:
    """Readings from rows of the shaft estimator's states, with those of a second encoder where given."""
    columns = ("step", "reading", "unit", "noise", "cut", "settled", "angle", "speed", "acceleration", "covariance")
    missing = np.full(len(rows), math.nan)
    beside = (missing if each is None else each for each in (second, late))
    return ShaftReadings(*(np.ascontiguousarray(rows[name]) for name in columns), *beside)


@by_reference
class Room(NamedTuple):
    """Arrays of the observer beside chain, state and bank."""

    inertia: FloatArray
    """(stations,) mean inertia without the drive's [kg m^2]"""
    torque: FloatArray
    """(stations,) external torque [N m]"""
    most_lead: FloatArray
    """(pieces,) bound of `lead` times the substep squared [s^2]"""
    gradient: FloatArray
    """(5, 5) gradients by x of angle, speed, acceleration, torque and mobility"""
    twist: FloatArray
    """(stations,) static twist of a uniform acceleration, 0 at the encoder's station [rad s^2/rad]"""


@compiled_in_place
def observe_readings(
    chain: ShaftChain,
    state: ChainState,
    bank: DriveBank,
    observers: Records,
    room: Room,
    second: SecondEncoder,
    readings: ShaftReadings,
    found: Records,
    out: Outputs,
) -> None:
    """Take readings in their order; fills a row of `found` and of `out` for each."""
    for j in range(readings.step.size):
        _take(chain, state, bank, observers[0], room, second, readings, j, found[j], out)


@compiled_in_place
def _take(
    chain: ShaftChain,
    state: ChainState,
    bank: DriveBank,
    o: Record,
    room: Room,
    second: SecondEncoder,
    r: ShaftReadings,
    j: int,
    row: Record,
    out: Outputs,
) -> None:
    """Take one reading."""
    twist_variance = 0.0
    sense = abs(r.speed[j]) > _SENSE_SIGMAS * math.sqrt(max(r.covariance[j, 4], 0.0))
    gap = r.step[j] > _GAP_SAMPLES * o.interval > 0.0
    if o.interval == 0.0:
        o.interval = r.step[j]
    elif not gap:
        o.interval += (r.step[j] - o.interval) / _INTERVAL_SAMPLES
    o.still = 0.0 if sense else o.still + 1.0
    if o.still > _STILL_SAMPLES or gap or r.cut[j] >= NEW_STRETCH:
        o.mode = FOLLOWING
    if o.mode == OBSERVING:
        _advance(chain, state, bank, o, room, r, j)
        if not abs(o.theta + state.psi[int(o.encoder)] - r.angle[j]) < _LOST_RAD:
            _forget(state, o)
    if o.mode == OBSERVING:
        observe(chain, state, o.theta, o.omega, 0.0, -1, room.torque, j, out)
        if second.shape.size:
            twist_variance = _take_second(chain, o, second, r, j, out)
    else:
        restart_second(second)
        o.theta, o.omega = r.angle[j], r.speed[j] if sense else 0.0
        _twist(chain, state, o, room, r.acceleration[j])
        observe(chain, state, o.theta, o.omega, r.acceleration[j], int(o.drive), room.torque, j, out)
    _report(chain, state, bank, o, room, r, j, row, out, twist_variance, sense)
    if o.mode == FOLLOWING and sense and r.settled[j] > 0.5:
        _begin(bank, o, room, r, j)


@compiled_in_place
def _take_second(chain: ShaftChain, o: Record, second: SecondEncoder, r: ShaftReadings, j: int, out: Outputs) -> float:
    """Correct row j by the second encoder; returns the variance that this gives the sensor's torque."""
    variance = 2.0 * r.variance[j]  # that of the difference of two readings
    advance_second(second, r.step[j], o.interval, variance)
    if not math.isnan(r.second[j]) and r.used[j] > 0.0:
        encoder, at, late = int(o.encoder), int(o.second), r.late[j]
        twist = out.psi[j, at] - out.psi[j, encoder] - late * (out.omega[j, at] - 0.5 * late * out.alpha[j, at])
        rung = 1.0 if o.since_begin > o.ring else 0.0
        take_second(second, r.second[j] - r.reading[j] - twist, o.interval, variance, rung)
    return add_twist(second, chain, int(o.piece), j, out)


@compiled_in_place
def _forget(state: ChainState, o: Record) -> None:
    """Restart after the track of the chain was lost; an unknown drive is unknown again."""
    o.mode, o.torque_square = FOLLOWING, 0.0
    o.learning, o.converged, o.d, o.lam = 0.0, 0.0, 0.0, 0.0
    if o.known_inertia == 0.0:
        o.beta = FIRST_DRIVE / o.others
    for i in range(state.psi.size):
        state.psi[i] = state.speed[i] = state.acceleration[i] = 0.0


@compiled_in_place
def _twist(chain: ShaftChain, state: ChainState, o: Record, room: Room, alpha: float) -> None:
    """Stand statically twisted with the encoder's station on the reference; the drive supplies the static torque."""
    drive = int(o.drive)
    _set_drive(chain, o, room)
    room.torque[drive] = 0.0
    twist_statically(chain, state, o.theta, o.omega, alpha, drive, room.torque)
    total = 0.0
    for i in range(room.torque.size):
        total += state.right[i]
    room.torque[drive] = total
    shift = state.psi[int(o.encoder)]
    o.theta -= shift


@compiled_in_place
def _set_drive(chain: ShaftChain, o: Record, room: Room) -> None:
    """Give the chain the drive's inertia, slip and torque."""
    drive = int(o.drive)
    least, most = 1.0 / (o.others * (1.0 + _MOST_DRIVE)), 1.0 / (o.others * (1.0 + _LEAST_DRIVE))
    if o.known_inertia == 0.0:
        o.beta = min(max(o.beta, least), most)
    if o.known_slip > 0.0:
        o.lam = o.beta * o.slip
    o.lam = max(o.lam, 0.0)
    chain.inertia[drive] = o.drive_disc + 1.0 / o.beta - o.others
    chain.viscous[drive] = o.drive_ground + o.lam / o.beta
    room.torque[drive] = o.d / o.beta


@compiled_in_place
def _begin(bank: DriveBank, o: Record, room: Room, r: ShaftReadings, j: int) -> None:
    """Let the chain go from the static twist; the estimate of the drive stays."""
    o.mode, o.since_begin, o.still = OBSERVING, 0.0, 0.0
    o.d = room.torque[int(o.drive)] * o.beta
    o.load_at, o.load_slope, o.load = r.angle[j], 0.0, math.nan
    o.swing = o.swing_rate = 0.0
    o.surprise, o.calm, o.calm_begin = 1.0, 0.0, r.angle[j]
    o.last, o.vibration = math.nan, 0.0
    noise = r.variance[j] / max(o.interval, 1e-9) ** 4
    torque = r.covariance[j, 8] + r.speed[j] ** 4 + noise
    begin_bank(bank, r.covariance[j, 0] + r.variance[j], r.covariance[j, 4] + r.variance[j] / o.interval**2, torque)
    if o.learning == 0.0:
        o.early = o.early_count = 0.0
    o.recent, o.tried, o.turn_begin, o.turn_time = 0.0, 0.0, o.load_at, 0.0


@compiled_in_place
def _advance(
    chain: ShaftChain, state: ChainState, bank: DriveBank, o: Record, room: Room, r: ShaftReadings, j: int
) -> None:
    """Let the chain turn up to a reading, and correct it by the reading."""
    n, drive, encoder, dt = chain.inertia.size, int(o.drive), int(o.encoder), r.step[j]
    _set_drive(chain, o, room)
    substeps = max(math.ceil(dt / o.substep - 1e-6), 1)
    h = dt / substeps
    for i in range(n - 1):
        chain.lead[i] = min(LEAD, room.most_lead[i] / (h * h))
    inertia = 1.0 / o.beta
    own = inertia - o.others
    before = own * state.speed[drive]
    for i in range(n):
        before += room.inertia[i] * state.speed[i]
    begin = o.omega + state.speed[drive]
    for _ in range(substeps):
        midpoint_step(chain, state, o.theta, o.omega, 0.0, h, -1, room.torque)
        o.theta += h * o.omega
    after = own * state.speed[drive]
    for i in range(n):
        after += room.inertia[i] * state.speed[i]
    alpha = (after - before) * o.beta / dt
    speed = 0.5 * (begin + o.omega + state.speed[drive])
    load = (o.d - o.lam * speed - alpha) * inertia
    angle = o.theta + state.psi[encoder]
    turned = angle - o.load_at
    friction, _ = _open_friction(chain, state, o, room, True)
    sloping = abs(turned) > _LEAST_TURN and friction == 0.0 and not math.isnan(o.load)
    o.load_slope = (load - o.load) / turned if sloping else 0.0
    o.load, o.load_at = load, angle
    rate = o.lam + o.beta * o.ground
    decay = math.exp(-rate * dt)
    first = (1.0 - decay) / rate if abs(rate * dt) > 1e-6 else dt
    second = (dt - first) / rate if abs(rate * dt) > 1e-6 else 0.5 * dt * dt
    _set_gradient(o, room, speed, rate)
    slopes, step = room.gradient[2], bank.step
    step[0, 0], step[0, 1], step[1, 1] = 1.0, first, decay
    step[1, 0] = slopes[0] * first
    for i in range(2, 5):
        step[0, i], step[1, i] = slopes[i] * second, slopes[i] * first
    for m in range(bank.memory.size):
        bank.covariance[m, TORQUE, TORQUE] += (o.beta * friction) ** 2 / _STILL_SAMPLES
    predict(bank, dt, o.interval, r.variance[j], o.learning)
    o.since_begin += dt
    o.since_release += dt
    o.calm += dt
    if o.surprise > _IMPROBABLE:
        o.calm, o.calm_begin = 0.0, angle
    left, cosine, sine = math.exp(-o.decay * dt), math.cos(o.natural * dt), math.sin(o.natural * dt)
    swing = o.swing
    o.swing = left * (cosine * swing + sine * o.swing_rate)
    o.swing_rate = left * (cosine * o.swing_rate - sine * swing)
    if r.used[j] > 0.0:
        off = r.reading[j] - angle
        o.surprise += (off * off / innovation_variance(bank, r.variance[j]) - o.surprise) / _RECENT
        update(bank, off, r.variance[j])
        o.theta += bank.mean[0]
        o.load_at += bank.mean[0]
        o.omega += bank.mean[1]
        o.d += bank.mean[2]
        o.lam += bank.mean[3]
        o.beta += bank.mean[4]
        faster = 0.0
        for i in range(1, 5):
            faster += slopes[i] * bank.mean[i]
        for i in range(n):
            state.psi[i] += faster * room.twist[i]
        o.swing -= o.side * faster
        _learn(bank, o, off, r.variance[j], dt)


@compiled_in_place
def _set_gradient(o: Record, room: Room, speed: float, rate: float) -> None:
    """Gradients by x; of the acceleration, and of the torque beyond the sensor."""
    gradient = room.gradient
    for i in range(4):
        for k in range(5):
            gradient[i, k] = 0.0
    gradient[0, 0] = gradient[1, 1] = gradient[4, 4] = 1.0
    gradient[2, 0], gradient[2, 1], gradient[2, 2] = -o.beta * o.load_slope, -rate, 1.0
    gradient[2, 3], gradient[2, 4] = -speed, -o.load
    if o.known_slip > 0.0:
        gradient[2, 4] -= o.slip * speed
    for k in range(5):
        gradient[3, k] = o.side * gradient[2, k]
    gradient[3, 0] += o.side / o.others * o.load_slope


@compiled_in_place
def _speed_changed(o: Record, dt: float) -> bool:
    """Return true where a turn ends whose mean speed is not that of the first one."""
    o.turn_time += dt
    turned = abs(o.load_at - o.turn_begin)
    if turned < 2.0 * math.pi:
        return False
    speed, first = turned / o.turn_time, o.turn_speed
    changed = abs(speed - first) > _ONE_SPEED * first
    o.turn_begin, o.turn_time = o.load_at, 0.0
    o.turn_speed = speed if changed else first
    return changed and first > 0.0


@compiled_in_place
def _learn(bank: DriveBank, o: Record, off: float, variance: float, dt: float) -> None:
    """Begin to estimate an unknown drive once the chain swings as it does, and again where that did not succeed."""
    if bank.prior[0] == 0.0 and bank.prior[1] == 0.0:
        return
    spread = o.interval**-4 * variance + o.omega**4 + (bank.prior[0] * o.omega) ** 2
    changed = _speed_changed(o, dt)
    if o.learning == 0.0:
        o.early += off * off
        o.early_count += 1.0
        if o.since_begin >= o.wait:
            o.early /= o.early_count
            release(bank, spread, max(o.early / variance, 1.0))
            o.learning, o.since_release, o.tried, o.recent = 1.0, 0.0, 0.0, o.early
            o.checked, o.scale, o.converged = 0.0, math.inf, 0.0
        return
    if changed:
        release(bank, spread, 1.0)
        o.since_release, o.converged, o.scale, o.checked = 0.0, 0.0, math.inf, 0.0
    o.tried += 1.0
    o.checked += 1.0
    if o.checked >= _CHECK_SAMPLES:
        scale = 0.0
        for m in range(bank.memory.size):
            scale += bank.probability[m] * bank.scale[m]
        o.converged = 1.0 if _FALLING * o.scale < scale < _MISFIT else 0.0
        o.scale, o.checked = scale, 0.0
    o.recent += (off * off - o.recent) / _INTERVAL_SAMPLES
    if o.tried >= _RETRY_SAMPLES:
        if o.recent > _NO_BETTER * o.early and o.recent > 4.0 * variance:
            release(bank, spread, max(o.recent / variance, 1.0))
            o.beta = FIRST_DRIVE / o.others if o.known_inertia == 0.0 else o.beta
            o.early, o.since_release, o.converged, o.scale = o.recent, 0.0, 0.0, math.inf
        o.tried = 0.0


@compiled_in_place
def _open_friction(chain: ShaftChain, state: ChainState, o: Record, room: Room, sense: bool) -> tuple[float, float]:
    """Dry friction between whose two bounds the motion leaves open: of all stations, and beyond the sensor [N m].

    That of stations without a known sense of rotation, and of those too slow for the time step (see `mounted`).
    """
    piece, total, beyond = int(o.piece), 0.0, 0.0
    far = piece >= int(o.drive)
    for i in range(room.inertia.size):
        if not sense or abs(o.omega + state.speed[i]) * room.inertia[i] < 0.5 * o.substep * chain.friction_Nm:
            own = dry_friction(chain, state.load, i, o.theta + state.psi[i])
            total += own
            beyond += own if (i > piece) == far else 0.0
    return total, beyond


@compiled_in_place
def _out_of_phase(bank: DriveBank, o: Record, room: Room, torque: float, dt: float) -> float:
    """Error of the vibrating torque [N m] where the drive's inertia, and with it the natural frequency, is uncertain.

    Two masses on a spring: the frequency is off by half the others' share times that of the drive's inertia; the error
    of a vibration that decays as exp(-d t) is largest at t = 1 / d.
    """
    apart = abs(torque - o.last) / (2.0 * math.sin(0.5 * min(o.natural * dt, math.pi)))
    held = o.vibration * math.exp(-o.decay * dt)
    o.vibration = max(held, apart) if apart == apart else held
    o.last = torque
    sigma = math.sqrt(max(covariance_of(bank, room.gradient[4], room.gradient[4]), 0.0)) / o.beta
    own = 1.0 - o.others * o.beta
    phase = 0.5 * o.others * o.beta / own * sigma * o.natural / max(o.decay, 1e-300) / math.e
    return o.vibration * min(phase, 2.0)


@compiled_in_place
def _report(
    chain: ShaftChain,
    state: ChainState,
    bank: DriveBank,
    o: Record,
    room: Room,
    r: ShaftReadings,
    j: int,
    row: Record,
    out: Outputs,
    twist_variance: float,
    sense: bool,
) -> None:
    """The encoder's station, covariances and the torque's sigma."""
    _, friction = _open_friction(chain, state, o, room, sense)
    encoder, torque = int(o.encoder), out.pieces[j, int(o.piece)]
    row.angle = o.theta + out.psi[j, encoder]
    row.speed, row.acceleration = out.omega[j, encoder], out.alpha[j, encoder]
    if o.mode == FOLLOWING:
        row.acceleration = r.acceleration[j]
        for k in range(9):
            row.covariance[k] = r.covariance[j, k]
        row.sigma = math.sqrt(o.side**2 * max(r.covariance[j, 8], 0.0) + friction**2)
        sure = row.sigma <= _SURE * max(math.sqrt(o.torque_square), abs(torque))
        row.settled = 1.0 if r.settled[j] > 0.5 and o.still > _STILL_SAMPLES and sure else 0.0
        row.rung = row.settled
        return
    o.torque_square += (torque * torque - o.torque_square) / min(_INTERVAL_SAMPLES, 1.0 + o.since_begin / o.interval)
    gradient = room.gradient
    for i in range(3):
        for k in range(i, 3):
            covariance = covariance_of(bank, gradient[i], gradient[k])
            row.covariance[3 * i + k] = row.covariance[3 * k + i] = covariance
    variance = covariance_of(bank, gradient[3], gradient[3]) + o.numeric**2 * o.torque_square + twist_variance
    variance += friction**2 + o.swing**2 + o.swing_rate**2
    if o.known_inertia == 0.0:
        variance += _out_of_phase(bank, o, room, torque, r.step[j]) ** 2
    row.sigma = math.sqrt(max(variance, 0.0) * max(o.surprise, 1.0))
    learned = (bank.prior[0] == 0.0 and bank.prior[1] == 0.0) or (o.converged > 0.0 and o.since_release > o.ring)
    sure = row.sigma <= _SURE * math.sqrt(o.torque_square)
    row.rung = 1.0 if r.settled[j] > 0.5 and o.since_begin > o.ring and learned and sure else 0.0
    calm = o.calm > o.ring and abs(o.load_at - o.calm_begin) > 2.0 * math.pi
    row.settled = row.rung if calm else 0.0
