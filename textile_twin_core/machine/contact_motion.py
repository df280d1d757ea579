"""Motion of a contact machine driven by shaft samples: state between samples, and outputs at each of them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.contact import ContactEvent, ContactState, DrivePiece, law_pieces, quintic
from textile_twin_core.contact.drive import IDENTITY
from textile_twin_core.contact.energy import kinetic_energy, potential_energy
from textile_twin_core.contact.log import Log
from textile_twin_core.contact.reading import read_motion
from textile_twin_core.contact.result import events_of
from textile_twin_core.errors import MotionError, SceneError
from textile_twin_core.machine.contact_machine import DRIVE, MOTION, ContactMachine
from textile_twin_core.machine.sizes import computable
from textile_twin_core.mechanism.motion_law import TURN

_TURN_TAIL = 2.4492935982947064e-16
"""2 pi minus its float64 value"""
_MOMENT_S = 1e-6
_SAME_ANGLE = 1e-13
"""rad: so small a difference moves the driven element by less than rounding does"""


class ContactMotion:
    """Integrator of a contact machine over samples in their order; the size of the blocks does not change the result.

    Between two samples the shaft angle is the quintic through both angles, speeds and accelerations. The driven element
    follows its law of motion at that angle; at constant speed there is no interpolation error.

    The first sample finds the machine as if the shaft had turned smoothly from the declared start at theta = 0. The
    same holds after a gap of more than half a turn, over which the motion is unknown. `events` collects events on the
    samples' clock until they are taken.
    """

    def __init__(self, machine: ContactMachine, outputs: Sequence[str] | None = None, tolerance: float = 1e-13) -> None:
        self.machine = machine
        self.outputs = tuple(machine.outputs if outputs is None else outputs)
        for name in self.outputs:
            if name not in machine.outputs:
                raise SceneError(
                    f"machine {machine.name!r} has no output {name!r}; it has {', '.join(machine.outputs)}"
                )
        self.events: list[ContactEvent] = []
        self.restarts = 0
        self._integrator = machine.integrator(tolerance)
        self._wants_drive = any(name in DRIVE for name in self.outputs)
        self._state: ContactState | None = None
        self._last: list[float] | None = None
        self._origin_s = 0.0
        self._count = 0

    def reset(self) -> None:
        """Restart: treat the next sample as the first."""
        self._state = self._last = None
        self.events = []
        self.restarts = self._count = 0

    def take_events(self) -> list[ContactEvent]:
        """Return and clear the events since the last call, on the samples' clock."""
        events, self.events = self.events, []
        return events

    def step(
        self, times_s: FloatArray, theta_rad: FloatArray, omega_rad_s: FloatArray, alpha_rad_s2: FloatArray
    ) -> dict[str, FloatArray]:
        """Compute the outputs, arrays (samples,) by name, at samples of the shaft given as four arrays (samples,).

        Wrapped and unwrapped angles are accepted.

        Raises:
            MotionError: with the sample's number, if times do not increase or a value is not finite.
        """
        columns = [np.atleast_1d(np.asarray(c, dtype=float)) for c in (times_s, theta_rad, omega_rad_s, alpha_rad_s2)]
        if any(column.ndim != 1 or column.shape != columns[0].shape for column in columns):
            raise MotionError(
                f"time, theta, omega and alpha have shapes {', '.join(str(c.shape) for c in columns)}; give one length"
            )
        times, angles, omega, alpha = columns
        self._check(np.array(columns))
        samples = np.array([times, phase(angles), omega, alpha, angles])
        with computable(f"machine '{self.machine.name}', or its motion"):
            found, drive = self._along(samples)
        self._count += samples.shape[1]
        return self._outputs(samples, found, drive)

    def _along(self, samples: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Compute the motion of the elements (3, elements, n) and the drive force (n,) along samples (5, n)."""
        found = np.empty((3, len(self.machine.elements), samples.shape[1]))
        drive = np.zeros(samples.shape[1])
        first = 0
        while first < samples.shape[1]:
            last = self._last
            sample = samples[:, first].tolist()
            turned = 0.0 if last is None else _angle_between(last, sample)
            if last is None or abs(turned) > math.pi:
                self.restarts += last is not None
                logs = [self._begin(*sample[:4])]
                end = first + 1
            else:
                end = first + _straight(last, samples[:, first:])
                sample = samples[:, end - 1].tolist()
                logs = self._advance(last, sample)
            self._last = sample
            at = samples[0, first:end] - self._origin_s
            found[:, :, first:end], drive[first:end] = self._read(logs, at)
            first = end
        return found, drive

    def _check(self, columns: FloatArray) -> None:
        finite = np.isfinite(columns)
        if not finite.all():
            bad = int(np.argmin(finite.all(axis=0)))
            raise MotionError(
                f"sample {self._count + bad}: time, angle, speed or acceleration is not finite; leave it out"
            )
        before = -math.inf if self._last is None else self._last[0]
        for number, time_s in enumerate(columns[0].tolist(), start=self._count):
            if time_s <= before:
                raise MotionError(
                    f"sample {number}: its time {time_s:.9g} s does not follow the one before; sort the samples"
                )
            before = time_s

    def _advance(self, last: list[float], sample: list[float]) -> list[Log]:
        """Advance the machine to a sample, at constant speed if that leads there, else along a quintic.

        Time counts from the last sample, and the angle ends at the phase from which the next call begins. The precision
        is therefore independent of elapsed hours and turns.
        """
        assert self._state is not None
        self._state.clock[0] = 0.0
        self._origin_s = last[0]
        span, turned = sample[0] - last[0], _angle_between(last, sample)
        start, omega = last[1], last[2]
        if last[3] == sample[3] == 0.0 and omega == sample[2] and abs(turned - omega * span) <= _SAME_ANGLE:
            return self._follow((start, omega), 0.0, span)
        end = (start + turned, sample[2], sample[3])
        return self._follow(quintic(span, (start, omega, last[3]), end), 0.0, span)

    def _follow(self, theta_series: tuple[float, ...], start_s: float, end_s: float) -> list[Log]:
        """Advance over one polynomial of the shaft angle and collect events on the samples' clock."""
        assert self._state is not None
        logs: list[Log] = []
        for piece in law_pieces(self.machine.law, start_s, end_s, theta_series):
            logs.append(self._integrator.advance(self._state, piece).log)
            self.events += events_of(self.machine.model, logs[-1], self._origin_s)
        return logs

    def _begin(self, time: float, theta: float, omega: float, alpha: float) -> Log:
        """Bring the machine from its declared start to the first sample along a smooth shaft motion."""
        machine = self.machine
        kept = len(self.events)
        angle = theta % TURN
        if omega < 0.0 and angle > 0.0:
            angle -= TURN
        duration = 1.5 * abs(angle) / max(abs(omega), machine.nominal_speed_rad_s)
        self._state = self._integrator.start(machine.start, (machine.law.evaluate(0.0), 0.0, 0.0), time_s=-duration)
        if duration > 0.0:
            self._follow(quintic(duration, (0.0, 0.0, 0.0), (angle, omega, 0.0)), -duration, 0.0)
        del self.events[kept:]
        self._state.clock[0] = 0.0
        self._origin_s = time
        x, slope, curvature = (machine.law.evaluate(angle, d) for d in range(3))
        velocity, acceleration = slope * omega, curvature * omega * omega + slope * alpha
        piece = DrivePiece(0.0, _MOMENT_S, IDENTITY, (x, velocity, 0.5 * acceleration))
        return self._integrator.advance(self._state.copy(), piece).log

    def _read(self, logs: list[Log], times: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Read position, velocity, acceleration (3, elements, times) and the drive force, just before any event."""
        motion, force = np.empty((3, len(self.machine.elements), times.size)), np.empty(times.size)
        for number, log in enumerate(logs):
            read_motion(self._integrator.plant, log, times, number == 0, motion, force)
        return motion, force

    def _outputs(self, samples: FloatArray, motion: FloatArray, force: FloatArray) -> dict[str, FloatArray]:
        values: dict[str, FloatArray] = {}
        for element in self.machine.elements:
            row = self.machine.model.index[element]
            for k, what in enumerate(MOTION):
                values[f"{element}_{what}"] = motion[k, row]
        if self._wants_drive:
            values |= self._drive(samples, motion, force)
        return {name: values[name] for name in self.outputs}

    def _drive(self, samples: FloatArray, motion: FloatArray, force: FloatArray) -> dict[str, FloatArray]:
        law, mass = self.machine.law, self.machine.driven.mass_kg
        slope = np.array([law.evaluate(theta, 1) for theta in samples[1].tolist()])
        own = mass * motion[2, -1]
        kinetic = kinetic_energy(self._integrator.plant, motion[1]) + 0.5 * mass * motion[1, -1] ** 2
        return {
            "drive_force_N": own - force,
            "balancing_torque_Nm": (own - force) * slope,
            "torque_inertial_Nm": own * slope,
            "torque_gravity_Nm": np.zeros_like(slope),
            "torque_load_Nm": -force * slope,
            "equivalent_inertia_kgm2": mass * slope * slope,
            "kinetic_energy_J": kinetic,
            "potential_energy_J": potential_energy(self.machine.model, motion[0]),
        }


def phase(angle: FloatArray) -> FloatArray:
    """Reduce angles [rad] by whole turns to about [0, 2 pi], exact to the angles' own rounding."""
    wrapped = np.fmod(angle, TURN)  # exact with respect to the float64 period
    turns = np.rint((angle - wrapped) / TURN)
    wrapped = np.where(wrapped < 0.0, wrapped + TURN, wrapped)
    return np.asarray(wrapped - turns * _TURN_TAIL)


def _angle_between(last: list[float], sample: list[float]) -> float:
    """Compute the angle between two samples, from phase to phase, with the whole turns that their speeds imply."""
    expected = 0.5 * (last[2] + sample[2]) * (sample[0] - last[0])
    turned = sample[1] - last[1]
    return turned + TURN * round((expected - turned) / TURN)


def _straight(last: list[float], samples: FloatArray) -> int:
    """Count the samples (at least 1, at most one turn) that continue the last one at one constant speed."""
    if last[3] != 0.0 or samples[3, 0] != 0.0 or samples[2, 0] != last[2]:
        return 1
    time, _, omega, alpha, theta = samples
    elapsed = time - last[0]
    off = theta - last[4] - last[2] * elapsed
    off -= TURN * np.round(off / TURN)
    rounding = 1e-15 * (np.abs(theta) + abs(last[4]) + np.abs(last[2]) * (np.abs(time) + abs(last[0])) + TURN)
    same = (np.abs(off) <= rounding) & (omega == last[2]) & (alpha == 0.0) & (np.abs(last[2]) * elapsed <= TURN)
    broken = np.flatnonzero(~same)
    return max(int(broken[0]) if broken.size else same.size, 1)


def measured_error(machine: ContactMachine, outputs: Sequence[str], tolerance: float) -> float:
    """Measure the error over peak of the worst output, over one cycle at the declared speed.

    The same samples are integrated with a tolerance a thousand times tighter (1e-16 at the tightest). The result is
    three times the largest difference, and at least 1e-15, since bounces amplify rounding and other samples differ.
    """
    times = np.linspace(0.0, TURN / machine.nominal_speed_rad_s, 4801)
    speed = np.full(times.size, machine.nominal_speed_rad_s)
    shaft = (times, machine.nominal_speed_rad_s * times, speed, np.zeros(times.size))
    found = ContactMotion(machine, outputs, tolerance).step(*shaft)
    tighter = ContactMotion(machine, outputs, max(1e-3 * tolerance, 1e-16)).step(*shaft)
    worst = 0.0
    for name, values in tighter.items():
        peak = float(np.abs(values).max())
        if peak > 0.0:
            worst = max(worst, float(np.abs(found[name] - values).max()) / peak)
    return max(3.0 * worst, 1e-15)
