"""Recipes of CONTRIBUTING.md: load, group and log format are added as written; the others have all places."""

from __future__ import annotations

import math
import re
import subprocess
import sys
from pathlib import Path
from shutil import copytree, ignore_patterns

import numpy as np
import pytest

from tests.docs.pages import ROOT, blocks
from tests.generators.faults import EXPECTED, SIZES
from textile_twin_core.comparison.fault_naming import SIDE
from textile_twin_core.recordings import open_bag

PAGE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
LOAD = """
points: {O: [0, 0], C: [0.3, 0]}
groups:
  - {type: crank, name: l1, at: O, end: A, length_m: 0.06}
  - {type: rrr_dyad, coupler: l2, rocker: l3, from: A, ground: C, end: B, lengths_m: [0.2, 0.23]}
bodies: {l3: {mass_kg: 2, inertia_kgm2: 0.01}}
loads: [{type: air_drag, point: B, drag_Ns2_m2: 0.8}]
"""
GROUP = """
points: {O: [0, 0]}
groups:
  - {type: crank, name: l1, at: O, end: A, length_m: 0.05}
  - {type: scotch_yoke, name: bar, driven_by: A, end: B, tip: T, length_m: 0.2}
bodies: {bar: {mass_kg: 1.5}}
"""
CHECK = """
import sys
import numpy as np
import textile_twin_core as ttc
from textile_twin_core.machine.slots import slots
machine = ttc.load_machine("machine.yaml")
names = ["balancing_torque_Nm", "balancing_torque_newton_euler_Nm"]
for theta in np.linspace(0.1, 6.0, 7).tolist():
    one, other = ttc.compile(machine, names, "exact").evaluate(theta, 30.0, 5.0).values()
    assert abs(one - other) < 1e-12 and abs(one) > 1e-6, (theta, one, other)
assert sys.argv[1] in [slot.path for slot in slots(machine)]
"""


def recipe(name: str) -> str:
    return PAGE.split(f"**{name}**\n", 1)[1].split("\n**", 1)[0].split("\n## ", 1)[0]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "number", "folder", "kind", "machine", "path"),
    [
        ("A load", 1, "textile_twin_core/dynamics/loads", "AirDrag", LOAD, "loads.air_drag.drag_Ns2_m2"),
        ("A dyad, or any group", 0, "textile_twin_core/mechanism", "ScotchYoke", GROUP, "groups.bar.length_m"),
    ],
)
def test_a_class_becomes_part_of_the_package(
    name: str, number: int, folder: str, kind: str, machine: str, path: str, tmp_path: Path
) -> None:
    text = recipe(name)
    assert f"`{folder}`" in text and f"`{folder}/__init__.py`" in text and f"import {kind} as {kind}" in text
    copytree(ROOT / "textile_twin_core", tmp_path / "textile_twin_core", ignore=ignore_patterns("__pycache__"))
    code = [block.text for block in blocks(Path("docs/extending.md")) if block.language == "python"][number]
    declared = code.split("\nmachine = ")[0].replace("import textile_twin_core as ttc\n", "")
    module = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", kind).lower()
    package = folder.replace("/", ".")
    # Inside the package a class comes from its own module, so that no package imports itself.
    declared = declared.replace("from textile_twin_core.dynamics import Body\n", "")
    declared = re.sub(r"from textile_twin_core.mechanism import .*\n", "", declared)
    (tmp_path / folder / f"{module}.py").write_text(declared)
    listing = tmp_path / folder / "__init__.py"
    listing.write_text(listing.read_text() + f"from {package}.{module} import {kind} as {kind}\n")
    (tmp_path / "machine.yaml").write_text(machine)
    done = subprocess.run([sys.executable, "-c", CHECK, path], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]


@pytest.mark.slow
def test_a_log_format_becomes_part_of_the_package(tmp_path: Path) -> None:
    text = recipe("A log format")
    code = next(b.text for b in blocks(Path("CONTRIBUTING.md")) if b.language == "python" and "read_npz" in b.text)
    copytree(ROOT / "textile_twin_core", tmp_path / "textile_twin_core", ignore=ignore_patterns("__pycache__"))
    folder = tmp_path / re.search(r"`(textile_twin_core/recordings)`", text)[1]  # type: ignore[index]
    (folder / "log_npz.py").write_text(code)
    files, line = tmp_path / "textile_twin_core/recordings/log_files.py", '".npz": read_npz,'
    assert f"`{files.relative_to(tmp_path)}`" in text and line in text
    old, table = files.read_text(), "READERS: dict[str, Callable[[Path, str | None, Head], Columns]] = {\n"
    assert table in old
    listed = old.replace(table, f"{table}    {line}\n")
    imported = "from textile_twin_core.recordings.log_npz import read_npz\n"
    first = "from textile_twin_core.recordings.log_mapping"
    files.write_text(listed.replace(first, imported + first, 1))
    time = np.arange(500) / 500.0
    np.savez(tmp_path / "log.npz", time=time, **{"angle [deg]": 720.0 * time, "torque [Nm]": np.sin(12.0 * time)})
    program = "import sys; from textile_twin_core.cli.main import main; sys.exit(main(sys.argv[1:]))"
    command = [sys.executable, "-c", program, "import", "log.npz", "--out"]
    done = subprocess.run([*command, "bag"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    bag = open_bag(tmp_path / "bag")
    np.testing.assert_allclose(bag.read_angles().angles_rad, 4.0 * math.pi * time, atol=1e-9)
    np.testing.assert_allclose(bag.read_torques().torque_Nm, np.sin(12.0 * time), atol=1e-9)
    (tmp_path / "log.npz").write_bytes((tmp_path / "log.npz").read_bytes()[:200])
    done = subprocess.run([*command, "other"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 2 and "log.npz: not a .npz file" in done.stderr and done.stderr.count("\n") == 1


def test_every_topic_of_the_twin_has_the_places_of_its_recipe() -> None:
    pytest.importorskip("rclpy")
    from textile_twin_ros.machine_namespace import OUTPUTS

    text = recipe("A topic of the twin")
    for place in re.findall(r"`((?:textile_twin_core|ros2_ws)/[\w/]+\.py)`", text):
        assert (ROOT / place).exists(), place
    readme = (ROOT / "README.md").read_text()
    nodes = (ROOT / "ros2_ws/src/textile_twin_ros/README.md").read_text()
    for topic in OUTPUTS:
        assert f"`{topic}`" in readme and topic in nodes, topic


def test_every_alarm_has_the_places_of_its_recipe() -> None:
    text = recipe("An alarm")
    for place in re.findall(r"`((?:textile_twin_core|tests)/[\w/]+\.py)`", text):
        assert (ROOT / place).exists(), place
    advice = (ROOT / "docs" / "how_to" / "verdict.md").read_text()
    of_the_process = (ROOT / "tests" / "comparison" / "test_process_force.py").read_text()
    for kind in SIDE:
        assert (kind in EXPECTED.values() or f'"{kind}"' in of_the_process) and f"| `{kind}` |" in advice, kind
    assert EXPECTED.keys() - SIZES.keys() <= {"stuck"}


def test_the_recipe_of_a_cause_names_places_that_exist() -> None:
    """That every cause has its rows is held by `test_verdict_page` and `test_truth`."""
    text = recipe("A cause of the verdict")
    places = re.findall(r"`((?:textile_twin_core|tests)/[\w/]+\.py)`", text)
    assert len(places) == 5 and all((ROOT / place).exists() for place in places), places
    priors = (ROOT / places[1]).read_text()
    assert "PRIORS" in priors and all(f"{table}" in (ROOT / places[3]).read_text() for table in ("_ONE", "_CAUSES"))
