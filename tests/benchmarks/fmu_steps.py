"""Cost of a step of exported FMUs, against the plain C of `textile-twin bench`, the compiled twin and `drive`.

Run from the root of the repository: python -m tests.benchmarks.fmu_steps [ROUNDS]. It needs a C compiler.

A step sets the inputs, calls fmi2DoStep and gets all outputs, from a loop in C. All candidates of a row take turns in
one process on one core; the figures are the least processor time of the rounds, since other programs share the caches.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np

import textile_twin_core as ttc
from textile_twin_core.arrays import FloatArray
from textile_twin_core.bench.c_limit import c_candidates
from textile_twin_core.bench.scenes import scenes
from textile_twin_core.bench.timing import Candidate, one_core, take_turns
from textile_twin_core.fmu import write_fmu
from textile_twin_core.fmu.archive import Input
from textile_twin_core.machine import AnyMachine, Machine
from textile_twin_core.machine.contact_motion import ContactMotion

SAMPLES = 20_000
STEP_S = 1e-3
LOOM_MASSES = {
    "gear_1_kg": 1.0, "gear_2_kg": 1.2, "crank_kg": 0.5, "coupler_kg": 0.7, "rocker_kg": 1.1, "sley_kg": 3.0,
    "gear_1_kgm2": 2e-3, "gear_2_kgm2": 3e-3, "crank_kgm2": 4e-4, "coupler_kgm2": 2e-3, "rocker_kgm2": 4e-3,
    "sley_kgm2": 0.02,
}  # fmt: skip
"""The paper of the power loom prints none."""
TORQUES = {"tufting": 25.0, "handloom_beatup": 0.3, "elliptic_gear_beatup": 0.3, "six_bar_loom": 3.0}
_LOOP = """#include <stddef.h>
typedef int (*access)(void *, const unsigned *, size_t, double *);
void run(void *unit, access set, int (*step)(void *, double, double, int), access get, const unsigned *in, size_t ins,
         const unsigned *out, size_t outs, size_t n, double h, double *inputs, double *outputs) {
    for (size_t k = 0; k < n; ++k) {
        set(unit, in, ins, inputs + ins * k);
        step(unit, k * h, h, 1);
        get(unit, out, outs, outputs + outs * k);
    }
}
"""


class Unit:
    """An FMU of version 2 in this process, stepped by a loop in C."""

    def __init__(self, machine: AnyMachine, input: Input, outputs: Sequence[str], inputs: FloatArray) -> None:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "unit.fmu"
            write_fmu(path, machine, input=input, outputs=outputs)
            with zipfile.ZipFile(path) as archive:
                archive.extractall(folder)
            description = ET.parse(Path(folder) / "modelDescription.xml").getroot()
            self._library = ctypes.CDLL(str(next(Path(folder).glob("binaries/*/*.so"))))
            (Path(folder) / "loop.c").write_text(_LOOP)
            compiler = shutil.which("cc") or "gcc"
            subprocess.run([compiler, "-O2", "-shared", "-fPIC", "-o", "loop.so", "loop.c"], cwd=folder, check=True)
            self._run = ctypes.CDLL(f"{folder}/loop.so").run
        number = {v.get("name"): int(v.get("valueReference", "")) for v in description.iter("ScalarVariable")}
        shaft = ("theta_rad", "omega_rad_s", "alpha_rad_s2") if input == "angle" else ("drive_torque_Nm",)
        self._number, self._outputs = number, outputs
        self._inputs = np.ascontiguousarray(inputs)
        self._found = np.empty((inputs.shape[0], len(outputs)))
        self._in = np.array([number[name] for name in shaft], dtype=np.uint32)
        self._out = np.array([number[name] for name in outputs], dtype=np.uint32)
        self._library.fmi2Instantiate.restype = ctypes.c_void_p
        token = description.get("guid", "").encode()
        self._unit = ctypes.c_void_p(self._library.fmi2Instantiate(b"unit", 1, token, None, None, 0, 0))

    def start(self, **values: float) -> None:
        """Reset the unit and set start values."""
        library = self._library
        library.fmi2Reset(self._unit)
        library.fmi2EnterInitializationMode(self._unit)
        for name, value in values.items():
            reference, number = ctypes.c_uint32(self._number[name]), ctypes.c_double(value)
            library.fmi2SetReal(self._unit, ctypes.byref(reference), ctypes.c_size_t(1), ctypes.byref(number))
        library.fmi2ExitInitializationMode(self._unit)

    def run(self) -> dict[str, FloatArray]:
        """Step along all inputs; return the outputs."""
        library, size = self._library, ctypes.c_size_t
        arrays = [ctypes.c_void_p(each.ctypes.data) for each in (self._in, self._out, self._inputs, self._found)]
        self._run(
            self._unit, library.fmi2SetReal, library.fmi2DoStep, library.fmi2GetReal,
            arrays[0], size(self._in.size), arrays[1], size(self._out.size), size(self._inputs.shape[0]),
            ctypes.c_double(STEP_S), arrays[2], arrays[3],
        )  # fmt: skip
        return dict(zip(self._outputs, self._found.T, strict=True))


def row(name: str, what: str, unit: Callable[[], Any], others: Sequence[Candidate], samples: int, rounds: int) -> None:
    """Time a unit against its yardsticks and print a line of the table."""
    candidates = [Candidate("FMU", None, batch=unit, samples=samples), *others]
    with one_core():
        take_turns(candidates, rounds)
    own = min(candidates[0].batch_times) / samples
    for other in others:
        theirs = min(other.batch_times) / other.samples
        print(f"| {name} | {what} | {own * 1e6:.3f} | {other.method} | {theirs * 1e6:.3f} | {own / theirs:.2f} |")


def rigid(name: str, machine: Machine, rounds: int) -> None:
    """Rows of a linkage: its outputs against C, its motion under a torque against `drive`."""
    for scene in scenes(machine, SAMPLES):
        unit = Unit(machine, "angle", scene.outputs, np.array(scene.motion).T)
        unit.start()
        assert scene.error(unit.run()) < 1e-9
        plain = [each for each in c_candidates(scene) if each.method == "libm loop"]
        row(name, f"motion; {scene.name}", unit.run, plain, SAMPLES, rounds)
    driven(name, machine, TORQUES[name], ("equivalent_inertia_kgm2",), rounds)


def driven(name: str, machine: Machine, torque: float, outputs: Sequence[str], rounds: int) -> None:
    """Row of a torque on the shaft, over a second, against `drive` with the same times."""
    speed, time = 0.5 * machine.nominal_speed_rad_s, STEP_S * np.arange(1001)
    unit = Unit(machine, "torque", outputs, np.full((1000, 1), torque))

    def run() -> None:
        unit.start(theta_rad=0.4, omega_rad_s=speed)
        unit.run()

    def drive() -> None:
        ttc.drive(machine, torque, 0.4, speed, time, tolerance=1e-12)

    row(name, "torque", run, [Candidate("drive", None, batch=drive, samples=1000)], 1000, min(rounds, 5))


def with_history(
    name: str, machine: AnyMachine, outputs: Sequence[str], yardstick: str, along: Callable[..., Any], rounds: int
) -> None:
    """Row of a machine that integrates, over a second of its nominal speed, against our own compiled loops."""
    speed, time = machine.nominal_speed_rad_s, STEP_S * np.arange(1000)
    shaft = 0.3 + speed * time, np.full(1000, speed), np.zeros(1000)
    unit = Unit(machine, "angle", outputs, np.array(shaft).T)

    def run() -> None:
        unit.start(theta_rad=0.3, omega_rad_s=speed)
        unit.run()

    other = Candidate(yardstick, None, batch=lambda: along(time, *shaft), samples=1000)
    row(name, "motion", run, [other], 1000, min(rounds, 5))


def main(rounds: int) -> None:
    """Print the table as Markdown."""
    print("| machine | input; outputs | FMU, us a step | yardstick | us | ratio |")
    print("|---|---|---|---|---|---|")
    linkages = {name: ttc.machines.create(name) for name in ("tufting", "handloom_beatup")}
    linkages["elliptic_gear_beatup"] = ttc.machines.create("elliptic_gear_beatup", **LOOM_MASSES)
    linkages["six_bar_loom"] = ttc.load_machine("examples/six_bar_loom.yaml")
    for name, machine in linkages.items():
        assert isinstance(machine, Machine)
        rigid(name, machine, rounds)
    transfer = ttc.machines.needle_transfer()
    with_history(
        "needle_transfer", transfer, transfer.outputs, "twin",
        lambda *samples: ContactMotion(transfer, None).step(*samples), rounds,
    )  # fmt: skip
    wide = ttc.load_machine("examples/wide_tufting.yaml")
    assert isinstance(wide, Machine)
    twin = ttc.compile(wide, outputs=["balancing_torque_Nm"])
    with_history(
        "wide_tufting", wide, ("balancing_torque_Nm",), "twin, tolerance 1e-3",
        lambda time, *shaft: twin.evaluate(*shaft, time=time), rounds,
    )  # fmt: skip
    driven("wide_tufting", wide, 60.0, ("balancing_torque_Nm",), rounds)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 15)
