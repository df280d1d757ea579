"""A real engine's recordings: tooth times and gas torque, from a fetched copy of kasparsvv/Sustainable-fuels.

One cylinder, four strokes, about 3000 rpm, half a second a run, an inductive pickup on 57 teeth (60 less 3) and the
cylinder's pressure, both sampled at 100 kHz. The repository has no licence: it is fetched beside the project, never
committed, and read here by `git show` from the path of its git directory.

Run from the root of the repository: python -m tests.benchmarks.engine_records GIT_DIRECTORY CACHE_FOLDER
"""

from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from scipy.signal import butter, sosfiltfilt

TEETH = 57
PITCH_RAD = np.deg2rad(6.0)
GAP_RAD = np.deg2rad(24.0)
CRANK_M, ROD_M, BORE_M = 0.0275, 0.0842, 0.0677

_RATE_HZ = 100e3
_TDC_RAD = np.deg2rad(235.0)  # top dead centre of the piston after the first tooth past the gap
_BAR_PER_V = 1.0 / (5.0 * 0.0154)
_PRESSURE_LAG_S = 45e-6
_ATMOSPHERE_PA = 1.013e5
_PICKUP_HZ = 8e3


@dataclass(frozen=True)
class EngineRun:
    """One run of the engine.

    Attributes:
        path: of the text file in the repository.
        load: full, half or no.
        time_s: (n,) times at which teeth passed.
        angle_rad: (n,) nominal angle of these teeth, unwrapped; 0 at a first tooth past the gap.
        tooth: (n,) number of the tooth, 0 (the first past the gap) to 56.
        gas_time_s: (m,) time grid of the pressure, 10 us apart.
        gas_torque_Nm: (m,) torque of the gas on the crank.
        pressure_Pa: (m,) absolute pressure in the cylinder.
        tdc_rad: an angle at which the piston stands at its top dead centre.
    """

    path: str
    load: str
    time_s: np.ndarray
    angle_rad: np.ndarray
    tooth: np.ndarray
    gas_time_s: np.ndarray
    gas_torque_Nm: np.ndarray
    pressure_Pa: np.ndarray
    tdc_rad: float

    def save(self, file: Path) -> None:
        """Save as .npz."""
        np.savez(file, **{field.name: getattr(self, field.name) for field in fields(self)})

    @classmethod
    def load_file(cls, file: Path) -> EngineRun:
        """Back from `save`."""
        with np.load(file) as data:
            values = {name: data[name] for name in data.files}
        return cls(**{name: value.item() if value.ndim == 0 else value for name, value in values.items()})


def paths(repository: Path) -> list[str]:
    """The usable text files: of the groups, with the engine running."""
    listing = subprocess.run(
        ["git", "-C", str(repository), "ls-tree", "-r", "--name-only", "-z", "HEAD"],
        check=True,
        capture_output=True,
        text=True,
    )
    names = [name for name in listing.stdout.split("\0") if re.fullmatch(r"Group.*\.txt", name)]
    return sorted(name for name in names if "engineoff" not in name.lower())


def read_run(repository: Path, path: str) -> EngineRun:
    """Parse one file."""
    raw = subprocess.run(["git", "-C", str(repository), "show", f"HEAD:{path}"], check=True, capture_output=True).stdout
    table = np.array(raw.replace(b",", b".").split(), dtype=np.float64).reshape(-1, 3)
    # The pickup swings through zero; the pressure channel does not.
    pickup, volts = (table[:, 1], table[:, 2]) if table[:, 1].min() < -0.5 else (table[:, 2], table[:, 1])
    clock = table[0, 0] + np.arange(len(table)) / _RATE_HZ
    time = _tooth_times(clock, pickup)
    turn_place, tooth = _number(time)
    # The nominal angle at every time, for the gas torque; a degree more or less changes nothing there.
    theta = np.interp(clock, time, turn_place)
    inside = (clock >= time[0]) & (clock <= time[-1])
    pressure = np.interp(clock + _PRESSURE_LAG_S, clock, volts) * _BAR_PER_V * 1e5
    crank = theta - _TDC_RAD
    pressure = _pegged(pressure, crank, inside)
    load = next(kind for kind in ("full", "half", "no") if f"{kind}load" in path.lower().replace(" ", ""))
    return EngineRun(
        path,
        load,
        time,
        turn_place,
        tooth,
        clock[inside],
        gas_torque(crank[inside], pressure[inside]),
        pressure[inside],
        float(_TDC_RAD),
    )


def gas_torque(crank_rad: np.ndarray, pressure_Pa: np.ndarray) -> np.ndarray:
    """Torque of the gas on the crank [N m]; angle 0 at top dead centre, pressure absolute."""
    force = (pressure_Pa - _ATMOSPHERE_PA) * np.pi / 4.0 * BORE_M**2
    sine, cosine = np.sin(crank_rad), np.cos(crank_rad)
    return np.asarray(force * CRANK_M * sine * (1.0 + CRANK_M * cosine / np.sqrt(ROD_M**2 - (CRANK_M * sine) ** 2)))


def _tooth_times(clock: np.ndarray, pickup: np.ndarray) -> np.ndarray:
    """Rising crossings of the middle of the pickup's voltage, interpolated, without those that no tooth made."""
    low, high = np.percentile(pickup, [5.0, 95.0])
    wave = sosfiltfilt(butter(2, _PICKUP_HZ, fs=_RATE_HZ, output="sos"), pickup) - 0.5 * (low + high)
    i = np.flatnonzero((wave[:-1] < 0.0) & (wave[1:] >= 0.0))
    time = clock[i] - wave[i] / (wave[i + 1] - wave[i]) / _RATE_HZ
    least = 0.4 * np.median(np.diff(time))
    kept = [time[0]]
    for one in time[1:]:
        if one - kept[-1] >= least:
            kept.append(one)
    return np.array(kept)


def _number(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nominal angle and number of each tooth, from the gaps."""
    step = np.diff(time)
    gaps = np.flatnonzero(step > 2.5 * np.median(step)) + 1  # the first tooth past each gap
    if not (np.diff(gaps) == TEETH).all():
        raise ValueError(f"teeth between gaps: {np.diff(gaps).tolist()} instead of {TEETH}")
    place = np.arange(time.size) - gaps[0]
    turn, tooth = np.divmod(place, TEETH)
    return turn * 2.0 * np.pi + tooth * PITCH_RAD, tooth


def _pegged(pressure: np.ndarray, crank_rad: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """The pressure shifted so that it is the atmosphere's in the middle of the exhaust stroke."""
    peak = crank_rad[inside][np.argmax(pressure[inside])]
    firing = 2.0 * np.pi * np.round(peak / (2.0 * np.pi))
    cycle = np.mod(crank_rad - firing, 4.0 * np.pi)
    exhaust = inside & (cycle > np.deg2rad(225.0)) & (cycle < np.deg2rad(315.0))
    return np.asarray(pressure - np.median(pressure[exhaust]) + _ATMOSPHERE_PA)


def main() -> None:
    """Parse all runs into the cache folder."""
    repository, folder = Path(sys.argv[1]), Path(sys.argv[2])
    folder.mkdir(parents=True, exist_ok=True)
    for number, path in enumerate(paths(repository)):
        run = read_run(repository, path)
        run.save(folder / f"run_{number:02d}.npz")
        print(number, run.load, run.time_s.size, run.path)


if __name__ == "__main__":
    main()
