"""Comparison of arrays of samples, by the steps of the command `compare`."""

from __future__ import annotations

import dataclasses

from tests.generators.bridged_samples import Sampled
from textile_twin_core.comparison import Comparison, Readings, assess, compare_torque
from textile_twin_core.machine import Machine
from textile_twin_core.recordings.logged_run import evenly_timed
from textile_twin_core.recordings.prediction import recompute
from textile_twin_core.recordings.samples import AngleSamples, TorqueSamples


def judged(samples: Sampled, machine: Machine) -> Comparison:
    """Compare samples with a machine, at their own stamps."""
    angles = AngleSamples("/angle", samples.angle_stamps, samples.angle, None)
    torque = TorqueSamples("/torque", samples.torque_stamps, samples.torque_Nm)
    angles, torque, timings = evenly_timed(angles, torque, machine)
    predicted = recompute(angles, machine)
    readings = Readings(angles.stamps, angles.angles_rad, torque.stamps, torque.torque_Nm, stamped=tuple(timings))
    assessed = assess(readings, machine, predicted.track)
    comparison = compare_torque(
        torque.stamps,
        torque.torque_Nm,
        predicted.stamps_ns,
        predicted.torque_Nm,
        predicted.theta_rad,
        torque_sensor=machine.sensors.torque,
        delay=assessed.delay,
        events=machine.events(),
        settled=predicted.settled,
        predicted_sigma_Nm=predicted.sigma_Nm,
        rejected=predicted.rejected,
    )
    return dataclasses.replace(comparison, notes=assessed.notes, verdict=assessed.verdict)
