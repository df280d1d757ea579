"""Unit of the torque in a recording, by name as in `import`, or as a number."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.campaign import more
from textile_twin_core.cli.main import main

BAG = str(Path(__file__).parents[2] / "bags" / "tufting_160rpm_synthetic")


@pytest.mark.parametrize("unit", ["N cm", *more("Ncm", "0.01")])
def test_it_is_taken_by_name_and_by_number(unit: str, tmp_path: Path) -> None:
    out = tmp_path / "out.json"
    assert main(["compare", BAG, "--machine", "tufting", "--torque-unit", unit, "--json", str(out)]) == 0
    assert json.loads(out.read_text())["torque"]["gain"] == pytest.approx(0.0101, rel=1e-3)


def test_an_unknown_unit_lists_the_known_ones(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compare", BAG, "--machine", "tufting", "--torque-unit", "lb"]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "N cm, N mm" in said and "or N m of one unit, not 'lb'" in said
