"""Tests of the report and the machine's picture: complete, self-contained, for every machine."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import textile_twin_core as ttc
from textile_twin_core.cli.main import main
from textile_twin_core.recordings import BagWriter

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
    assert "at working speed is not in the model" in page and "the torque lags by 2.0" in page
    assert "machine: tufting" in page and "RMS error over peak" in page
    assert page.count("data:image/png;base64,") == 3 and "Orders of the shaft" in page
    assert not re.search(r'(src|href)="(?!data:)', page)


@pytest.mark.campaign
def test_a_report_of_a_recording_too_short_to_judge_has_no_sensor_estimate(tmp_path: Path) -> None:
    """Check a recording of less than a turn, which supports neither a verdict nor an estimate of the gain."""
    twin, time = ttc.compile(ttc.machines.tufting(), ["balancing_torque_Nm"]), np.arange(400) / 500.0
    stamps, still = np.rint(time * 1e9).astype(np.int64), np.zeros_like(time)
    for name, speed in (("short", 3.0), ("long", 16.0)):
        theta = 0.5 + speed * time
        with BagWriter(tmp_path / name) as bag:
            bag.write_joint_states("main_shaft/angle", stamps, ["main_shaft"], theta)
            torque = twin.evaluate(theta, still + speed, still)["balancing_torque_Nm"]
            bag.write_wrenches("balancing_torque/measured", stamps, torque)
        report = tmp_path / f"{name}.html"
        assert main(["compare", str(tmp_path / name), "--machine", "tufting", "--html", str(report)]) == 0
    short, long = ((tmp_path / f"{name}.html").read_text() for name in ("short", "long"))
    assert 'class="verdict"' in short and "nothing can be determined" in short
    assert short.count(">not identifiable<") == 3 and "1.0000, +0.0000 N m (configured)" in short
    assert not re.search(r">[^<]*\bnan\b[^<]*<", short)
    assert 'class="verdict good"' in long and "not identifiable" not in long and "(configured)" not in long
