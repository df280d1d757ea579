"""Machine files: equal to the same declaration in Python, and errors that name file and key."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import textile_twin_core as ttc
from textile_twin_core.errors import MachineError, OutputError
from textile_twin_core.files import load_machine_file, machine_document, save_machine_file

LOOM = """\
name: my_loom
gravity_m_s2: [0, -9.81]
points: {O: [0, 0], C: [0.3, 0]}
groups:
  - {type: crank, name: crank, at: O, end: A, length_m: 0.06}
  - {type: rrr_dyad, coupler: l2, rocker: l3, from: A, ground: C, end: B, lengths_m: [0.2, 0.23], branch: left}
bodies: {l2: {mass_kg: 0.4, inertia_kgm2: 0.0015, centroid: [0.5, 0]}}      # fractions of the link, along and across
measures: [{type: arc, name: sley, link: l3, radius_m: 0.23}]
sensors: {encoder: {zero_rad: 0.1, direction: -1, ratio: 2}, torque: {gain: 1.01, offset_Nm: 0, delay_s: 2e-3}}
linkages: [{phase_rad: 0}, {phase_rad: 1.5}]                                # several on one shaft
scene: {outputs: [balancing_torque_Nm], method: exact, tolerance: 1e-12}
"""


def _file(folder: Path, text: str) -> Path:
    path = folder / "machine.yaml"
    path.write_text(text)
    return path


def test_a_declared_machine_moves_as_its_geometry_says(tmp_path: Path) -> None:
    machine = ttc.load_machine(_file(tmp_path, LOOM))
    assert machine.name == "my_loom"
    assert machine.sensors.encoder == ttc.machines.Encoder(0.1, -1, 2.0)
    assert machine.sensors.torque == ttc.machines.TorqueSensor(1.01, 0.0, 0.002)
    assert machine.scene == ttc.machines.Scene(("balancing_torque_Nm",), "exact", 1e-12)
    assert [place.phase_rad for place in machine.linkages] == [0.0, 1.5]
    theta = np.linspace(0.0, 2 * math.pi, 50)
    r = ttc.compile(machine, ["point_B_x_m", "point_B_y_m"]).evaluate(theta, 0.0, 0.0)
    ax, ay = 0.06 * np.cos(theta), 0.06 * np.sin(theta)
    bx, by = r["point_B_x_m"], r["point_B_y_m"]
    np.testing.assert_allclose(np.hypot(bx - ax, by - ay), 0.2, rtol=1e-12)
    np.testing.assert_allclose(np.hypot(bx - 0.3, by), 0.23, rtol=1e-12)
    left = (0.3 - ax) * (by - ay) - (0.0 - ay) * (bx - ax)
    assert (left > 0).all()


def test_the_measuring_chain_goes_through_a_file(tmp_path: Path) -> None:
    encoder = ttc.machines.Encoder(eccentricity_rad=((0.01, 0.02), (0.0, -0.003)))
    torque = ttc.machines.TorqueSensor(low_pass_hz=20.0, low_pass_order=2, high_pass_hz=0.5)
    machine = dataclasses.replace(ttc.machines.tufting(), sensors=ttc.machines.Sensors(encoder, torque))
    ttc.files.save_machine_file(machine, tmp_path / "m.yaml")
    assert ttc.load_machine(tmp_path / "m.yaml") == machine


@pytest.mark.parametrize("change", [{}, {"name": "no 7"}, {"parameters": {}}, {"gravity_m_s2": (0.0, 0.0)}])
def test_the_tufting_machine_goes_through_a_file(tmp_path: Path, change: dict[str, Any]) -> None:
    """Check a file with the published name and parameters if these suffice, and a file with groups otherwise."""
    machine = dataclasses.replace(ttc.machines.tufting(backing_force_N=900.0, torque_sensor_delay_s=0.002), **change)
    assert ("machine" in machine_document(machine)) is (change.keys() <= {"name"})
    if "gravity_m_s2" in change:
        machine = dataclasses.replace(machine, parameters={})
    save_machine_file(machine, tmp_path / "m.yaml")
    assert load_machine_file(tmp_path / "m.yaml") == machine


@pytest.mark.parametrize("change", [{}, {"name": "no 7", "parameters": {}, "nominal_speed_rad_s": np.float64(20.0)}])
def test_numbers_may_come_from_numpy(tmp_path: Path, change: dict[str, Any]) -> None:
    """Check a file with the published name and parameters, and a file with groups."""
    machine = dataclasses.replace(ttc.machines.tufting(backing_force_N=np.float64(900.0)), **change)
    save_machine_file(machine, tmp_path / "m.yaml")
    assert load_machine_file(tmp_path / "m.yaml") == machine


def test_a_published_machine_with_the_users_sensors(tmp_path: Path) -> None:
    path = _file(
        tmp_path, "machine: tufting\nparameters: {m1_kg: 3}\nsensors: {torque: {delay_s: 0.002}}\nname: no 7\n"
    )
    machine = load_machine_file(path)
    assert (machine.name, machine.sensors.torque.delay_s) == ("no 7", 0.002)
    assert machine.bodies[0].mass_kg == 3.0
    assert load_machine_file(_file(tmp_path, "machine: tufting")) == ttc.machines.tufting()


def test_a_parameter_that_is_a_word(tmp_path: Path) -> None:
    machine = load_machine_file(_file(tmp_path, "machine: needle_transfer\nparameters: {design: optimised}"))
    assert machine.start[0] == 0.0669


@pytest.mark.parametrize("name", ["six_bar_loom", "tufting_two_linkages"])
def test_the_examples_go_through_a_file(tmp_path: Path, name: str) -> None:
    machine = load_machine_file(Path(__file__).parents[2] / "examples" / f"{name}.yaml")
    save_machine_file(machine, tmp_path / "m.yaml")
    assert load_machine_file(tmp_path / "m.yaml") == machine


def test_a_bar_takes_its_mass_from_density_and_section(tmp_path: Path) -> None:
    text = LOOM.replace(
        "l2: {mass_kg: 0.4, inertia_kgm2: 0.0015, centroid: [0.5, 0]}",
        "l2: {density_kg_m3: 7850, width_m: 0.03, thickness_m: 0.01}",
    )
    body = load_machine_file(_file(tmp_path, text)).bodies[0]
    mass = 7850 * 0.2 * 0.03 * 0.01
    assert (body.on, body.mass_kg) == ("l2", pytest.approx(mass))
    assert body.inertia_kgm2 == pytest.approx(mass * (0.2**2 + 0.03**2) / 12)


def test_words_and_numbers_are_read_as_people_mean_them(tmp_path: Path) -> None:
    """Check that `on` is a word, 1e-9 a number and 0700 decimal, unlike in YAML 1.1."""
    text = LOOM + "loads:\n  - {type: backing, on: sley, force_N: 1e3, entry_plane_m: 1, exit_plane_m: 1}\n"
    with pytest.raises(MachineError, match=r"straight travel"):
        ttc.compile(load_machine_file(_file(tmp_path, text)), ["reaction_O_x_N"])
    assert load_machine_file(_file(tmp_path, LOOM.replace("1e-12", "1e-9"))).scene.tolerance == 1e-9
    heavy = load_machine_file(_file(tmp_path, "machine: tufting\nparameters: {backing_force_N: 0700}"))
    assert heavy.parameters["backing_force_N"] == 700.0
    for text, direction in (("+01", 1), ("-0x1", -1), ("0o1", 1)):
        document = f"machine: tufting\nsensors: {{encoder: {{direction: {text}}}}}"
        assert load_machine_file(_file(tmp_path, document)).sensors.encoder.direction == direction


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("length_m: 0.06", "lenght_m: 0.06", r"groups\[0\].lenght_m: unknown key 'lenght_m'; did you mean length_m"),
        ("length_m: 0.06", "length_m: six", r"groups\[0\].length_m: must be a number, not 'six'"),
        ("length_m: 0.06", "length_m: -0.06", r"groups\[0\]: crank 'crank': length_m"),
        (", length_m: 0.06", "", r"groups\[0\]: key 'length_m' is missing"),
        ("type: crank, ", "", r"groups\[0\]: key 'type' is missing"),
        ("type: rrr_dyad", "type: rrr", r"groups\[1\].type: unknown type 'rrr'; did you mean"),
        ("branch: left", "branch: lft", r"groups\[1\].branch: unknown value 'lft'; did you mean left"),
        ("[0.2, 0.23]", "[0.2]", r"groups\[1\].lengths_m: must be a list of 2, not of 1"),
        ("[0.2, 0.23]", "[0.2, 0.05]", r"machine.yaml: machine 'my_loom': .*deg"),
        ("from: A", "from: Q", "Q"),
        ("C: [0.3, 0]", "C: 0.3", r"points.C: must be a list"),
        ("bodies: {l2:", "bodies: {l7:", r"bodies.l7: unknown link 'l7'"),
        ("mass_kg: 0.4", "mass_kg: -1", r"bodies.l2: .*mass_kg"),
        ("mass_kg: 0.4", "mass_kg: 0,4", r"bodies.l2.4: unknown key '4'; digits behind a decimal comma\?"),
        (
            "delay_s: 2e-3",
            "delay_s: 0,2e-3",
            r"sensors.torque.0.002: unknown key '0.002'; digits behind a decimal",
        ),
        ("mass_kg: 0.4", "density_kg_m3: 7850", r"bodies.l2.inertia_kgm2: not together with a density"),
        ("zero_rad: 0.1", "zero_deg: 0.1", r"sensors.encoder.zero_deg: unknown key 'zero_deg'; did you mean zero_rad"),
        ("direction: -1", "direction: 2", r"sensors.encoder: encoder: direction must be 1 or -1"),
        ("direction: -1", "direction: 0.5", r"sensors.encoder.direction: must be a whole number"),
        ("ratio: 2", "eccentricity_rad: [0.1, 0.2]", r"sensors.encoder.eccentricity_rad\[0\]: must be a list"),
        ("ratio: 2", "eccentricity_rad: [[9, 0]]", r"sensors.encoder: encoder: eccentricity_rad must be .* small"),
        ("delay_s: 2e-3", "low_pass_s: 0.01, low_pass_hz: 9", r"sensors.torque: torque sensor: give low_pass_s or"),
        ("gravity_m_s2", "gravity", r"gravity: unknown key 'gravity'; did you mean gravity_m_s2"),
        ("points: {O: [0, 0], C: [0.3, 0]}\n", "", "key 'points' is missing"),
        ("name: my_loom", "name: my_loom\nname: other", "line 2, column 1: 'name' is given twice"),
        ("bodies: {l2:", "bodies: []  # {", "bodies: must be a mapping"),
        ("tolerance: 1e-12", "tolerance: 0", "scene: .*tolerance must be a positive number, such as 1e-12, not 0"),
        ("[balancing_torque_Nm]", "[balancing_torque]", r"scene.outputs: .*mean balancing_torque_Nm"),
        ("[balancing_torque_Nm]", "[]", "scene.outputs: names none"),
        ("bodies: {l2:", "bodies: {l2", "line"),
        ("linkages: [{phase_rad: 0}, {phase_rad: 1.5}]", "linkages: []", "at least one linkage"),
        ("name: my_loom", "parameters: {l1_m: 0.1}", "are those of a published machine"),
    ],
)
def test_a_fault_names_file_and_place(tmp_path: Path, old: str, new: str, says: str) -> None:
    assert old in LOOM
    path = _file(tmp_path, LOOM.replace(old, new))
    with pytest.raises(MachineError, match=says) as caught:
        load_machine_file(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "the file: must be a mapping"),
        ("- 1", "the file: must be a mapping"),
        ("machine: tuftin", "did you mean tufting"),
        ("machine: tufting\nparameters: {l1: 3}", "no parameter 'l1'"),
        ("machine: tufting\nparameters: {l1_m: long}", "parameters.l1_m: must be a number, not 'long'"),
        ("machine: needle_transfer\nlinkages: [{phase_rad: 0}]", "linkages: machine 'needle_transfer' is no linkage"),
        ("machine: tufting\ngroups: []", "groups: unknown key 'groups'"),
    ],
)
def test_files_that_declare_nothing(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(MachineError, match=says):
        load_machine_file(_file(tmp_path, text))


def test_a_file_that_is_not_there_or_is_no_text(tmp_path: Path) -> None:
    with pytest.raises(MachineError, match="no such file"):
        load_machine_file(tmp_path / "nowhere.yaml")
    (tmp_path / "b.yaml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(MachineError, match="cannot be read as text"):
        load_machine_file(tmp_path / "b.yaml")
    with pytest.raises(OutputError, match="is not a folder"):
        save_machine_file(ttc.machines.tufting(), tmp_path / "b.yaml" / "m.yaml")


def test_the_error_of_an_unknown_method_names_the_file(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("machine: tufting\nscene: {method: exakt}\n")
    with pytest.raises(MachineError, match=r"mine.yaml: scene.method: .*exact"):
        load_machine_file(path)


def test_the_error_of_a_file_of_another_kind_is_short(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("time,angle,torque\n" + "0.1,0.2,0.3\n" * 5000, encoding="utf-8")
    with pytest.raises(
        MachineError, match=r"log.csv: the file: must be a mapping .*'time,angle,torque.* \.\.$"
    ) as error:
        load_machine_file(tmp_path / "log.csv")
    assert len(str(error.value)) < 200 + len(str(tmp_path))
