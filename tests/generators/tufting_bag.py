"""Write a synthetic recording of the tufting machine: `python -m tests.generators.tufting_bag OUT`.

OUT becomes a rosbag2 directory (MCAP). The machine is the rig of `tufting_rig` with its own equations of motion. The
sensors are here: an absolute encoder on the crank and a torque sensor in the shaft, sampled one shortly after the other
at 500 Hz, with errors of the stamps and lost samples. The same seed and duration give the same bytes on the same
machine.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from tests.generators.multibody import Floats
from tests.generators.tufting_rig import STEPS_PER_SECOND, Rig, Run, run

Stamps = npt.NDArray[np.int64]

ANGLE_TOPIC = "/main_shaft/angle"
TORQUE_TOPIC = "/balancing_torque/measured"
START_NS = 1_767_081_600_000_000_000
SENSOR_QOS = Qos(
    QosHistory.KEEP_LAST,
    500,
    QosReliability.RELIABLE,
    QosDurability.VOLATILE,
    QosTime(0, 0),
    QosTime(0, 0),
    QosLiveliness.AUTOMATIC,
    QosTime(0, 0),
    False,
)


@dataclass(frozen=True)
class Sensors:
    """True sensor parameters; measured torque(t) = gain * torque(t - delay) + offset + noise."""

    rate_hz: float = 500.0
    encoder_bits: int = 16
    stamp_error_s: float = 20e-6
    angle_loss: float = 0.015
    torque_loss: float = 0.010
    torque_phase_s: float = 0.00025
    torque_delay_s: float = 0.002
    torque_gain: float = 1.01
    torque_offset_Nm: float = 0.0
    torque_noise_Nm: float = 0.05
    torque_resolution_Nm: float = 2.0**-10


@dataclass(frozen=True)
class Recording:
    """Settings of a recording: duration [s], seed, the rig and the sensors."""

    duration_s: float = 46.0
    seed: int = 20160614
    rig: Rig = field(default_factory=Rig)
    sensors: Sensors = field(default_factory=Sensors)


@dataclass(frozen=True)
class Samples:
    """Received samples: stamp and arrival [ns], value [rad, wrapped to one turn, or N m]."""

    stamps_ns: Stamps
    arrivals_ns: Stamps
    values: Floats


def record(recording: Recording) -> tuple[Samples, Samples, Run]:
    """Run the rig and sample it; return angle samples, torque samples, and the truth."""
    sensors = recording.sensors
    truth = run(recording.rig, recording.duration_s)
    rng = np.random.default_rng(recording.seed)
    stride = round(STEPS_PER_SECOND / sensors.rate_hz)

    ticks = np.arange(0, truth.time_s.size, stride)
    counts = 1 << sensors.encoder_bits
    angle = np.rint(truth.theta_rad[ticks] * (counts / (2.0 * math.pi))) % counts * (2.0 * math.pi / counts)
    angles = _through_the_wire(truth.time_s[ticks], angle, sensors.stamp_error_s, sensors.angle_loss, rng)

    ticks = np.arange(round(sensors.torque_phase_s * STEPS_PER_SECOND), truth.time_s.size, stride)
    delayed = np.maximum(ticks - round(sensors.torque_delay_s * STEPS_PER_SECOND), 0)
    torque = sensors.torque_gain * truth.shaft_torque_Nm[delayed] + sensors.torque_offset_Nm
    torque += sensors.torque_noise_Nm * rng.standard_normal(ticks.size)
    torque = np.rint(torque / sensors.torque_resolution_Nm) * sensors.torque_resolution_Nm
    torques = _through_the_wire(truth.time_s[ticks], torque, sensors.stamp_error_s, sensors.torque_loss, rng)
    return angles, torques, truth


def write_bag(path: Path, recording: Recording) -> None:
    """Write the recording to the rosbag2 directory `path`, which must not exist yet."""
    angles, torques, truth = record(recording)
    types = get_typestore(Stores.ROS2_JAZZY)
    header, stamp = types.types["std_msgs/msg/Header"], types.types["builtin_interfaces/msg/Time"]
    joint_state, vector = types.types["sensor_msgs/msg/JointState"], types.types["geometry_msgs/msg/Vector3"]
    wrench_stamped, wrench = (
        types.types["geometry_msgs/msg/WrenchStamped"],
        types.types["geometry_msgs/msg/Wrench"],
    )
    nothing, zero = np.empty(0), vector(x=0.0, y=0.0, z=0.0)

    messages: list[tuple[int, str, object]] = []
    for stamp_ns, arrival_ns, value in zip(*_lists(angles), strict=True):
        head = header(stamp=stamp(sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9), frame_id="")
        position = np.array([value])
        state = joint_state(header=head, name=["main_shaft"], position=position, velocity=nothing, effort=nothing)
        messages.append((arrival_ns, ANGLE_TOPIC, state))
    for stamp_ns, arrival_ns, value in zip(*_lists(torques), strict=True):
        head = header(stamp=stamp(sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9), frame_id="main_shaft")
        load = wrench(force=zero, torque=vector(x=0.0, y=0.0, z=value))
        messages.append((arrival_ns, TORQUE_TOPIC, wrench_stamped(header=head, wrench=load)))
    messages.sort(key=lambda message: message[0])

    with _writer(path) as bag:
        for key, fact in _custom_data(recording, truth).items():
            bag.set_custom_data(key, fact)
        connections = {
            topic: bag.add_connection(topic, kind, typestore=types, offered_qos_profiles=[SENSOR_QOS])
            for topic, kind in (
                (ANGLE_TOPIC, "sensor_msgs/msg/JointState"),
                (TORQUE_TOPIC, "geometry_msgs/msg/WrenchStamped"),
            )
        }
        for arrival_ns, topic, message in messages:
            connection = connections[topic]
            bag.write(connection, arrival_ns, types.serialize_cdr(message, connection.msgtype))


def _writer(path: Path) -> Writer:
    bag = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
    bag.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    return bag


def _lists(samples: Samples) -> tuple[list[int], list[int], list[float]]:
    return samples.stamps_ns.tolist(), samples.arrivals_ns.tolist(), samples.values.tolist()


def _through_the_wire(time: Floats, values: Floats, error_s: float, loss: float, rng: np.random.Generator) -> Samples:
    """Add stamp errors (whole microseconds), losses of single samples and short runs, and a delayed arrival."""
    error = np.clip(error_s * rng.standard_normal(time.size), -5.0 * error_s, 5.0 * error_s)
    stamps = np.rint((time + error) * 1e6).astype(np.int64) * 1000 + START_NS
    latency = np.rint(120.0 + rng.exponential(30.0, time.size)).astype(np.int64) * 1000
    arrivals = np.maximum.accumulate(stamps + latency)
    kept = np.ones(time.size, dtype=bool)
    for first in np.flatnonzero(rng.random(time.size) < loss / 1.35):
        kept[first : first + rng.choice([1, 2, 4], p=[0.75, 0.20, 0.05])] = False
    return Samples(stamps[kept], arrivals[kept], values[kept])


def _custom_data(recording: Recording, truth: Run) -> dict[str, str]:
    """Describe the origin and the truth of the recording as text for metadata.yaml."""
    steady = truth.omega_rad_s[truth.time_s > recording.rig.brake_s + recording.rig.ramp_s + 1.0]
    facts: dict[str, object] = {
        "origin": "synthetic: simulated by tests/generators/tufting_bag.py, no machine was measured",
        "machine": "tufting DHGN801D-400, one needle linkage (Xu et al. 2016, Table 1), made-up drive line",
        "seed": recording.seed,
        "duration_s": recording.duration_s,
    }
    if steady.size:
        facts["true_steady_speed_rpm"] = f"{steady.mean() * 30.0 / math.pi:.3f}"
    for part in (recording.rig, recording.sensors):
        facts.update({f"true_{key}": value for key, value in dataclasses.asdict(part).items()})
    return {key: str(value) for key, value in facts.items()}


def main() -> None:
    """Parse the command line (folder, duration and seed) and write."""
    parser = argparse.ArgumentParser(description="Write a synthetic recording of the tufting machine.")
    parser.add_argument("out", type=Path, help="directory to make")
    parser.add_argument("--duration", type=float, default=Recording.duration_s, metavar="S", help="seconds recorded")
    parser.add_argument("--seed", type=int, default=Recording.seed)
    args = parser.parse_args()
    write_bag(args.out, Recording(duration_s=args.duration, seed=args.seed))


if __name__ == "__main__":
    main()
