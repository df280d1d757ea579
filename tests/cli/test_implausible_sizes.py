"""Machine files in millimetres or with inertias in kg mm2: one line of warning beside the result."""

from __future__ import annotations

from pathlib import Path

import pytest

from textile_twin_core import machines
from textile_twin_core.cli.main import main

ROOT = Path(__file__).parents[2]


def notices(tmp_path: Path, scale: float, inertia: float, capsys: pytest.CaptureFixture[str]) -> str:
    crank, coupler, rocker, ground = (scale * length for length in (0.06, 0.2, 0.23, 0.3))
    path = tmp_path / "loom.yaml"
    path.write_text(
        f"points: {{O: [0, 0], C: [{ground}, 0]}}\ngroups:\n"
        f"  - {{type: crank, name: l1, at: O, end: A, length_m: {crank}}}\n"
        "  - {type: rrr_dyad, coupler: l2, rocker: l3, from: A, ground: C, end: B,"
        f" lengths_m: [{coupler}, {rocker}], branch: left}}\n"
        f"bodies: {{l2: {{mass_kg: 0.4, inertia_kgm2: {inertia}}}, main_shaft: {{mass_kg: 1, inertia_kgm2: 100}}}}\n"
    )
    out = tmp_path / "turn.csv"
    assert main(["simulate", str(path), "--rpm", "60", "--samples", "4", "--out", str(out)]) == 0 and out.exists()
    return capsys.readouterr().err


def test_metres_give_no_warning(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert notices(tmp_path, 1.0, 1.5e-3, capsys) == ""


def test_millimetres_give_a_warning(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = notices(tmp_path, 1000.0, 1.5e-3, capsys)
    assert said == "textile-twin: machine 'loom': link 'l3' is 230 m long: lengths and points are in metres\n"


@pytest.mark.parametrize("factor", [1e4, 1e6])
def test_inertias_in_kg_cm2_or_mm2_give_a_warning(
    factor: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = notices(tmp_path, 1.0, 1.5e-3 * factor, capsys)
    assert said.count("\n") == 1 and "on link 'l2'" in said and "inertias are in kg m2 about the centroid" in said


@pytest.mark.parametrize("name", [*machines.NAMES, *sorted(str(path) for path in (ROOT / "examples").glob("*.yaml"))])
def test_plausible_machines_give_no_warning(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["machines", name]) == 0
    assert "are in metres" not in (said := capsys.readouterr().err) and "are in kg m2" not in said
