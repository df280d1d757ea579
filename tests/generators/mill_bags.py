"""Write synthetic recordings of the machines other than tufting: `python -m tests.generators.mill_bags FOLDER`.

Each becomes a rosbag2 folder (MCAP). The shaft's motion is planned in closed form (`planned_motion`); the encoder is an
absolute one of 14 bits at 500 Hz. The handloom's torque follows from bodies in redundant coordinates (`multibody`),
which share no code with the engine. The other two recordings hold the angle alone, since no masses or no torque are
published. The same seed gives the same messages.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from tests.generators.multibody import Body, Floats, Guide, Multibody, Pin, Weld
from tests.generators.planned_motion import Plan
from tests.generators.shaft_law import Friction, ShaftLaw
from tests.generators.tufting_bag import ANGLE_TOPIC, SENSOR_QOS, START_NS, TORQUE_TOPIC

RATE_HZ, DURATION_S, BITS = 500.0, 16.0, 14
STAMP_ERROR_S, LOSS = 20e-6, 0.01
TORQUE_NOISE_NM = 0.03
FRICTION = Friction(viscous_Nms=0.01, coulomb_Nm=0.2)
"""Friction of the loom's bearings, which its paper does not give."""
SPEED_RAD_S = {"handloom_beatup": 15.5, "elliptic_gear_beatup": 31.4, "needle_transfer": 26.18}
"""Published speeds: 148 rpm, 300 rpm, 250 cycles per minute."""
# Topalbekiroglu and Celik 2010: crank, coupler, rocker AB and the bar AE that it is a part of, with the beater at E.
CRANK_M, COUPLER_M, ROCKER_M, GROUND_M, BAR_M = 0.0597, 0.2007, 0.23082, 0.3, 0.3001
CRANK_KG, COUPLER_KG, BAR_KG, BEATER_KG = 0.129, 0.434, 0.649, 2.5
CRANK_KGM2, COUPLER_KGM2, BAR_KGM2 = 4.073e-5, 0.0015, 0.0049


def handloom_law() -> ShaftLaw:
    """Return the handloom's reduction to the shaft; bar and beater are one body."""
    pin = complex(CRANK_M, 0.0)
    across = complex(GROUND_M, 0.0) - pin
    along = (abs(across) ** 2 + COUPLER_M**2 - ROCKER_M**2) / (2.0 * abs(across))
    joint = pin + across / abs(across) * complex(along, math.sqrt(COUPLER_M**2 - along**2))
    way = (joint - GROUND_M) / ROCKER_M
    mass = BAR_KG + BEATER_KG
    centroid = (BAR_KG * BAR_M / 2.0 + BEATER_KG * BAR_M) / mass
    inertia = BAR_KGM2 + BAR_KG * (BAR_M / 2.0 - centroid) ** 2 + BEATER_KG * (BAR_M - centroid) ** 2
    middle, centre = (pin + joint) / 2.0, GROUND_M + centroid * way
    angles = [math.atan2(v.imag, v.real) for v in (joint - pin, way)]
    bodies = [
        Body(CRANK_KG, CRANK_KGM2, (CRANK_M / 2.0, 0.0, 0.0)),
        Body(COUPLER_KG, COUPLER_KGM2, (middle.real, middle.imag, angles[0])),
        Body(mass, inertia, (centre.real, centre.imag, angles[1])),
    ]
    joints: list[Pin | Weld | Guide] = [
        Pin(0, (-CRANK_M / 2.0, 0.0), None, (0.0, 0.0)),
        Pin(0, (CRANK_M / 2.0, 0.0), 1, (-COUPLER_M / 2.0, 0.0)),
        Pin(1, (COUPLER_M / 2.0, 0.0), 2, (ROCKER_M - centroid, 0.0)),
        Pin(2, (-centroid, 0.0), None, (GROUND_M, 0.0)),
    ]
    return ShaftLaw(Multibody(bodies, joints, driven=0), travel=7, travel_sense=1.0, travel_origin=0.0)


def plan(machine: str) -> Plan:
    """Plan half a second of standstill, a run-up in 3 s, running with 1.5 % ripple and a change of speed, a pause."""
    speed, end = SPEED_RAD_S[machine], DURATION_S
    points = [(0.0, 0.0), (0.5, 0.0), (3.5, speed), (8.0, 1.002 * speed), (9.0, 0.8 * speed), (10.0, 0.8 * speed)]
    points += [(11.0, speed), (end - 2.5, 0.998 * speed), (end - 0.5, 0.0), (end, 0.0)]
    return Plan(points, start_rad=0.4, ripple=((1, 0.015, 0.7), (2, 0.005, 2.1)))


def write_bag(path: Path, machine: str, seed: int = 1) -> None:
    """Write one machine's recording."""
    rng, motion = np.random.default_rng([seed, 20260102, len(machine)]), plan(machine)
    types = get_typestore(Stores.ROS2_JAZZY)
    header, time = types.types["std_msgs/msg/Header"], types.types["builtin_interfaces/msg/Time"]
    joint, wrench = types.types["sensor_msgs/msg/JointState"], types.types["geometry_msgs/msg/WrenchStamped"]
    pair, vector = types.types["geometry_msgs/msg/Wrench"], types.types["geometry_msgs/msg/Vector3"]
    empty, zero = np.empty(0), vector(0.0, 0.0, 0.0)

    def stamped(stamp: int, frame: str = "") -> Any:
        return header(stamp=time(sec=stamp // 10**9, nanosec=stamp % 10**9), frame_id=frame)

    times = np.arange(0.0, DURATION_S, 1.0 / RATE_HZ)
    steps = 2.0 * math.pi / (1 << BITS)
    readings = np.mod(np.floor(motion.at(times)[0] / steps) * steps, 2.0 * math.pi)
    messages: list[tuple[int, str, Any]] = [
        (stamp, ANGLE_TOPIC, joint(stamped(stamp), ["main_shaft"], np.array([value]), empty, empty))
        for stamp, value in _logged(times, readings, rng)
    ]
    if machine == "handloom_beatup":
        times = times + 0.0004
        torques = handloom_law().torque(*motion.at(times), FRICTION) + TORQUE_NOISE_NM * rng.standard_normal(times.size)
        messages += [
            (stamp, TORQUE_TOPIC, wrench(stamped(stamp, "main_shaft"), pair(zero, vector(0.0, 0.0, float(value)))))
            for stamp, value in _logged(times, torques, rng)
        ]
    bag = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
    bag.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with bag:
        for key, value in facts(machine, seed).items():
            bag.set_custom_data(key, value)
        kinds = {ANGLE_TOPIC: joint.__msgtype__, TORQUE_TOPIC: wrench.__msgtype__}
        connections = {
            topic: bag.add_connection(topic, kinds[topic], typestore=types, offered_qos_profiles=(SENSOR_QOS,))
            for topic in dict.fromkeys(topic for _, topic, _ in messages)
        }
        for stamp, topic, message in sorted(messages, key=lambda entry: entry[0]):
            bag.write(connections[topic], stamp + 150_000, types.serialize_cdr(message, kinds[topic]))


def _logged(times: Floats, values: Floats, rng: np.random.Generator) -> list[tuple[int, float]]:
    """Return stamps with their error and values, without lost samples."""
    error = np.clip(STAMP_ERROR_S * rng.standard_normal(times.size), -5.0 * STAMP_ERROR_S, 5.0 * STAMP_ERROR_S)
    stamps = np.rint((times + error) * 1e6).astype(np.int64) * 1000 + START_NS
    kept = rng.random(times.size) >= LOSS
    return list(zip(stamps[kept].tolist(), values[kept].tolist(), strict=True))


def facts(machine: str, seed: int) -> dict[str, str]:
    """Describe the origin and the truth of the recording as text for metadata.yaml."""
    said = {
        "origin": "synthetic: tests/generators/mill_bags.py, no machine was measured",
        "machine": machine,
        "seed": str(seed),
        "true_speed_rad_s": f"{SPEED_RAD_S[machine]:g}",
        "encoder_bits": str(BITS),
        "stamp_error_s": str(STAMP_ERROR_S),
        "lost": str(LOSS),
    }
    if machine == "handloom_beatup":
        said |= {
            "torque_noise_Nm": str(TORQUE_NOISE_NM),
            "true_viscous_Nms": str(FRICTION.viscous_Nms),
            "true_coulomb_Nm": str(FRICTION.coulomb_Nm),
        }
    return said


def main() -> None:
    """Parse the command line (folder and seed) and write."""
    parser = argparse.ArgumentParser(description="Write synthetic recordings of the looms and the needle transfer.")
    parser.add_argument("folder", type=Path, help="folder in which the recordings are made")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    for machine in SPEED_RAD_S:
        write_bag(arguments.folder / f"{machine}_synthetic", machine, arguments.seed)


if __name__ == "__main__":
    main()
