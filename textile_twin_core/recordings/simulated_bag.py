"""Recording of a simulation: messages of a machine's sensors and its twin over a motion."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.comparison.expected_reading import expected_readings
from textile_twin_core.errors import MotionError
from textile_twin_core.files.motion_table import MotionTable
from textile_twin_core.machine import AnyMachine, Machine
from textile_twin_core.recordings.bag_write import BagWriter

_START_NS = 1_000_000_000
"""Time of the first sample; in ROS a stamp of 0 means no stamp."""


def write_simulated_bag(
    path: Path, machine: AnyMachine, motion: MotionTable, outputs: Mapping[str, FloatArray]
) -> None:
    """Write main_shaft/angle, outputs/NAME and, if requested, balancing_torque/measured and predicted.

    Angle and measured torque follow the encoder and torque sensor of the machine, with the sensor's delay and filter,
    without noise, quantisation or edges of teeth. Times are those of the motion, or follow from its constant speed.

    Raises:
        MotionError: The times are unknown, or the encoder is a toothed wheel, whose edges a recording of angles lacks.
    """
    encoder, sensor = machine.sensors.encoder, machine.sensors.torque
    if encoder.teeth:
        raise MotionError(
            f"the encoder is a wheel of {encoder.teeth} teeth, and a recording of a simulation holds angles, not edges:"
            " leave teeth, missing_teeth and pitch_errors_rad out of the machine file for it"
        )
    # Keep stamps after the start, even for a negative delay.
    start_ns = _START_NS + max(0, round(-sensor.delay_s * 1e9))
    stamps = start_ns + np.rint(_times(motion) * 1e9).astype(np.int64)
    with BagWriter(path, {"source": f"simulation of {machine.name}"}, overwrite=True) as out:
        angle = encoder.measured_angle(motion.theta_rad)
        speed = encoder.measured_speed(motion.theta_rad, motion.omega_rad_s)
        out.write_joint_states("main_shaft/angle", stamps, ["main_shaft"], angle, speed)
        if "balancing_torque_Nm" in outputs:
            torque = outputs["balancing_torque_Nm"]
            # The sensor shows the torque with its delay.
            shown = stamps + round(sensor.delay_s * 1e9)
            angles = [event.angle_rad for event in machine.events()] if isinstance(machine, Machine) else []
            reading = expected_readings(sensor, stamps, torque, motion.theta_rad, angles)
            out.write_wrenches("balancing_torque/measured", shown, reading)
            out.write_wrenches("balancing_torque/predicted", stamps, torque)
        for name, values in outputs.items():
            out.write_floats(f"outputs/{name}", stamps, values)


def _times(motion: MotionTable) -> FloatArray:
    if motion.time_s is not None:
        since_first: FloatArray = motion.time_s - motion.time_s[0]
        return since_first
    speed = float(motion.omega_rad_s[0])
    constant = speed != 0.0 and (motion.omega_rad_s == speed).all() and not motion.alpha_rad_s2.any()
    times: FloatArray = (motion.theta_rad - motion.theta_rad[0]) / speed if constant else np.full(1, math.nan)
    if not constant or (len(times) > 1 and not (np.diff(times) > 0).all()):
        raise MotionError("a recording needs times: give the motion a column time_s, or a constant speed above 0")
    return times
