"""Exported FMUs in FMPy: valid, compiled from their sources, and equal to the twin and to `drive`."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

import textile_twin_core as ttc
from tests.benchmarks.fmu_steps import LOOM_MASSES, TORQUES
from tests.campaign import more
from textile_twin_core.cli.main import main
from textile_twin_core.dynamics import Body
from textile_twin_core.dynamics.loads import ForceCurve
from textile_twin_core.expression import interpret
from textile_twin_core.expression.loop import Numpy
from textile_twin_core.fmu import FmuReport, write_fmu
from textile_twin_core.machine import Machine, MainShaft, ShaftPlace
from textile_twin_core.machine.main_shaft import ShaftDrive, ShaftPiece, Station
from textile_twin_core.mechanism import Crank, RRRDyad

fmpy = pytest.importorskip("fmpy")
from fmpy.build import build_platform_binary  # noqa: E402
from fmpy.validation import validate_fmu  # noqa: E402

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")

Fmi = Literal[2, 3]
Input = Literal["angle", "torque"]
KINDS = ("CoSimulation", "ModelExchange")
UNITS = [("tufting", 2), ("six_bar_loom", 3)]
OTHERS = more(*sorted({(name, fmi) for name in TORQUES for fmi in (2, 3)} - {*UNITS}))


@cache
def machine_named(name: str) -> Machine:
    if name == "six_bar_loom":
        return ttc.load_machine("examples/six_bar_loom.yaml")
    factory: Any = getattr(ttc.machines, name)
    return factory(**(LOOM_MASSES if name == "elliptic_gear_beatup" else {}))


@pytest.fixture(scope="module")
def units(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Units by machine, input and version, each written once."""
    folder = tmp_path_factory.mktemp("fmu")

    @cache
    def unit(name: str, input: Input, fmi: Fmi) -> tuple[Path, FmuReport]:
        path = folder / f"{name}_{input}_{fmi}.fmu"
        return path, write_fmu(path, machine_named(name), input=input, fmi=fmi)

    return unit


@contextmanager
def opened(path: Path, kind: str) -> Iterator[tuple[Any, dict[str, int]]]:
    """An instance of a unit, and its value references by name."""
    description = fmpy.read_model_description(path)
    folder = fmpy.extract(path)
    instance = fmpy.instantiate_fmu(folder, description, kind)
    try:
        yield instance, {v.name: v.valueReference for v in description.modelVariables}
    finally:
        instance.freeInstance()
        shutil.rmtree(folder, ignore_errors=True)


def initialise(instance: Any, start_s: float = 0.0, set_values: Callable[[], object] = lambda: None) -> None:
    if hasattr(instance, "setupExperiment"):
        instance.setupExperiment(startTime=start_s)
        instance.enterInitializationMode()
    else:
        instance.enterInitializationMode(startTime=start_s)
    set_values()
    instance.exitInitializationMode()


def put(instance: Any, references: list[int], values: Any) -> None:
    (instance.setReal if hasattr(instance, "setReal") else instance.setFloat64)(references, list(values))


def got(instance: Any, references: list[int]) -> list[float]:
    return list((instance.getReal if hasattr(instance, "getReal") else instance.getFloat64)(references))


@pytest.mark.parametrize(("name", "fmi"), [*UNITS, *OTHERS])
def test_a_unit_driven_by_the_shafts_motion_is_the_twin(name: str, fmi: Fmi, units: Any) -> None:
    """Outputs at 200 states, to 1e-9 of their peak, with the parameters as given and with others."""
    machine = machine_named(name)
    path, made = units(name, "angle", fmi)
    assert made.has_binary and not made.fixed and len(made.parameters) >= 18
    assert not validate_fmu(str(path))
    rng = np.random.default_rng(7)
    theta, omega, alpha = rng.uniform(-20.0, 20.0, 200), rng.uniform(-30.0, 30.0, 200), rng.normal(0.0, 100.0, 200)
    changed = made.parameters[0], made.parameters[-1]
    numbers = machine.parameters
    if name == "six_bar_loom":
        changed = "bodies.l3.mass_kg", "groups.l1.length_m"
        numbers = {"bodies.l3.mass_kg": 0.61, "groups.l1.length_m": 0.055}
    with opened(path, "CoSimulation") as (instance, reference):
        initialise(instance)
        outputs = [reference[each] for each in made.outputs]
        inputs = [reference[each] for each in ("theta_rad", "omega_rad_s", "alpha_rad_s2")]
        for factor in (1.0, 1.02):
            values = {each: numbers[each] * factor for each in changed}
            put(instance, [reference[each] for each in changed], values.values())
            found = []
            for k, state in enumerate(zip(theta, omega, alpha, strict=True)):
                put(instance, inputs, state)
                instance.doStep(k * 1e-3, 1e-3)
                found.append(got(instance, outputs))
            twin = ttc.compile(with_numbers(name, values), outputs=list(made.outputs), method="exact")
            true = twin.evaluate(theta, omega, alpha)
            for column, output in zip(np.transpose(found), made.outputs, strict=True):
                assert np.abs(column - true[output]).max() <= 1e-9 * max(np.abs(true[output]).max(), 1e-9), output


@pytest.mark.parametrize("name", ["elliptic_gear_beatup", "six_bar_loom"])
def test_every_output_compiles_and_follows(name: str, tmp_path: Path) -> None:
    """Reactions as well, whose steps depend on the acceleration (the loaded flank of a gear)."""
    machine, path = machine_named(name), tmp_path / "all.fmu"
    made = write_fmu(path, machine, outputs=machine.outputs)
    assert made.has_binary and made.outputs == machine.outputs
    rng = np.random.default_rng(11)
    states = {
        "theta": rng.uniform(0.0, 6.0, 40),
        "omega": rng.uniform(-30.0, 30.0, 40),
        "alpha": rng.normal(0, 99.0, 40),
    }
    true = interpret([machine.model.output(each) for each in made.outputs], states, Numpy)
    with opened(path, "CoSimulation") as (instance, reference):
        initialise(instance)
        outputs = [reference[each] for each in made.outputs]
        inputs = [reference[each] for each in ("theta_rad", "omega_rad_s", "alpha_rad_s2")]
        for k, state in enumerate(zip(*states.values(), strict=True)):
            put(instance, inputs, state)
            instance.doStep(k * 1e-3, 1e-3)
            for value, row, output in zip(got(instance, outputs), true, made.outputs, strict=True):
                exact = np.asarray(row) + np.zeros(40)
                assert abs(value - exact[k]) <= 1e-9 * max(np.abs(exact).max(), 1e-9), output


def with_numbers(name: str, values: dict[str, float]) -> Machine:
    if name != "six_bar_loom":
        made = ttc.machines.create(name, **{**machine_named(name).parameters, **values})
        assert isinstance(made, Machine)
        return made
    text = Path("examples/six_bar_loom.yaml").read_text()
    text = text.replace("mass_kg: 0.61", f"mass_kg: {values['bodies.l3.mass_kg']!r}")
    text = text.replace("length_m: 0.055", f"length_m: {values['groups.l1.length_m']!r}")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "changed.yaml"
        path.write_text(text)
        return ttc.load_machine(path)


@pytest.mark.parametrize(("name", "fmi"), [*UNITS, *OTHERS])
def test_a_unit_driven_by_a_torque_moves_as_drive_does(name: str, fmi: Fmi, units: Any) -> None:
    """Angle and speed over 0.25 s: co-simulation to 1e-9, model exchange by CVode to 1e-6, as its tolerance allows."""
    machine = machine_named(name)
    path, _ = units(name, "torque", fmi)
    assert not validate_fmu(str(path))
    time = np.linspace(0.0, 0.25, 51)
    speed = 0.5 * machine.nominal_speed_rad_s
    true = ttc.drive(machine, TORQUES[name], 0.4, speed, time, tolerance=1e-12)
    start = {"theta_rad": 0.4, "omega_rad_s": speed, "drive_torque_Nm": TORQUES[name]}
    for kind, worst in zip(KINDS, (1e-9, 1e-6), strict=True):
        found = fmpy.simulate_fmu(
            str(path), stop_time=0.25, step_size=0.005, output_interval=0.005, start_values=start, fmi_type=kind,
            relative_tolerance=1e-10,
        )  # fmt: skip
        rows = np.clip(np.rint(found["time"] / 0.005).astype(int), 0, 50)
        same = np.abs(found["time"] - time[rows]) < 1e-12
        assert np.count_nonzero(same) >= 51
        scale = np.abs(true.omega_rad_s).max()
        assert np.abs(found["theta_rad"][same] - true.theta_rad[rows[same]]).max() < worst, kind
        assert np.abs(found["omega_rad_s"][same] - true.omega_rad_s[rows[same]]).max() < worst * max(scale, 1.0), kind


def test_the_needle_in_the_backing_and_dry_friction_are_met_exactly(units: Any) -> None:
    """The tufting shaft passes the planes under load, coasts to standstill, sticks, breaks loose and turns back."""
    path, _ = units("tufting", "torque", 2)
    machine = machine_named("tufting")
    steps = [(0.1, 15.0), (0.1, -15.0), (0.06, -30.0), (0.05, 35.0), (0.1, 35.0)]
    theta, omega, begin = 0.4, 14.0, 0.0
    kinds: set[str] = set()
    with opened(path, "CoSimulation") as (instance, reference):
        put(instance, [reference["theta_rad"], reference["omega_rad_s"]], [theta, omega])
        initialise(instance)
        shaft = [reference["theta_rad"], reference["omega_rad_s"]]
        for seconds, torque in steps:
            put(instance, [reference["drive_torque_Nm"]], [torque])
            instance.doStep(begin, seconds)
            run = ttc.drive(machine, torque, theta, omega, [begin, begin + seconds], tolerance=1e-12)
            kinds |= {event.kind for event in run.events}
            theta, omega, begin = float(run.theta_rad[-1]), float(run.omega_rad_s[-1]), begin + seconds
            assert got(instance, shaft) == pytest.approx([theta, omega], abs=1e-6, rel=1e-9)
    assert {"leaps", "stops", "reverses"} <= kinds


def test_the_torque_of_a_driven_shaft_is_the_drive_s_at_every_row_of_model_exchange(units: Any) -> None:
    """Events included, where a row stands on either side of a step of the load."""
    path, _ = units("tufting", "torque", 2)
    start = {"drive_torque_Nm": 25.0, "theta_rad": 0.2, "omega_rad_s": 14.0}
    found = fmpy.simulate_fmu(
        str(path),
        fmi_type="ModelExchange",
        stop_time=0.3,
        output_interval=2e-3,
        start_values=start,
        relative_tolerance=1e-10,
    )
    steps = np.count_nonzero(np.abs(np.diff(found["torque_load_Nm"])) > 5.0)
    assert len(found) > 160 and steps > 10
    np.testing.assert_allclose(found["balancing_torque_Nm"], 25.0, rtol=0.0, atol=1e-9)


@pytest.mark.slow
def test_a_force_over_the_depth_is_that_of_the_twin_and_of_drive(tmp_path: Path) -> None:
    """A pierce, a step inside and another force on the way out, with the angle as input and with the torque."""
    knots, down = (0.55784, 0.5585, 0.5601, 0.5633, 0.5633, 0.576), (250.0, 1200.0, 640.0, 580.0, 820.0, 900.0)
    curve = ForceCurve("backing", "needle_position_m", knots, down, (0.0, 120.0, 300.0, 310.0, 280.0, 350.0))
    machine = replace(machine_named("tufting"), loads=(curve,))
    path = tmp_path / "angle.fmu"
    write_fmu(path, machine, input="angle", fmi=2, outputs=["balancing_torque_Nm", "reaction_O_x_N"])
    twin = ttc.compile(machine, ["balancing_torque_Nm", "reaction_O_x_N"], method="exact")
    with opened(path, "CoSimulation") as (instance, reference):
        initialise(instance)
        for theta in (0.37, 0.5, 1.2, 2.9, 5.0):
            put(instance, [reference[n] for n in ("theta_rad", "omega_rad_s", "alpha_rad_s2")], [theta, 16.0, 3.0])
            true = twin.evaluate(theta, 16.0, 3.0)
            assert got(instance, [reference[name] for name in true]) == pytest.approx(list(true.values()), rel=1e-10)
    path, time = tmp_path / "torque.fmu", np.linspace(0.0, 0.4, 81)
    write_fmu(path, machine, input="torque", fmi=2)
    run = ttc.drive(machine, 12.0, 0.2, 14.0, time, tolerance=1e-12)
    start = {"theta_rad": 0.2, "omega_rad_s": 14.0, "drive_torque_Nm": 12.0}
    found = fmpy.simulate_fmu(str(path), stop_time=0.4, step_size=0.005, output_interval=0.005, start_values=start)
    assert np.abs(found["theta_rad"] - run.theta_rad).max() < 1e-9
    assert np.abs(found["omega_rad_s"] - run.omega_rad_s).max() < 2e-8


@pytest.mark.parametrize(
    ("name", "input", "fmi", "outputs"),
    [
        ("tufting", "torque", 2, ["omega_rad_s", "balancing_torque_Nm"]),
        ("tufting", "angle", 2, ["balancing_torque_Nm"]),
        ("wide", "torque", 2, ["balancing_torque_Nm"]),
        ("wide", "angle", 3, ["balancing_torque_Nm"]),
        ("needle_transfer", "angle", 2, ["element_3_position_m", "element_3_velocity_m_s"]),
        *more(("tufting", "torque", 3, ["omega_rad_s", "balancing_torque_Nm"])),
    ],
)
def test_a_start_in_unix_time_gives_the_motion_of_a_start_at_zero(
    name: str, input: Input, fmi: Fmi, outputs: list[str], tmp_path: Path
) -> None:
    machine = wide_machine() if name == "wide" else machine_named(name)
    path, size = tmp_path / "unit.fmu", 1e-4
    write_fmu(path, machine, input=input, fmi=fmi, outputs=[each for each in outputs if each != "omega_rad_s"])
    given = {"theta_rad": 0.3, "omega_rad_s": 16.0}
    found = {}
    for start_s in (0.0, 1e5, 1.7e9):
        with opened(path, "CoSimulation") as (instance, reference):
            initialise(instance, start_s, lambda: put(instance, [reference[n] for n in given], given.values()))
            if input == "torque":
                put(instance, [reference["drive_torque_Nm"]], [20.0])
            found[start_s] = []
            for k in range(1500):
                if input == "angle":
                    put(instance, [reference[n] for n in given], [0.3 + 16.0 * k * size, 16.0])
                instance.doStep(start_s + k * size, size)
                found[start_s].append(got(instance, [reference[each] for each in outputs]))
    scale = np.abs(found[0.0]).max(axis=0)
    for start_s in (1e5, 1.7e9):
        assert np.all(np.abs(np.subtract(found[start_s], found[0.0])).max(axis=0) < 1e-9 * scale), start_s


def wide_machine() -> Machine:
    """Two needle linkages on an elastic shaft behind a motor."""
    shaft = MainShaft(
        (Station("motor", 0.4, 0.2), Station("b", 0.02), Station("c", 0.03, 0.1)),
        (
            ShaftPiece("motor", "b", stiffness_Nm_rad=9.0e4, damping_Nms_rad=8.0),
            ShaftPiece("b", "c", diameter_m=0.05, length_m=0.8, damping_Nms_rad=10.0, backlash_rad=2e-3),
        ),
        torque_sensor=("motor", "b"),
        drive=ShaftDrive("motor", 0.3, 5.0),
    )
    return replace(machine_named("tufting"), shaft=shaft, linkages=(ShaftPlace(0.0, "b"), ShaftPlace(0.7, "c")))


_PROGRAM = """
#include <stdio.h>
#include <stdlib.h>
#define UNIT(prefix) \\
    extern void *prefix##fmi2Instantiate(const char *, int, const char *, const char *, const void *, int, int); \\
    extern int prefix##fmi2SetupExperiment(void *, int, double, double, int, double); \\
    extern int prefix##fmi2ExitInitializationMode(void *); \\
    extern int prefix##fmi2SetReal(void *, const unsigned *, size_t, const double *); \\
    extern int prefix##fmi2GetReal(void *, const unsigned *, size_t, double *); \\
    extern int prefix##fmi2DoStep(void *, double, double, int);
UNIT(tufting_)
UNIT(loom_)
#define RUN(prefix, token) do { \\
    const unsigned in[] = {1, 2, 3}, out[] = {2, 3}; \\
    const double start[] = {4.0, 0.3, 16.0}; \\
    double end[2]; \\
    int k; \\
    void *unit = prefix##fmi2Instantiate("unit", 1, token, "", NULL, 0, 0); \\
    if (!unit) return 1; \\
    prefix##fmi2SetupExperiment(unit, 0, 0.0, 0.0, 0, 0.0); \\
    prefix##fmi2SetReal(unit, in, 3, start); \\
    prefix##fmi2ExitInitializationMode(unit); \\
    for (k = 0; k < 300; ++k) if (prefix##fmi2DoStep(unit, k * 1e-3, 1e-3, 1)) return 2; \\
    prefix##fmi2GetReal(unit, out, 2, end); \\
    printf("%.17g %.17g\\n", end[0], end[1]); \\
} while (0)
int main(int count, char **words) { (void)count; RUN(tufting_, words[1]); RUN(loom_, words[2]); return 0; }
"""


@pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")
def test_two_units_are_linked_and_run_in_one_program(tmp_path: Path) -> None:
    """Compile each with a prefix of its own; the motion is that of `drive`."""
    machines = {"tufting_": machine_named("tufting"), "loom_": machine_named("handloom_beatup")}
    tokens = []
    for prefix, machine in machines.items():
        write_fmu(tmp_path / f"{prefix}.fmu", machine, input="torque", fmi=2)
        folder = fmpy.extract(tmp_path / f"{prefix}.fmu", tmp_path / prefix)
        tokens.append(fmpy.read_model_description(folder).guid)
        command = ["cc", "-std=c99", "-O1", f"-DFMI2_FUNCTION_PREFIX={prefix}", "-c", "-o", tmp_path / f"{prefix}.o"]
        subprocess.run([*command, f"{folder}/sources/all.c"], check=True)
    (tmp_path / "main.c").write_text(_PROGRAM)
    objects = [tmp_path / f"{prefix}.o" for prefix in machines]
    subprocess.run(["cc", "-o", tmp_path / "both", tmp_path / "main.c", *objects, "-lm"], check=True)
    done = subprocess.run([tmp_path / "both", *tokens], capture_output=True, text=True, check=True)
    for line, machine in zip(done.stdout.splitlines(), machines.values(), strict=True):
        run = ttc.drive(machine, 4.0, 0.3, 16.0, np.linspace(0.0, 0.3, 61), tolerance=1e-12)
        theta, omega = map(float, line.split())
        assert abs(theta - run.theta_rad[-1]) < 1e-8 and abs(omega - run.omega_rad_s[-1]) < 2e-7


@pytest.mark.parametrize("fmi", [3, *more(2)])
def test_the_state_is_saved_restored_and_serialised(fmi: Fmi, units: Any) -> None:
    path, _ = units("handloom_beatup", "torque", fmi)
    with opened(path, "CoSimulation") as (instance, reference):
        put(instance, [reference["drive_torque_Nm"], reference["omega_rad_s"]], [0.5, 8.0])
        initialise(instance)
        shaft = [reference["theta_rad"], reference["omega_rad_s"], reference["balancing_torque_Nm"]]
        instance.doStep(0.0, 0.1)
        saved = (instance.getFMUstate if fmi == 2 else instance.getFMUState)()
        bytes_saved = (instance.serializeFMUstate if fmi == 2 else instance.serializeFMUState)(saved)
        instance.doStep(0.1, 0.1)
        first = got(instance, shaft)
        (instance.setFMUstate if fmi == 2 else instance.setFMUState)(saved)
        instance.doStep(0.1, 0.1)
        assert got(instance, shaft) == first
        again = (instance.deSerializeFMUstate if fmi == 2 else instance.deserializeFMUState)(bytes_saved)
        (instance.setFMUstate if fmi == 2 else instance.setFMUState)(again)
        instance.doStep(0.1, 0.1)
        assert got(instance, shaft) == first


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "output", "fmi"),
    [("tufting", "balancing_torque_Nm", 2), *more(("needle_transfer", "element_3_position_m", 3))],
)
def test_fmpy_compiles_the_sources_and_the_library_names_no_python(
    name: str, output: str, fmi: Fmi, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}:/usr/bin:/bin")
    machine, path = ttc.machines.create(name), tmp_path / "unit.fmu"
    write_fmu(path, machine, fmi=fmi)
    folder = tmp_path / "unit"
    fmpy.extract(path, folder)
    shutil.rmtree(folder / "binaries")
    build_platform_binary(folder)
    library = next(folder.glob("binaries/*/*.so"))
    needed = subprocess.run(["readelf", "-d", library], capture_output=True, text=True, check=True).stdout
    assert "libc.so" in needed and "python" not in needed.lower()
    start = {"theta_rad": 1.0, "omega_rad_s": 16.0, "alpha_rad_s2": 0.0}
    found = fmpy.simulate_fmu(str(folder), stop_time=0.01, step_size=0.01, start_values=start)
    turned = 0.16 if name == "needle_transfer" else 0.0  # which follows the inputs through the step
    twin = ttc.compile(machine, outputs=[output])
    true = twin.evaluate(np.array([1.0, 1.0 + turned]), 16.0, np.zeros(2), time=np.array([0.0, 0.01]))[output][-1]
    assert found[output][-1] == pytest.approx(true, rel=1e-9)


def test_what_a_unit_cannot_hold_is_refused_in_words(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = str(tmp_path / "x.fmu")
    assert main(["fmu", "needle_transfer", "--input", "torque", "--out", out]) == 2
    assert "--input angle" in capsys.readouterr().err
    assert main(["fmu", "elliptic_gear_beatup", "--input", "torque", "--out", out]) == 2
    assert "lacks masses" in capsys.readouterr().err
    assert main(["fmu", "tufting", "--outputs", "needle", "--out", out]) == 2
    assert main(["fmu", "tufting", "--out", str(tmp_path / "x.zip")]) == 2
    assert not list(tmp_path.iterdir())


def test_the_command_writes_a_unit_and_says_what_is_in_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "sley.fmu"
    assert main(["fmu", "elliptic_gear_beatup", "--fmi", "3", "--out", str(out)]) == 0
    assert "sley_position_m" in capsys.readouterr().out
    assert not validate_fmu(str(out))


def test_numbers_that_choose_another_closed_form_stay_constants(tmp_path: Path) -> None:
    """A parallelogram with other lengths loses its form and its passage through the change points."""
    machine = Machine(
        name="parallelogram",
        points={"O": (0.0, 0.0), "C": (0.3, 0.0)},
        groups=(
            Crank("l1", at="O", end="A", length_m=0.1),
            RRRDyad("l2", "l3", "A", "C", "B", lengths_m=(0.3, 0.1), branch="left_passing"),
        ),
        bodies=(Body("l2", 2.0, 0.01, centroid=(0.4, 0.1)),),
    )
    made = write_fmu(tmp_path / "p.fmu", machine)
    assert {"groups.l1.length_m", "groups.l3.length_m"} <= set(made.fixed)
    assert {"bodies.l2.mass_kg", "bodies.l2.centroid_along", "gravity_m_s2[1]"} <= set(made.parameters)
    assert not validate_fmu(str(tmp_path / "p.fmu"))
