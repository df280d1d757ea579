"""docs/machine_file.md and its pages: every key of the reader with its default, and examples that are valid."""

from __future__ import annotations

import dataclasses
import math
import re
from pathlib import Path
from typing import Any, get_args, get_type_hints

import numpy as np
import pytest
import yaml

import textile_twin_core as ttc
from textile_twin_core.contact import Pad, SlidingBody, SpringDamper, Stop
from textile_twin_core.dynamics import Body
from textile_twin_core.errors import MachineError
from textile_twin_core.files.declarations import build, plain
from textile_twin_core.files.machine_file import GROUPS, LOADS, MEASURES
from textile_twin_core.machine import (
    ContactMachine,
    DrivenElement,
    Encoder,
    EvenShaft,
    Machine,
    MainShaft,
    Scene,
    ShaftDrive,
    ShaftPiece,
    ShaftPlace,
    Station,
    TorqueSensor,
)
from textile_twin_core.twin.compilation import METHODS

DOCS = Path(__file__).parents[2] / "docs"
PARTS_OF_PAGES = {
    "groups": ("All groups", "Groups"),
    "loads": ("All loads", "Loads"),
    "main_shaft": ("Keys of the shaft", "The main shaft"),
    "contact_machine": ("Keys", "A contact machine"),
}
"""Chapters on pages of their own, and what they are called here."""
PAGE = "\n".join(
    [
        (DOCS / "machine_file.md").read_text(encoding="utf-8"),
        *(
            (DOCS / "reference" / f"{page}.md").read_text(encoding="utf-8").replace(f"## {there}\n", f"## {here}\n")
            for page, (there, here) in PARTS_OF_PAGES.items()
        ),
    ]
)
YAML_BLOCKS = re.findall(r"^```yaml\n(.*?)^```$", PAGE, re.M | re.S)
COMPLETE = [block for block in YAML_BLOCKS if "groups" in yaml.safe_load(block)]
CONTACT = [block for block in YAML_BLOCKS if "driven" in yaml.safe_load(block)]
PUBLISHED = [block for block in YAML_BLOCKS if "machine" in yaml.safe_load(block)]
FRAGMENTS = [block for block in YAML_BLOCKS if block not in (*COMPLETE, *CONTACT, *PUBLISHED)]

TYPES = {"Groups": GROUPS, "Loads": LOADS, "Measures": MEASURES}
PARTS: list[tuple[str, str, type]] = [
    *((chapter, tag, cls) for chapter, types in TYPES.items() for tag, cls in types.items()),
    ("Sensors", "encoder", Encoder),
    ("Sensors", "torque", TorqueSensor),
    ("Linkages and scene", "linkages", ShaftPlace),
    ("Linkages and scene", "scene", Scene),
    ("The main shaft", "shaft", MainShaft),
    ("The main shaft", "stations", Station),
    ("The main shaft", "pieces", ShaftPiece),
    ("The main shaft", "drive", ShaftDrive),
    ("The main shaft", "short form of `shaft", EvenShaft),
    ("A contact machine", "driven", DrivenElement),
    ("A contact machine", "bodies", SlidingBody),
    ("A contact machine", "springs", SpringDamper),
    ("A contact machine", "stops", Stop),
    ("A contact machine", "pads", Pad),
]


def _chapter(title: str) -> str:
    found = re.search(rf"^## {re.escape(title)}\n(.*?)(?=^## |\Z)", PAGE, re.M | re.S)
    assert found, f"the page has no chapter '{title}'"
    return found[1]


def _rows(title: str) -> dict[str, str]:
    """Return the second cell of each row of the chapter's table, by the first."""
    rows = (line.strip("| ").split(" | ") for line in _chapter(title).splitlines() if line.startswith("| "))
    return {row[0].strip("`"): row[1] for row in rows if row[0] not in ("type", "key", "in", "sensor", "body")}


def _documented(cell: str) -> dict[str, Any]:
    """Parse keys in code with their defaults; `...` marks a key without one."""
    spans = (span.partition(": ") for span in re.findall(r"`([^`]+)`", cell))
    return {key: yaml.safe_load(default.replace("1e-", "1.0e-")) if colon else ... for key, colon, default in spans}


def _taken(cls: type, **given: Any) -> set[str]:
    """Return the keys that the reader accepts for a declaration, from its message on a wrong key."""
    with pytest.raises(MachineError) as caught:
        build(cls, {"qqqq": 0}, "here", **given)
    return set(str(caught.value).split("available: ")[1].split(", "))


def _default(cls: type, key: str) -> Any:
    field = next((f for f in dataclasses.fields(cls) if f.name == key), None)
    if field is None or (field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING):
        return ...
    return plain(field.default if field.default_factory is dataclasses.MISSING else field.default_factory())


def _same(documented: Any, default: Any) -> bool:
    if isinstance(default, (float, list)) and documented is not ...:
        numbers = not isinstance(default, list) or all(isinstance(v, float) for v in default)
        return bool(documented == (pytest.approx(default, rel=1e-5) if numbers else default))
    return bool(documented == default)


def _load(folder: Path, text: str) -> Machine:
    path = folder / "m.yaml"
    path.write_text(text, encoding="utf-8")
    machine = ttc.load_machine(path)
    assert isinstance(machine, Machine)
    return machine


@pytest.mark.parametrize("title", TYPES)
def test_every_type_has_its_row(title: str) -> None:
    assert _rows(title).keys() == TYPES[title].keys()


@pytest.mark.parametrize(("chapter", "row", "cls"), PARTS, ids=[part[1] for part in PARTS])
def test_a_row_lists_the_keys_of_the_reader(chapter: str, row: str, cls: type) -> None:
    documented = _documented(_rows(chapter)[row])
    assert documented.keys() == _taken(cls)
    for key, default in documented.items():
        assert _same(default, _default(cls, key)), f"{row}.{key}: the page says {default!r}"


def test_the_top_level_keys(tmp_path: Path) -> None:
    with pytest.raises(MachineError) as caught:
        _load(tmp_path, "qqqq: 0")
    taken = set(str(caught.value).split("available: ")[1].split(", "))
    documented: dict[str, Any] = {}
    for line in _chapter("Top-level keys").splitlines()[3:]:
        documented |= _documented(line.strip("| ").split(" | ")[0]) if line.startswith("| ") else {}
    assert documented.keys() == taken | {"parameters"}
    for key, default in documented.items():
        empty = default in ({}, []) and not _default(Machine, key)
        assert empty or key in ("name", "machine", "parameters") or _same(default, _default(Machine, key)), (
            f"{key}: the page says {default!r}"
        )
    with pytest.raises(MachineError) as caught:
        _load(tmp_path, "machine: tufting\nqqqq: 0")
    beside = str(caught.value).split("available: ")[1].split(", ")
    last = _chapter("A published machine with your numbers")
    assert all(f"`{key}`" in last for key in beside)


def test_the_forms_of_a_body() -> None:
    rows = {row: _documented(cell.split("`: a balanced")[0]) for row, cell in _rows("Bodies").items()}
    assert rows["mass"].keys() == _taken(Body, on="l1")
    assert all(_same(default, _default(Body, key)) for key, default in rows["mass"].items())
    assert rows["straight bar over the whole link"].keys() == {"density_kg_m3", "width_m", "thickness_m"}


@pytest.mark.parametrize("text", [*COMPLETE, *PUBLISHED], ids=lambda text: text.split("\n")[0][:30])
def test_a_complete_example_loads_and_runs(tmp_path: Path, text: str) -> None:
    """Check also that the two routes to the torque agree: virtual work and joint reactions."""
    _check_torque(_load(tmp_path, text))


@pytest.mark.parametrize("text", FRAGMENTS, ids=lambda text: text.split("\n")[0][:30])
def test_a_fragment_fits_the_complete_example(tmp_path: Path, text: str) -> None:
    _check_torque(_load(tmp_path, _with(text)))


@pytest.mark.parametrize("text", CONTACT, ids=lambda text: text.split("\n")[0][:30])
def test_a_contact_machine_loads_and_runs(tmp_path: Path, text: str) -> None:
    path = tmp_path / "m.yaml"
    path.write_text(text, encoding="utf-8")
    machine = ttc.load_machine(path)
    assert isinstance(machine, ContactMachine)
    assert machine.simulate().energies.imbalance < 1e-12


def test_the_loads_fragment_shows_every_load(tmp_path: Path) -> None:
    shown = next(text for text in FRAGMENTS if text.startswith("loads:"))
    assert {type(load) for load in _load(tmp_path, _with(shown)).loads} == set(LOADS.values())


def _with(fragment: str) -> str:
    """Replace keys of the complete example by those of the fragment."""
    assert yaml.safe_load(COMPLETE[0])["name"] == "needle_drive"
    parts = re.split(r"^(?=\w)", COMPLETE[0], flags=re.M)
    new = yaml.safe_load(fragment).keys()
    return "".join(part for part in parts if part.split(":")[0] not in new) + fragment


def _check_torque(machine: Machine) -> None:
    theta = np.linspace(0.0, 2.0 * math.pi, 60)
    names = ("balancing_torque_Nm", "balancing_torque_newton_euler_Nm")
    result = ttc.compile(machine, [*machine.scene.outputs, *names]).evaluate(theta, 12.0, 5.0)
    assert all(np.isfinite(values).all() for values in result.values())
    reduced, reactions = (result[name] for name in names)
    assert np.ptp(reduced) > 0.0
    np.testing.assert_allclose(reactions, reduced, rtol=0.0, atol=1e-9 * np.abs(reduced).max())


def test_a_table_that_helps_the_shaft_takes_torque_off_the_drive(tmp_path: Path) -> None:
    table = "loads: [{type: torque_table, angle_rad: [0, 2, 4], torque_Nm: [1.5, 1.5, 1.5]}]\n"
    twin = ttc.compile(_load(tmp_path, _with(table)), ["torque_load_Nm"])
    assert twin.evaluate(0.4, 3.0, 0.0)["torque_load_Nm"] == pytest.approx(-1.5)


def test_a_sensors_block_replaces_what_parameters_say_of_them(tmp_path: Path) -> None:
    text = "machine: tufting\nparameters: {encoder_zero_rad: 0.3}\nsensors: {torque: {delay_s: 0.001}}\n"
    assert _load(tmp_path, text).sensors.encoder == Encoder()


def test_a_linkage_stands_ahead_by_its_phase(tmp_path: Path) -> None:
    twin = ttc.compile(_load(tmp_path, _with("linkages: [{phase_rad: 1.0}]\n")), ["theta_1_rad"])
    assert twin.evaluate(0.7, 0.0, 0.0)["theta_1_rad"] == pytest.approx(1.7)


def test_transmitted_is_the_torque_on_the_arm(tmp_path: Path) -> None:
    """Check an arm of 0.1 m and 1 kg on the rocker of a parallelogram: m g r cos(theta), counter-clockwise."""
    text = """\
points: {O: [0, 0], C: [0.3, 0]}
groups:
  - {type: crank, name: l1, at: O, end: A, length_m: 0.06}
  - {type: rrr_dyad, coupler: l2, rocker: l3, from: A, ground: C, end: B, lengths_m: [0.3, 0.06], branch: left_passing}
  - {type: rigid_arm, name: l4, on: l3, end: D, length_m: 0.1}
bodies: {l4: {mass_kg: 1}}
transmitted: {arm_torque_Nm: l4}
"""
    twin = ttc.compile(_load(tmp_path, text), ["arm_torque_Nm"])
    assert twin.evaluate(0.5, 0.0, 0.0)["arm_torque_Nm"] == pytest.approx(9.81 * 0.05 * math.cos(0.5))


def test_every_branch_and_method_is_documented() -> None:
    for cls in GROUPS.values():
        for branch in get_args(get_type_hints(cls).get("branch")):
            assert f"`{branch}`" in PAGE
    for method in METHODS:
        assert f"`{method}`" in _chapter("Linkages and scene")


def test_passing_branches_are_those_of_parallelogram_and_kite(tmp_path: Path) -> None:
    text = """\
points: {O: [0, 0], C: [0.3, 0]}
groups:
  - {type: crank, name: l1, at: O, end: A, length_m: 0.06}
  - {type: rrr_dyad, coupler: l2, rocker: l3, from: A, ground: C, end: B, lengths_m: LENGTHS, branch: right_passing}
"""
    parallelogram, kite = (text.replace("LENGTHS", lengths) for lengths in ("[0.3, 0.06]", "[0.06, 0.3]"))
    for machine, crossed in (
        (parallelogram, True),
        (parallelogram.replace("right", "left"), False),
        (kite.replace("right", "left"), False),
    ):
        height = ttc.compile(_load(tmp_path, machine), ["point_A_y_m", "point_B_y_m"]).evaluate(1.0, 0.0, 0.0)
        assert height["point_A_y_m"] > 0.0
        assert (height["point_B_y_m"] < 0.0) is crossed
    with pytest.raises(MachineError, match="choose 'left_passing'"):
        _load(tmp_path, kite)
    with pytest.raises(MachineError, match="passing branch needs"):
        _load(tmp_path, text.replace("LENGTHS", "[0.3, 0.1]"))
