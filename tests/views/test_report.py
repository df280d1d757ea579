"""The report and the machine's picture: complete, self-contained, and drawn of every machine."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from textile_twin_core.cli.main import main

PNG = b"\x89PNG\r\n"


@pytest.mark.parametrize(
    "machine", ["tufting", "needle_transfer", "elliptic_gear_beatup", "examples/six_bar_loom.yaml"]
)
def test_every_machine_is_drawn_before_there_is_a_recording(machine: str, tmp_path: Path) -> None:
    picture = tmp_path / "machine.png"
    assert main(["simulate", machine, "--png", str(picture), "--rpm", "120"]) == 0
    assert picture.read_bytes().startswith(PNG) and picture.stat().st_size > 30_000


def test_simulate_without_any_output_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", "tufting", "--rpm", "100", "--samples", "4"]) == 2
    assert "--png" in capsys.readouterr().err


@pytest.mark.slow
def test_the_report_holds_verdict_numbers_and_pictures_and_nothing_from_outside(tmp_path: Path) -> None:
    report = tmp_path / "report.html"
    bag = "bags/tufting_160rpm_synthetic"
    assert main(["compare", bag, "--machine", "tufting", "--html", str(report)]) == 0
    page = report.read_text()
    assert "friction of about" in page and "the torque lags by 2.0" in page
    assert "machine: tufting" in page and "RMS error over peak" in page
    assert page.count("data:image/png;base64,") == 2
    assert not re.search(r'(src|href)="(?!data:)', page)
