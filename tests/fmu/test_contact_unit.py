"""Exported FMUs of contact machines: equal to the twin through impacts, rests, pads and changes of speed."""

from __future__ import annotations

import shutil
import subprocess
import zipfile
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

import textile_twin_core as ttc
from tests.campaign import more
from textile_twin_core.arrays import FloatArray
from textile_twin_core.fmu import write_fmu
from textile_twin_core.machine import ContactMachine
from textile_twin_core.machine.contact_motion import ContactMotion

fmpy = pytest.importorskip("fmpy")
from fmpy.fmi1 import FMICallException  # noqa: E402
from fmpy.validation import validate_fmu  # noqa: E402

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")

SHAFT = ("theta_rad", "omega_rad_s", "alpha_rad_s2")


def simulated(path: Path, step: float, *shaft: FloatArray, parameters: dict[str, float] | None = None) -> Any:
    """Co-simulation along samples of the shaft's angle, speed and acceleration."""
    samples = shaft[0].size
    motion = np.empty(samples, dtype=[(name, float) for name in ("time", *SHAFT)])
    motion["time"] = step * np.arange(samples)
    for name, values in zip(SHAFT, shaft, strict=True):
        motion[name] = values
    start = {name: float(motion[name][0]) for name in SHAFT} | (parameters or {})
    return fmpy.simulate_fmu(
        str(path),
        stop_time=step * (samples - 1),
        step_size=step,
        output_interval=step,
        start_values=start,
        input=motion,
    )


def worst(found: Any, true: dict[str, FloatArray]) -> dict[str, float]:
    """Largest difference of each output over its peak."""
    return {name: float(np.abs(found[name] - x).max() / max(np.abs(x).max(), 1e-9)) for name, x in true.items()}


@pytest.mark.parametrize("fmi", [3, *more(2)])
def test_the_needle_transfer_is_the_twin_through_its_impacts(fmi: Literal[2, 3], tmp_path: Path) -> None:
    """Every output over three turns at two speeds, and while it runs up: to 1e-9 of its peak, at impacts too."""
    machine, path = ttc.machines.needle_transfer(), tmp_path / "needle.fmu"
    made = write_fmu(path, machine, fmi=fmi, outputs=machine.outputs)
    assert made.has_binary and not made.fixed
    assert not validate_fmu(str(path))
    description = zipfile.ZipFile(path).read("modelDescription.xml").decode()
    assert "<CoSimulation" in description and "<ModelExchange" not in description
    step = 2e-4
    for rpm, alpha, turns in ((250.0, 0.0, 3.0), (-380.0, 0.0, 3.0), (120.0, 90.0, 3.0)):
        omega_0 = rpm * 2.0 * np.pi / 60.0
        end = 2.0 * np.pi * turns / abs(omega_0) if alpha == 0.0 else 0.6
        time = step * np.arange(round(end / step))
        theta, omega = 0.3 + omega_0 * time + 0.5 * alpha * time**2, omega_0 + alpha * time
        shaft = theta, omega, np.full(time.size, alpha)
        motion = ContactMotion(machine, machine.outputs, 1e-14)
        true = motion.step(time, *shaft)
        events = [event.kind for event in motion.take_events()]
        assert events.count("impact") > 40 and {"rest", "touch", "leave", "release"} <= set(events)
        assert {name: off for name, off in worst(simulated(path, step, *shaft), true).items() if off > 1e-9} == {}


def test_its_parameters_are_the_machines(tmp_path: Path) -> None:
    machine, path = ttc.machines.needle_transfer(), tmp_path / "needle.fmu"
    write_fmu(path, machine, outputs=machine.outputs)
    other = ttc.machines.needle_transfer(
        element_3_kg=0.006, collet_restitution=0.5, pad_damping_Ns_m=20.0, pad_cubic_N_mm3=1200.0, spring_1_N_m=1000.0
    )
    parameters = {
        "bodies.element_3.mass_kg": 0.006, "stops.collet_contact.restitution": 0.5,
        "springs.spring_1.stiffness_N_m": 1e3,
        "pads.rubber_pad.damping_Ns_m": 20.0, "pads.rubber_pad.stiffness[2]": 1200e9,
    }  # fmt: skip
    step, speed = 5e-4, machine.nominal_speed_rad_s
    time = step * np.arange(960)
    shaft = speed * time, np.full(time.size, speed), np.zeros(time.size)
    found = simulated(path, step, *shaft, parameters=parameters)
    assert max(worst(found, ContactMotion(other, None, 1e-14).step(time, *shaft)).values()) < 1e-9
    assert max(worst(found, ContactMotion(machine, None, 1e-14).step(time, *shaft)).values()) > 1e-3


def test_a_picker_with_slack_pads_and_a_wrapped_angle(tmp_path: Path) -> None:
    """Pads that do not pull, a stop on the frame, and the angle of an encoder that starts again each turn."""
    machine, path = ttc.load_machine("examples/picker.yaml"), tmp_path / "picker.fmu"
    write_fmu(path, machine, outputs=machine.outputs)
    assert not validate_fmu(str(path))
    step = 5e-4
    time = step * np.arange(1400)
    theta = 18.85 * time
    shaft = np.mod(theta, 2.0 * np.pi), np.full(time.size, 18.85), np.zeros(time.size)
    assert isinstance(machine, ContactMachine)
    motion = ContactMotion(machine, None, 1e-14)
    true = motion.step(time, theta, *shaft[1:])
    assert {"touch", "slack", "leave", "impact"} <= {event.kind for event in motion.take_events()}
    assert max(worst(simulated(path, step, *shaft), true).values()) < 1e-9


def test_a_body_beyond_its_stop_ends_the_step_with_an_error(tmp_path: Path) -> None:
    path = tmp_path / "needle.fmu"
    write_fmu(path, ttc.machines.needle_transfer())
    standing = np.zeros(3)
    with pytest.raises(FMICallException, match="fmi2DoStep"):
        simulated(path, 1e-3, standing, standing, standing, parameters={"start_m.element_2": 0.08})


@pytest.mark.parametrize("fmi", [2, *more(3)])
def test_its_state_is_saved_between_bounces_and_no_python_is_linked(fmi: Literal[2, 3], tmp_path: Path) -> None:
    path, folder = tmp_path / "needle.fmu", tmp_path / "unit"
    write_fmu(path, ttc.machines.needle_transfer(), fmi=fmi)
    fmpy.extract(path, folder)
    library = next(folder.glob("binaries/*/*.so"))
    needed = subprocess.run(["readelf", "-d", library], capture_output=True, text=True, check=True).stdout
    assert "libc.so" in needed and "python" not in needed.lower()
    description = fmpy.read_model_description(path)
    reference = {v.name: v.valueReference for v in description.modelVariables}
    unit = fmpy.instantiate_fmu(str(folder), description, "CoSimulation")
    get, put = (unit.getReal, unit.setReal) if fmi == 2 else (unit.getFloat64, unit.setFloat64)
    save, load = (unit.getFMUstate, unit.setFMUstate) if fmi == 2 else (unit.getFMUState, unit.setFMUState)
    pack = unit.serializeFMUstate if fmi == 2 else unit.serializeFMUState
    unpack = unit.deSerializeFMUstate if fmi == 2 else unit.deserializeFMUState
    speed, step = 26.18, 1e-3
    outputs = [reference[f"element_{k}_{what}"] for k in (1, 2, 3) for what in ("position_m", "velocity_m_s")]

    def run(first: int, last: int) -> list[float]:
        for k in range(first, last):
            put([reference["theta_rad"]], [speed * k * step])
            unit.doStep(k * step, step)
        return list(get(outputs))

    if fmi == 2:
        unit.setupExperiment(startTime=0.0)
        unit.enterInitializationMode()
    else:
        unit.enterInitializationMode(startTime=0.0)
    put([reference["omega_rad_s"]], [speed])
    unit.exitInitializationMode()
    run(0, 20)  # the collets bounce from 19 ms on
    saved = save()
    kept = pack(saved)
    first = run(20, 60)
    load(saved)
    assert run(20, 60) == first
    load(unpack(kept))
    assert run(20, 60) == first
    unit.freeInstance()
