"""Unit of the torque in a recording, by name as in `import`, or as a number."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from tests.campaign import more
from tests.cli.test_poor_recordings import write
from tests.generators.mill_recordings import healthy, record
from textile_twin_core.cli.main import main


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> str:
    made = record(healthy("tufting", 931, run_up=False, duration_s=5.0))
    return str(write(tmp_path_factory.mktemp("recording") / "bag", replace(made, torque=100.0 * made.torque)))


@pytest.mark.parametrize("unit", ["N cm", *more("Ncm", "0.01")])
def test_it_is_taken_by_name_and_by_number(unit: str, bag: str, tmp_path: Path) -> None:
    out = tmp_path / "out.json"
    assert main(["compare", bag, "--machine", "tufting", "--torque-unit", unit, "--json", str(out)]) == 0
    assert json.loads(out.read_text())["torque"]["gain"] == pytest.approx(1.0, rel=5e-3)


def test_an_unknown_unit_lists_the_known_ones(bag: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compare", bag, "--machine", "tufting", "--torque-unit", "lb"]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "N cm, N mm" in said and "or N m of one unit, not 'lb'" in said
