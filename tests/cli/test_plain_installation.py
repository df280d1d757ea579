"""The package without extras, in an environment of its own: a missing extra is named with its installation command."""

from __future__ import annotations

import csv
import os
import subprocess
import sys
from importlib.metadata import Distribution, distribution
from pathlib import Path
from shutil import copytree, ignore_patterns

import pytest
from packaging.requirements import Requirement

from textile_twin_core.machines import tufting
from textile_twin_core.twin import compile_machine

pytestmark = pytest.mark.campaign

ROOT = Path(__file__).parents[2]
LITTLE_BENCH = """
import textile_twin_core as ttc
from textile_twin_core.bench import run_bench

print({row.method for row in run_bench(ttc.machines.tufting(), rounds=1, samples=200, scene_names=["position"])})
"""


def needed(name: str, found: dict[str, Distribution]) -> None:
    """Collect a package and all its dependencies without extras."""
    if name.lower() in found:
        return
    found[name.lower()] = distribution(name)
    for text in found[name.lower()].requires or ():
        requirement = Requirement(text)
        if requirement.marker is None or requirement.marker.evaluate({"extra": ""}):
            needed(requirement.name, found)


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Create an environment with a wheel of this checkout and its dependencies, copied from here without network."""
    folder = tmp_path_factory.mktemp("plain")
    copytree(ROOT / "textile_twin_core", folder / "source/textile_twin_core", ignore=ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        (folder / "source" / name).write_bytes((ROOT / name).read_bytes())
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "-q"]
    build = [
        *pip,
        "wheel",
        "--no-deps",
        "--no-index",
        "--no-build-isolation",
        "-w",
        str(folder),
        str(folder / "source"),
    ]
    subprocess.run(build, check=True, timeout=300)
    (wheel,) = folder.glob("*.whl")
    venv = folder / "venv"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(venv)], check=True, timeout=100)
    python = venv / "bin/python"
    install = [*pip, "--python", str(python), "install", "--no-deps", "--no-index", str(wheel)]
    subprocess.run(install, check=True, timeout=300)
    place = next((venv / "lib").glob("python3.*")) / "site-packages"
    (metadata,) = place.glob("textile_twin_core-*.dist-info")
    found: dict[str, Distribution] = {}
    for text in Distribution.at(metadata).requires or ():
        requirement = Requirement(text)
        if requirement.marker is None or requirement.marker.evaluate({"extra": ""}):
            needed(requirement.name, found)
    for each in found.values():
        for top in {file.parts[0] for file in each.files or () if file.parts[0] != ".."}:
            if not (place / top).exists():
                (place / top).symlink_to(Path(str(each.locate_file(top))))
    return venv / "bin/textile-twin"


def run(command: Path, *arguments: str, where: Path) -> subprocess.CompletedProcess[str]:
    clean = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    return subprocess.run(
        [str(command), *arguments], cwd=where, env=clean, capture_output=True, text=True, timeout=300, check=False
    )


def test_machines_simulate_bench_and_published_need_no_extra(plain: Path, tmp_path: Path) -> None:
    there = run(plain, "machines", where=tmp_path)
    assert there.returncode == 0 and "tufting" in there.stdout, there.stderr
    outputs = ["--outputs", "balancing_torque_Nm,needle_position_m"]
    done = run(plain, "simulate", "tufting", "--rpm", "160", "--out", "x.csv", *outputs, where=tmp_path)
    assert done.returncode == 0, done.stderr
    with (tmp_path / "x.csv").open() as file:
        rows = [{name: float(cell) for name, cell in row.items()} for row in csv.DictReader(file)]
    twin = compile_machine(tufting(), outputs[1].split(","), method="exact")
    for row in rows[::40]:
        expected = twin.evaluate(row["theta_rad"], row["omega_rad_s"], row["alpha_rad_s2"])
        for name in outputs[1].split(","):
            assert row[name] == pytest.approx(float(expected[name]), rel=1e-9, abs=1e-9)
    done = run(plain, "published", where=tmp_path)
    assert done.returncode == 0 and "tufting" in done.stdout.lower(), done.stderr
    assert run(plain, "bench", "--help", where=tmp_path).returncode == 0
    done = run(plain.with_name("python"), "-c", LITTLE_BENCH, where=tmp_path)
    assert done.returncode == 0 and "exact" in done.stdout, done.stderr


@pytest.mark.parametrize(
    ("arguments", "extra"),
    [
        (["simulate", "tufting", "--rpm", "9", "--png", "x.png"], "view"),
        (["compare", str(ROOT / "bags/tufting_160rpm_synthetic"), "--machine", "tufting"], "files"),
        (["explore", "--no-browser"], "files,design"),
        (["simulate", "tufting", "--rpm", "9", "--out", "x.parquet"], "files"),
        (["simulate", "tufting", "--rpm", "9", "--out", "x.mcap"], "files"),
        (["import", "log.csv", "--out", "bag"], "files"),
    ],
)
def test_what_needs_an_extra_says_how_to_install_it_from_a_checkout(
    arguments: list[str], extra: str, plain: Path, tmp_path: Path
) -> None:
    (tmp_path / "log.csv").write_text("time,angle_rad\n" + "".join(f"{0.002 * k},{0.03 * k}\n" for k in range(99)))
    done = run(plain, *arguments, where=tmp_path)
    assert done.returncode == 2 and done.stderr.count("\n") == 1, done.stderr
    assert "needs the package" in done.stderr and f"pip install '.[{extra}]'" in done.stderr
