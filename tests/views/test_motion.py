"""Tests of the motion views: every linkage, live and recorded, with the same numbers."""

from __future__ import annotations

import math
import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import textile_twin_core as ttc
from tests.views.conftest import START_NS, rows_of, scalars_of
from textile_twin_core.cli.main import main
from textile_twin_core.machine import Machine
from textile_twin_core.recordings import BagWriter
from textile_twin_core.views import LiveView, write_motion_recording
from textile_twin_core.views.measure_curves import marks_for, phase_rows_for

SPEED = 31.4
STAMPS = START_NS + np.arange(1500) * 2_000_000
THETA = SPEED * 2e-3 * np.arange(1500) + 0.4


def gear_loom() -> Machine:
    machine = ttc.machines.elliptic_gear_beatup()
    assert isinstance(machine, Machine) and not machine.has_complete_torque
    return machine


def check(path: Path) -> None:
    """Check the recording against the linkage."""
    times, sley = scalars_of(path, "/travel/sley")
    np.testing.assert_allclose(times, (STAMPS - START_NS) * 1e-9, atol=1e-9)
    assert np.ptp(sley) == pytest.approx(85.0, abs=0.05)  # the fourth paper's stroke [mm]
    _, speed = scalars_of(path, "/speed/shaft")
    np.testing.assert_allclose(speed, SPEED * 30.0 / math.pi, rtol=1e-9)
    _, states = rows_of(path, "/phase/sley_beat", "StateChange:state")
    order = ["dwell", "forward", "beat-up", "back"]
    places = [order.index(state[0]) for state in states]
    assert all((b - a) % 4 == 1 for a, b in pairwise(places))
    assert len(places) == pytest.approx(4 * np.ptp(THETA) / (2 * math.pi), abs=2)
    times, _ = rows_of(path, "/world/base/links/gear_1", "Transform3D:quaternion")
    assert 150 < times.size < 400
    _, texts = rows_of(path, "/summary", "TextDocument:text")
    assert f"{SPEED * 30.0 / math.pi:.1f} rpm" in str(texts[-1][0])


def test_of_a_recording(tmp_path: Path) -> None:
    write_motion_recording(tmp_path / "m.rrd", gear_loom(), STAMPS, THETA, title="a test")
    check(tmp_path / "m.rrd")


def test_live(tmp_path: Path) -> None:
    with LiveView(gear_loom(), port=None, path=tmp_path / "live.rrd", flush_s=0.02) as view:
        for first in range(0, STAMPS.size, 70):
            part = slice(first, first + 70)
            view.add_motion(STAMPS[part], np.mod(THETA[part], 2 * math.pi))
        view.say("WARN", "needle side: force changed by +20 %")
    assert view.error is None and view.dropped == 0
    check(tmp_path / "live.rrd")
    times, texts = rows_of(tmp_path / "live.rrd", "/events", "TextLog:text")
    assert times[0] == pytest.approx((STAMPS[-1] - START_NS) * 1e-9) and "needle side" in texts[0][0]


def test_dwell_and_beat_up_are_where_the_paper_has_them() -> None:
    (row,) = phase_rows_for(gear_loom())
    begins = {state: math.degrees(angle) for angle, state in row.begins}
    # The printed dwell is 92 .. 285 degrees, within 7 mm of the rear: 5 % of the stroke is 4.25 mm.
    assert 92.0 < begins["dwell"] < 125.0 and 255.0 < begins["forward"] < 285.0
    assert [name for name, _ in marks_for(gear_loom())] == ["beat-up"]
    assert {row.name for row in phase_rows_for(ttc.machines.tufting())} == {"needle_backing", "needle_stroke"}


@pytest.mark.parametrize("machine", ["elliptic_gear_beatup", "needle_transfer", "tufting"])
def test_a_recording_of_the_angle_alone_is_drawn(machine: str, tmp_path: Path) -> None:
    bag = tmp_path / "angle"
    with BagWriter(bag) as out:
        out.write_joint_states("main_shaft/angle", STAMPS[:700], ["main_shaft"], np.mod(THETA[:700], 2 * math.pi))
    drawn = tmp_path / "drawn.rrd"
    assert main(["replay", str(bag), "--machine", machine, "--rrd", str(drawn)]) == 0
    entity = {"elliptic_gear_beatup": "/travel/sley", "needle_transfer": "/position/element_1"}.get(machine, "")
    times, _ = scalars_of(drawn, entity) if entity else scalars_of(drawn, "/torque/predicted", "Measurements:values")
    assert times.size == 698


def test_a_replay_without_any_output_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", "bags/none", "--machine", "tufting"]) == 2
    assert "--out or --rrd is missing" in capsys.readouterr().err


def test_a_sley_that_swings_in_its_dwell_beats_once(tmp_path: Path) -> None:
    """Check a cam with a small lift in its dwell against one with two full lifts: only full strokes are beats."""
    text = (Path(__file__).parents[2] / "examples" / "cam_loom.yaml").read_text()
    start = text.index("strokes: [")
    strokes = text[start : text.index("]}", start) + 1]
    lifts = "{{start_rad: 0.3, turn_rad: 0.8, to: {lift}}}, {{start_rad: 1.1, turn_rad: 0.8, to: 0}}"
    beat = "{start_rad: 2.5, turn_rad: 1.0, to: 0.2}, {start_rad: 3.6, turn_rad: 1.5, to: 0}"
    path = tmp_path / "cam.yaml"
    for lift, beats in (("0.03", [3.6]), ("0.2", [1.1, 3.6])):
        path.write_text(text.replace(strokes, f"strokes: [{lifts.format(lift=lift)}, {beat}]"))
        machine = ttc.load_machine(path)
        assert isinstance(machine, Machine)
        assert sum(event.name == "beater_largest" for event in machine.events()) == 2
        assert [angle for _, angle in marks_for(machine)] == pytest.approx(beats, abs=0.01)


def test_a_gap_keeps_its_turns_and_no_line_goes_over_it(tmp_path: Path) -> None:
    """Drop half a second, in which the shaft makes two and a half turns."""
    machine = gear_loom()
    kept = (np.arange(1500) < 500) | (np.arange(1500) >= 750)
    path = tmp_path / "gap.rrd"
    write_motion_recording(path, machine, STAMPS[kept], THETA[kept], title="a test")
    times, sley = scalars_of(path, "/travel/sley")
    np.testing.assert_allclose(times[np.isnan(sley)], [0.999, 1.499], atol=1e-6)
    _, speed = scalars_of(path, "/speed/shaft")
    np.testing.assert_allclose(speed, SPEED * 30.0 / math.pi, rtol=1e-9)
    _, texts = rows_of(path, "/summary", "TextDocument:text")
    last = dict(re.findall(r"\| (.+?) \| ([\d.]+)", str(texts[-1][0])))
    assert float(last["turns"]) == pytest.approx(SPEED * float(last["time"]) / (2.0 * math.pi), abs=0.5)
