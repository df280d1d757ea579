"""Recordings with samples stamped on arrival: the reports of compare and replay."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import textile_twin_core as ttc
from tests.campaign import more
from tests.comparison.burst_judge import judged
from tests.generators.bridged_samples import FRICTION_NM, LAG_S, Sampled, bridged, sampled, write_samples
from textile_twin_core.cli.main import main
from textile_twin_core.comparison.cause import NOT_JUDGED
from textile_twin_core.recordings import open_bag

MACHINE = ttc.machines.tufting()
SYNTHETIC = Path(__file__).parents[2] / "bags" / "tufting_160rpm_synthetic"


def usb_bridge(inside_s: float) -> Sampled:
    """Delay three thousand samples of the synthetic recording as a USB serial bridge with 16 ms latency does."""
    bag = open_bag(SYNTHETIC)
    angles, torque = bag.read_angles(), bag.read_torques()
    begin, end = angles.stamps[[2000, 4999]]
    inside = (torque.stamps >= begin) & (torque.stamps <= end)
    stamps = [angles.stamps[2000:5000], torque.stamps[inside]]
    times = [(each - begin) * 1e-9 + 0.7e-3 for each in stamps]
    right = Sampled(times[0], angles.angles_rad[2000:5000], times[1], torque.torque_Nm[inside], *stamps)
    return bridged(right, 0.016, inside_s)


@pytest.mark.campaign
@pytest.mark.slow
@pytest.mark.parametrize("inside_s", [5e-4, *more(2e-4)])
def test_a_usb_bridge_is_the_only_cause_named(
    inside_s: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = write_samples(tmp_path / "bag", usb_bridge(inside_s))
    assert main(["compare", str(bag), "--machine", "tufting", "--json", str(tmp_path / "c.json")]) == 0
    capsys.readouterr()
    found = json.loads((tmp_path / "c.json").read_text())
    assert [cause["cause"] for cause in found["verdict"]] == ["stamps_in_bursts", "unmodelled_friction"]
    assert found["verdict"][1]["value"] == pytest.approx(0.32, abs=0.03)
    assert found["torque"]["delay_s"] == pytest.approx(0.002, abs=3e-4)
    assert found["torque"]["delay_sigma_s"] > 3e-4
    assert found["torque"]["rms_error_Nm"] < 0.6

    assert main(["replay", str(bag), "--machine", "tufting", "--out", str(tmp_path / "out")]) == 0
    assert capsys.readouterr().err.count("\n") == 2  # a line for each topic
    replayed = open_bag(tmp_path / "out")
    residual = replayed.read_torques("balancing_torque/residual")
    assert np.sqrt(np.mean(residual.torque_Nm**2)) < 1.0  # 1.66 with correct stamps and no delay
    assert set(replayed.read_torques("balancing_torque/predicted").stamps) <= set(replayed.read_angles().stamps)
    assert set(residual.stamps) <= set(replayed.read_torques().stamps)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "samples"),
    [
        ("both", bridged(sampled(500.0, 9.0, run_up_s=3.0), 0.0163, 2e-4)),
        *more(
            ("the angle alone", bridged(sampled(500.0, 9.0, run_up_s=3.0), 0.0201, 2e-6, "angle")),
            ("the torque alone", bridged(sampled(500.0, 9.0, run_up_s=3.0), 0.016, 5e-4, "torque")),
            ("late at times", bridged(sampled(500.0, 9.0, run_up_s=3.0, lost=0.04), 0.016, 2e-4, late_s=3e-4)),
            ("busy all the time", bridged(sampled(1000.0, 9.0, run_up_s=3.0), 0.016, 5e-4)),
            ("an interval of four fifths", bridged(sampled(200.0, 9.0, run_up_s=3.0, wrapped=False), 0.004, 2e-6)),
        ),
    ],
)
def test_six_bridges(name: str, samples: Sampled) -> None:
    found = judged(samples, MACHINE)
    assert found.verdict[0].cause == "stamps_in_bursts"
    assert not NOT_JUDGED & {cause.cause for cause in found.verdict}
    assert abs(found.delay.value - LAG_S) < 2.0 * found.delay.sigma
    friction = [cause.value for cause in found.verdict if cause.cause == "unmodelled_friction"]
    assert friction == pytest.approx([FRICTION_NM], abs=0.05)


def test_samples_without_an_even_clock_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    right = sampled(500.0, 6.0)
    rng = np.random.default_rng(3)
    ragged = replace(right, angle_s=np.sort(rng.uniform(0.0, 6.0, right.angle_s.size)))
    times = np.interp(ragged.angle_s, right.angle_s, np.unwrap(right.angle))
    stamped = bridged(replace(ragged, angle=times), 0.05, 2e-6, "angle")
    bag = write_samples(tmp_path / "bag", stamped)
    assert main(["compare", str(bag), "--machine", "tufting"]) == 2
    assert capsys.readouterr().err.count("\n") == 1
