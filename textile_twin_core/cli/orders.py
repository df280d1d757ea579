"""textile-twin orders: order spectrum and order-speed map of recorded signals."""

from __future__ import annotations

import argparse
import math
from dataclasses import asdict
from pathlib import Path

import numpy as np

from textile_twin_core import views
from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.cli.arguments import Parser, add_machine, add_recording, count, positive
from textile_twin_core.cli.mistakes import UsageError, nearest, tell
from textile_twin_core.cli.named_machine import load_linkage
from textile_twin_core.cli.outputs import check_outputs, save, save_json
from textile_twin_core.cli.progress import stages
from textile_twin_core.cli.readings import tell_unit
from textile_twin_core.cli.sensor_options import add_sensors, topics_of, with_sensors
from textile_twin_core.comparison import compare_torque
from textile_twin_core.comparison.orders import MAX_ORDER, OrderMap, order_map
from textile_twin_core.comparison.result import plain
from textile_twin_core.comparison.shaft_track import ShaftTrack, shaft_track
from textile_twin_core.machine import Encoder, Machine
from textile_twin_core.recordings import Bag, open_bag
from textile_twin_core.recordings.prediction import recompute
from textile_twin_core.recordings.recorded_clock import clock_notes, on_one_clock
from textile_twin_core.recordings.samples import AngleSamples
from textile_twin_core.recordings.schemas import JOINT_STATE

_FORMS = {
    "json": "spectra and maps",
    "png": "maps and spectra as a picture",
    "rrd": "a recording for textile-twin view",
}
_RPM = 30.0 / math.pi


def parser() -> Parser:
    """Build the argument parser."""
    parser = Parser(
        "orders",
        "Order analysis of a recording: each signal is resampled at equal steps of the estimated shaft angle, and its\n"
        "amplitude by order (multiple of the shaft's speed) is shown over time and speed. Signals: 'speed' of the\n"
        "shaft, measured 'torque', with --machine the 'residual' of the torque, and any topic of numbers.",
        "textile-twin orders bags/tufting_160rpm_synthetic --machine tufting --png orders.png",
    )
    add_recording(parser)
    add_machine(parser, option=True, required=False)
    add_sensors(parser)
    parser.add_argument(
        "--signal", metavar="NAME", action="append", default=[],
        help="speed, torque, residual, or a topic (Float64, torque.z of WrenchStamped, effort or else position of"
        " JointState); may be repeated (default: those available of the first three)",
    )  # fmt: skip
    parser.add_argument(
        "--max-order", type=positive, default=MAX_ORDER, metavar="X", help="highest order shown (default %(default)g)"
    )
    parser.add_argument(
        "--turns",
        type=count,
        metavar="N",
        help="turns of the shaft in a window (default 16, fewer in a short recording)",
    )
    for form, what in _FORMS.items():
        parser.add_argument(f"--{form}", type=Path, metavar="FILE", help=f"write {what}; overwritten if it exists")
    return parser


def run(arguments: argparse.Namespace) -> None:
    """Analyse, print the table and write the outputs."""
    machine = None
    if arguments.machine is not None:
        machine = with_sensors(load_linkage(arguments.machine, arguments.set), arguments)
    check_outputs(arguments)
    maps = _maps(arguments, machine)
    _print(maps)
    title = arguments.bag.resolve().name
    save(arguments.png, lambda path: views.plot_orders(path, maps, title=title))
    save(arguments.rrd, lambda path: views.write_orders_recording(path, maps, title=title))
    save_json(arguments.json, {"bag": str(arguments.bag), "signals": {k: _numbers(v) for k, v in maps.items()}})


def _maps(arguments: argparse.Namespace, machine: Machine | None) -> dict[str, OrderMap]:
    """Compute the order map of each signal, by its name with unit."""
    bag = open_bag(arguments.bag)
    tell(*bag.notices)
    topics = topics_of(arguments)
    encoder = Encoder() if machine is None else machine.sensors.encoder
    angles = topics.read_angles(bag, encoder)
    tell(*clock_notes(angles))
    tell_unit(angles)
    has_torque = bag.has_topic(topics.torque_in(bag))
    has_residual = has_torque and machine is not None and machine.has_complete_torque
    signals = arguments.signal or ["speed", *["torque"] * has_torque, *["residual"] * has_residual]
    if "residual" in signals and not has_residual:
        raise UsageError("--signal residual needs --machine, with masses, and a measured torque in the recording")
    with stages(len(angles)) as stage:
        stage("estimating the shaft's motion", 0.8, 1)
        track = shaft_track(
            angles.stamps, angles.angles_rad, angles.velocities, origin_ns=int(angles.stamps[0]), encoder=encoder
        )
        stage("resampling", 1.0, 1)
        found = {}
        for signal in signals:
            name, time, theta, values = _signal(signal, bag, arguments, machine, angles, track)
            found[name] = order_map(time, theta, values, max_order=arguments.max_order, turns=arguments.turns)
    return found


def _signal(
    signal: str,
    bag: Bag,
    arguments: argparse.Namespace,
    machine: Machine | None,
    angles: AngleSamples,
    track: ShaftTrack,
) -> tuple[str, FloatArray, FloatArray, FloatArray]:
    """Return name with unit, times, shaft angles and values of a signal."""
    origin = int(angles.stamps[0])
    if signal == "speed":
        return "speed [rad/s]", track.time_s, track.theta_rad, track.omega_rad_s
    if signal in ("torque", "residual"):
        measured, notes = on_one_clock(angles, topics_of(arguments).read_torques(bag))
        tell(*notes)
        if signal == "torque":
            return "torque [N m]", *_at(measured.stamps, measured.torque_Nm, track, origin)
        assert machine is not None
        predicted = recompute(angles, machine)
        compared = compare_torque(
            measured.stamps, measured.torque_Nm, predicted.stamps_ns, predicted.torque_Nm, predicted.theta_rad,
            torque_sensor=machine.sensors.torque, events=machine.events(), settled=predicted.settled,
        )  # fmt: skip
        return "residual [N m]", *_at(compared.stamps_ns, compared.residual_Nm, track, origin)
    if not bag.has_topic(signal):
        known = nearest(signal, ["speed", "torque", "residual", *bag.topics])
        raise UsageError(f"--signal {signal}: no such signal or topic; {known}")
    stamps, values = _topic(bag, signal, arguments.joint)
    return signal, *_at(stamps, values, track, origin)


def _topic(bag: Bag, topic: str, joint: str) -> tuple[IntArray, FloatArray]:
    """Return stamps and values of a topic of numbers."""
    info = bag.find_topic(topic)
    if info.msgtype == JOINT_STATE:
        stamps, positions = bag.read_joint_states(topic)
        if joint not in positions and len(positions) > 1:
            raise UsageError(f"--signal {topic}: name one of its joints with --joint: {', '.join(positions)}")
        name = joint if joint in positions else next(iter(positions))
        if np.isfinite(positions[name]).any():
            return stamps, positions[name]
        joint = name
    samples = bag.read_torques(topic, joint)
    return samples.stamps, samples.torque_Nm


def _at(
    stamps: IntArray, values: FloatArray, track: ShaftTrack, origin: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return times, shaft angles and values in order of time, without those that have no shaft angle."""
    order = np.argsort(stamps, kind="stable")
    time = np.asarray((stamps[order] - origin) * 1e-9, dtype=np.float64)
    theta, _, _, good = track.at(time)
    good[1:] &= np.diff(stamps[order]) > 0
    if not good.any():
        raise UsageError("no sample of the signal lies within the recorded motion of the shaft; check their clocks")
    return time[good], theta[good], values[order][good]


def _print(maps: dict[str, OrderMap]) -> None:
    for name, found in maps.items():
        slow, fast = float(found.speed_rad_s.min()) * _RPM, float(found.speed_rad_s.max()) * _RPM
        print(
            f"{name}: {found.time_s.size} windows of {found.turns} turns, {slow:.1f} to {fast:.1f} rpm,"
            f" order resolution {found.resolution:.3f}, mean {found.spectrum[0]:.6g}"
        )
        print(f"  {'order':>8}  {'amplitude':>11}  {'largest':>11}  at rpm")
        for peak in found.peaks():
            print(f"  {peak.order:8.3f}  {peak.amplitude:11.5g}  {peak.largest:11.5g}  {peak.speed_rad_s * _RPM:6.1f}")


def _numbers(found: OrderMap) -> dict[str, object]:
    return {
        "turns": found.turns,
        "order_resolution": found.resolution,
        "peaks": [asdict(peak) for peak in found.peaks()],
        "order": plain(found.order),
        "spectrum": plain(found.spectrum),
        "time_s": plain(found.time_s),
        "speed_rad_s": plain(found.speed_rad_s),
        "amplitude": plain(found.amplitude),
    }
