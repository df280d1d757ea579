"""A real drive train with two torque transducers: torque from the motion of its driven end.

Run from the root of the repository: python -m tests.benchmarks.drive_train FOLDER, with Ice_excitation1.csv to
Ice_excitation3.csv and their _motor.csv files, as in data/IceExcitations12102020 of the repository
aksel-ilveskero/Shaftline-Torque-Estimation, or with step_sensor.csv, impulse_sensor.csv and their _motor.csv files, as
in data/masters_data2 of the repository urho-h/torque_estimation_masters. The drive train is that of
src/testbench_model_minimal.py of the latter. Parameters are fitted on the first recording and tested on the others.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import butter, sosfiltfilt

from textile_twin_core.arrays import FloatArray
from textile_twin_core.comparison.shaft_track import shaft_track
from textile_twin_core.driveline import bare_shaft, follow_motion
from textile_twin_core.driveline.observer import ShaftObserver
from textile_twin_core.driveline.observer_step import shaft_readings
from textile_twin_core.machine import Encoder
from textile_twin_core.machine.main_shaft import MainShaft, ShaftPiece, Station
from textile_twin_core.shaft import create_estimator
from textile_twin_core.twin.second_readings import SecondReadings

BAND_HZ = 45.0
"""Torques are compared below this frequency, without their means."""
ENCODER_DISCS = (6, 7, 13, 14, 21)
ENCODER_STEP_RAD = np.deg2rad(0.018)
UPPER, LOWER = (8, 9), (18, 19)
"""Discs beside each torque transducer."""
PROPELLER_GEAR = 8.0
"""The load motor's torque is logged before its gear."""
GEARS = {11: 3.0, 16: 4.0}
INERTIAS = {
    6: 3.29e-6, 7: 5.01e-5, 8: 6.50e-6, 9: 5.65e-5, 10: 4.27e-6, 11: 3.25e-4, 12: 1.20e-4, 13: 1.15e-5, 14: 1.32e-4,
    15: 4.27e-6, 16: 2.69e-4, 17: 1.80e-4, 18: 2.00e-5, 19: 2.00e-4, 20: 4.27e-6, 21: 4.95e-2,
}  # fmt: skip
"""Published, in kg m^2, by disc counted from the motor."""
STIFFNESSES = {
    6: 94.064, 7: 4.19e4, 8: 5.40e3, 9: 4.19e4, 10: 1.22e3, 11: 4.33e4, 12: 3.10e4, 13: 1.14e3, 14: 3.10e4, 15: 1.22e4,
    16: 4.43e4, 17: 1.38e5, 18: 2.00e4, 19: 1.38e5, 20: 1.22e4,
}  # fmt: skip
"""Published, in N m/rad, of the piece behind each disc."""
MOTOR_CLOCK_S = {"step": 0.464, "impulse": 0.174}
"""By how much the load motor's clock is behind that of the sensors."""
START = {
    "soft_stiffness_Nm_rad": 35.0,
    "soft_damping_Nms_rad": 0.02,
    "mesh_stiffness_Nm_rad": 2e3,
    "mesh_damping_Nms_rad": 1.0,
    "propeller_inertia_kgm2": 0.062,
    "load_gain": 1.2,
    "load_delay_s": 2e-3,
}
"""What is fitted, and from where. The soft piece is the one behind disc 6, the mesh that of the first gear."""
EDGE = 300
"""Samples left out at both ends, where the filter has its transients."""


@dataclass(frozen=True)
class Run:
    """One recording: motion of the discs with encoders, torques of the transducers and of the propeller."""

    time_s: FloatArray
    angles_rad: FloatArray
    upper_Nm: FloatArray
    lower_Nm: FloatArray
    motor_time_s: FloatArray
    propeller_Nm: FloatArray

    @classmethod
    def read(cls, folder: Path, number: int) -> Run:
        """A recording of the folder."""
        sensors, motors = (
            np.genfromtxt(folder / f"Ice_excitation{number}{kind}.csv", delimiter=",", skip_header=1)
            for kind in ("", "_motor")
        )
        angles = np.deg2rad(sensors[:, 1:6].T)
        return cls(sensors[:, 0], angles, sensors[:, 6], sensors[:, 7], motors[:, 0], PROPELLER_GEAR * motors[:, 4])

    @classmethod
    def read_speeds(cls, folder: Path, name: str) -> Run:
        """A recording of the folder that holds speeds of discs 6 and 7 instead of angles."""
        sensors, motor = (np.genfromtxt(folder / f"{name}_{kind}.csv", delimiter=",") for kind in ("sensor", "motor"))
        times = sensors[:, 0]
        angles = np.cumsum(sensors[:, 1:3].T * np.diff(times, prepend=times[0]), axis=1)
        even = np.arange(times[0], times[-1], 1e-3)
        columns = [np.interp(even, times, column) for column in (*angles, *sensors[:, 3:5].T)]
        return cls(
            even, np.array(columns[:2]), *columns[2:], motor[:, 0] + MOTOR_CLOCK_S[name], PROPELLER_GEAR * motor[:, 4]
        )

    def motion(self, encoder: int) -> tuple[FloatArray, ...]:
        """Time, angle, speed and acceleration of a disc by the smoother of the shaft's state."""
        stamps = np.rint(self.time_s * 1e9).astype(np.int64)
        step = Encoder(resolution_rad=ENCODER_STEP_RAD)
        track = shaft_track(stamps, self.angles_rad[encoder], None, origin_ns=0, encoder=step)
        return track.time_s, track.theta_rad, track.omega_rad_s, track.alpha_rad_s2


def main_shaft(values: dict[str, float], first: int) -> MainShaft:
    """The drive train from a disc to the propeller."""
    discs = range(first, 22)
    inertias = INERTIAS | {21: values["propeller_inertia_kgm2"]}
    stiffnesses = STIFFNESSES | {6: values["soft_stiffness_Nm_rad"], 11: values["mesh_stiffness_Nm_rad"]}
    dampings = {6: values["soft_damping_Nms_rad"], 11: values["mesh_damping_Nms_rad"]}
    return MainShaft(
        tuple(Station(f"d{k}", inertias[k]) for k in discs),
        tuple(
            ShaftPiece(
                f"d{k}",
                f"d{k + 1}",
                stiffness_Nm_rad=stiffnesses[k],
                damping_Nms_rad=dampings.get(k, 0.0),
                gear_ratio=GEARS.get(k, 1.0),
            )
            for k in discs[:-1]
        ),
    )


def predict(run: Run, motion: tuple[FloatArray, ...], values: dict[str, float], first: int) -> list[FloatArray]:
    """Torques of both transducers from the motion of a disc and the propeller's torque."""
    elastic = bare_shaft(main_shaft(values, first))
    time = motion[0]
    late = np.interp(time, run.motor_time_s + values["load_delay_s"], run.propeller_Nm)
    torque = np.zeros((time.size, elastic.stations))
    torque[:, -1] = -values["load_gain"] * late * elastic.ratios[-1]
    found = follow_motion(elastic, *motion, torque=torque, substeps=1)
    torques = (found.torque_between(f"d{a}", f"d{b}") for a, b in (UPPER, LOWER))
    return [np.interp(run.time_s, time, each) for each in torques]


def in_band(signal: FloatArray) -> FloatArray:
    """A signal below the band's edge, without its mean and its ends."""
    edge = butter(4, BAND_HZ, fs=1000.0, output="sos")
    return np.asarray(sosfiltfilt(edge, signal - signal.mean())[EDGE:-EDGE])


def unexplained(run: Run, predicted: list[FloatArray]) -> list[FloatArray]:
    """Return differences in the band over the standard deviation of the measured torque there."""
    out = []
    for measured, expected in zip((run.upper_Nm, run.lower_Nm), predicted, strict=False):
        out.append(in_band(expected - measured) / in_band(measured).std())
    return out


def fit(run: Run, motion: tuple[FloatArray, ...], first: int) -> dict[str, float]:
    """Parameters that explain both torques best, all positive."""
    names = [name for name in START if first == 6 or not name.startswith("soft")]

    def residuals(logs: FloatArray) -> FloatArray:
        values = START | {name: START[name] * float(np.exp(x)) for name, x in zip(names, logs, strict=True)}
        return np.concatenate(unexplained(run, predict(run, motion, values, first)))

    found = least_squares(residuals, np.zeros(len(names)), bounds=(-3.0, 3.0), diff_step=1e-3)
    return START | {name: START[name] * float(np.exp(x)) for name, x in zip(names, found.x, strict=True)}


def rigid(run: Run, motion: tuple[FloatArray, ...], fitted: FloatArray | None) -> tuple[list[FloatArray], FloatArray]:
    """Torques of a rigid drive train, and its two inertias and two shares of the load: fitted where not given."""
    alpha = np.interp(run.time_s, motion[0], motion[3])
    load = np.interp(run.time_s, run.motor_time_s, run.propeller_Nm)
    columns = np.stack([alpha, load], axis=1)
    if fitted is None:
        banded = np.stack([in_band(column) for column in columns.T], axis=1)
        measured = np.stack([in_band(run.upper_Nm), in_band(run.lower_Nm)], axis=1)
        fitted = np.linalg.lstsq(banded, measured, rcond=None)[0]
    return list((columns @ fitted).T), fitted


def two_encoders(run: Run, values: tuple[float, float]) -> FloatArray:
    """Upper torque by the observer of a shaft of two stations: disc 6, and all behind the soft piece.

    values: stiffness and damping of the soft piece.
    """
    stiffness, damping = values
    behind = float(bare_shaft(main_shaft(START, 7)).chain.inertia.sum())
    shaft = MainShaft(
        (Station("d6", INERTIAS[6]), Station("d7", behind)),
        (ShaftPiece("d6", "d7", stiffness_Nm_rad=stiffness, damping_Nms_rad=damping),),
        second_encoder_at="d7",
    )
    stamps = np.rint(run.time_s * 1e9).astype(np.int64)
    states = create_estimator("causal", resolution_rad=ENCODER_STEP_RAD).step(stamps, run.angles_rad[0])
    second = SecondReadings()
    second.take(stamps, run.angles_rad[1])
    readings = shaft_readings(states.rows, *second.at(states.stamps, states.rows["origin"]))
    observer = ShaftObserver(bare_shaft(shaft), float(np.ptp(run.angles_rad[0]) / np.ptp(run.time_s)))
    observer.take(readings)
    observer.repeat()
    return np.interp(run.time_s, states.stamps * 1e-9, observer.take(readings).motion.pieces[:, 0])


def fit_two(run: Run) -> tuple[float, float]:
    """Stiffness and damping of the soft piece that explain the upper torque best."""

    def residuals(logs: FloatArray) -> FloatArray:
        return unexplained(run, [two_encoders(run, _soft(logs))])[0]

    return _soft(least_squares(residuals, np.zeros(2), bounds=(-3.0, 3.0), diff_step=1e-2).x)


def _soft(logs: FloatArray) -> tuple[float, float]:
    return START["soft_stiffness_Nm_rad"] * float(np.exp(logs[0])), 2e-3 * float(np.exp(logs[1]))


def main(folder: Path) -> None:
    """Print the unexplained share of both torques for each model and recording, as a Markdown table."""
    if (folder / "step_sensor.csv").exists():
        runs = {name: Run.read_speeds(folder, name) for name in MOTOR_CLOCK_S}
    else:
        runs = {f"recording {number}": Run.read(folder, number) for number in (1, 2, 3)}
    table(runs)


def table(recordings: dict[str, Run]) -> None:
    """Print the table of some recordings; the first one is that of the fit."""
    runs = list(recordings.values())
    rows: dict[str, list[list[FloatArray]]] = {}
    for encoder in (0, 1):
        disc = ENCODER_DISCS[encoder]
        motions = [run.motion(encoder) for run in runs]
        _, fitted = rigid(runs[0], motions[0], None)
        rows[f"rigid, disc {disc}"] = [rigid(run, m, fitted)[0] for run, m in zip(runs, motions, strict=True)]
        values = fit(runs[0], motions[0], disc)
        print(f"fitted from disc {disc}:", ", ".join(f"{name} {value:.4g}" for name, value in values.items()))
        rows[f"chain, disc {disc}"] = [predict(run, m, values, disc) for run, m in zip(runs, motions, strict=True)]
    soft = fit_two(runs[0])
    print(f"fitted from discs 6 and 7: stiffness {soft[0]:.4g} N m/rad, damping {soft[1]:.2g} N m s/rad")
    rows["observer, discs 6 and 7"] = [[two_encoders(run, soft)] for run in runs]
    print("\n| model and encoder |", *(f"{name}: T1, T2 |" for name in recordings))
    print("|---|" + "---|" * len(runs))
    for name, predictions in rows.items():
        shares = [unexplained(run, each) for run, each in zip(runs, predictions, strict=True)]
        print(f"| {name} | " + " | ".join(", ".join(f"{each.std():.1%}" for each in pair) for pair in shares) + " |")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
