"""Linkages with a dead point within the turn: reported once, with the angle and the remedy."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from textile_twin_core import machines
from textile_twin_core.cli.main import main

DYAD = "{{type: rrr_dyad, coupler: l2, rocker: l3, from: A, ground: C, end: B, lengths_m: [{}, {}], branch: {}}}"
SLIDER = (
    "{{type: rrp_dyad, rod: l2, slider: l3, from: A, end: B, tip: T, lengths_m: [{}, 0.03], guide_point_m: [0, 0],"
    " guide_direction: [1, 0]}}"
)


def write(folder: Path, crank: float, ground: float, group: str, more: str = "") -> Path:
    path = folder / "linkage.yaml"
    path.write_text(
        f"points: {{O: [0, 0], C: [{ground}, 0]}}\n"
        f"groups:\n  - {{type: crank, name: l1, at: O, end: A, length_m: {crank}}}\n  - {group}\n"
        f"bodies: {{l1: {{mass_kg: 1, centroid: [0.7, 0.2]}}, l2: {{mass_kg: 1}}, l3: {{mass_kg: 1}}}}\n{more}"
    )
    return path


@pytest.mark.parametrize(
    ("crank", "ground", "group", "angles", "kind", "mend"),
    [
        (0.1, 0.3, DYAD.format(0.3, 0.1, "left"), (0, 180, 360), "change", "'left_passing' or 'right_passing'"),
        (0.1, 0.3, DYAD.format(0.1, 0.3, "right"), (0, 180, 360), "change", "branch 'left_passing' passes"),
        (0.1, 0.4, DYAD.format(0.2, 0.3, "left"), (180,), "change", "other lengths"),
        (0.2, 0.1, SLIDER.format(0.2), (90, 270), "dead", "other lengths"),
    ],
    ids=["parallelogram", "kite", "in line once a turn", "rod as long as the crank"],
)
def test_a_dead_point_is_reported(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    crank: float,
    ground: float,
    group: str,
    angles: tuple[float, ...],
    kind: str,
    mend: str,
) -> None:
    path = write(tmp_path, crank, ground, group)
    outputs = ["--out", str(tmp_path / "turn.csv"), "--png", str(tmp_path / "turn.png")]
    assert main(["simulate", str(path), "--rpm", "60", "--samples", "5", *outputs]) == 0
    lines = [line for line in capsys.readouterr().err.splitlines() if "nan" not in line]
    assert len(lines) == 1 and f"comes to a {kind} point" in lines[0] and mend in lines[0]
    found = float(re.search(r"angle of ([\d.]+) deg", lines[0])[1])  # type: ignore[index]
    assert min(abs(found - angle) for angle in angles) < 1e-3


@pytest.mark.parametrize(
    ("group", "more"),
    [
        (DYAD.format(0.3, 0.1, "left_passing"), ""),
        (DYAD.format(0.3, 0.1, "right_passing"), ""),
        (DYAD.format(0.3, 0.1, "left"), "range_rad: [0.3, 2.8]\n"),
        (DYAD.format(0.3, 0.1000001, "left"), ""),
    ],
    ids=["one", "crossed", "within the half turn", "nearly"],
)
def test_passing_and_distant_dead_points_are_not_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], group: str, more: str
) -> None:
    path = write(tmp_path, 0.1, 0.3, group, more)
    assert main(["machines", str(path)]) == 0
    assert capsys.readouterr().err == ""


def test_the_published_machines_have_none(capsys: pytest.CaptureFixture[str]) -> None:
    examples = sorted(map(str, (Path(__file__).parents[2] / "examples").glob("*.yaml")))
    assert len(examples) > 3
    for name in (*machines.NAMES, *examples):
        assert main(["machines", name]) == 0
    assert capsys.readouterr().err == ""
