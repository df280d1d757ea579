"""One tab of the design page, message by message."""

from __future__ import annotations

import gc
import io
import json
import math
import time
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path

import ezdxf
import numpy as np
import pytest

import textile_twin_core as ttc
from tests.explore.unpack import numbers, unpack
from textile_twin_core import machines
from textile_twin_core.dynamics.loads import Backing, ForceCurve
from textile_twin_core.errors import RecordingError, TwinError
from textile_twin_core.explore import first_look as first_look_module
from textile_twin_core.explore import session as session_module
from textile_twin_core.explore.design import Design
from textile_twin_core.explore.first_look import first_look
from textile_twin_core.explore.overlay import overlay
from textile_twin_core.explore.session import PageSession
from textile_twin_core.machine import Machine
from textile_twin_core.recordings import BagWriter
from textile_twin_core.recordings.machine_topics import MachineTopics

EXAMPLES = Path(__file__).parents[2] / "examples"


def state(session: PageSession, **message: object) -> dict:  # type: ignore[type-arg]
    head, _ = unpack(session.answer(message))
    assert head["type"] == "state"
    return head


@pytest.fixture
def loom() -> PageSession:
    return PageSession(Design.of(machines.elliptic_gear_beatup()))


def test_paper_s_loom_gives_the_computed_values_with_the_printed_ones_beside(loom: PageSession) -> None:
    head = state(loom, type="hello")
    shown = {n["name"]: (n["value"], n["unit"], n["printed"]) for n in head["analysis"]["numbers"]}
    stroke, unit, printed = shown["sley_stroke_m"]
    assert stroke == pytest.approx(84.991, abs=5e-4) and (unit, printed) == ("mm", "85")
    front, unit, printed = shown["sley_front_acceleration_m_s2"]
    assert front == pytest.approx(610.82, abs=5e-3) and (unit, printed) == ("m/s²", "615.8434")
    dwell, unit, printed = shown["sley_dwell_rad"]
    assert dwell == pytest.approx(200.0, abs=0.5) and (unit, printed) == ("deg", "close to 200")
    assert any("no masses: fill in the 12 fields" in note for note in head["analysis"]["notes"])
    moved = state(loom, type="change", values={"crank_m": 41.0})
    assert not any(n["printed"] for n in moved["analysis"]["numbers"])


@pytest.mark.parametrize("name", machines.NAMES)
def test_curves_are_those_of_the_twin(name: str) -> None:
    machine = machines.create(name)
    if name == "needle_transfer":
        first_look()[0].result()
    head, floats = unpack(PageSession(Design.of(machine)).answer({"type": "hello"}))
    charts = {chart["title"]: chart for chart in head["analysis"]["charts"]}
    begin, size = next(iter(charts["Acceleration"]["curves"].values()))
    curve, theta = floats[begin : begin + size], np.arange(720) * (math.pi / 360.0)
    if name == "needle_transfer":
        run = machine.simulate(times=theta / machine.nominal_speed_rad_s)
        expected = run.accelerations[run.model.index["element_1"]]
    else:
        output = f"{machine.measures[0].name}_acceleration_m_s2"
        twin = ttc.compile(machine, [output], method="exact")
        expected = twin.evaluate(theta, np.full(720, machine.nominal_speed_rad_s), np.zeros(720))[output]
    assert curve == pytest.approx(expected, rel=1e-5, abs=1e-5 * np.abs(expected).max())


def test_reactions_and_marks_of_the_tufting_machine() -> None:
    head = state(PageSession(Design.of(machines.tufting())), type="hello")
    found = numbers(head)
    assert found["peak_torque_Nm"] == pytest.approx(17.2786, abs=1e-3)
    assert found["largest_reaction_N"] == pytest.approx(2197, abs=1)
    marks = dict(head["analysis"]["marks"])
    assert marks["entry"] == pytest.approx(21.9512, abs=1e-3) and marks["exit"] == pytest.approx(193.9262, abs=1e-3)
    assert marks["needle front"] == pytest.approx(106.9765, abs=1e-3)


def test_undo_takes_back_a_whole_drag(loom: PageSession) -> None:
    for crank in (40.5, 41.0, 41.5):
        state(loom, type="change", values={"crank_m": crank}, gesture="crank_m 1")
    head = state(loom, type="change", values={"coupler_m": 101.0}, gesture="coupler_m 2")
    assert head["can_undo"] and not head["can_redo"]
    values = [value_of(state(loom, type=kind), "crank_m") for kind in ("undo", "undo", "redo")]
    assert values == pytest.approx([41.5, 40.0, 41.5])
    assert value_of(state(loom, type="reset"), "crank_m") == pytest.approx(40.0)
    assert value_of(state(loom, type="undo"), "crank_m") == pytest.approx(41.5)


def value_of(head: dict, name: str) -> float:  # type: ignore[type-arg]
    return next(p["value"] for p in head["design"]["parameters"] if p["name"] == name)


def test_geometry_that_cannot_close_says_where_and_comes_back(loom: PageSession) -> None:
    broken = state(loom, type="change", values={"rocker_m": 60.0})
    assert broken["analysis"] is None and "it opens at a shaft angle of 4.8676 deg" in broken["problem"]
    opens = state(PageSession(Design.of(machines.tufting())), type="change", values={"l2_m": 60.0})
    assert "it opens at a shaft angle of" in opens["problem"]
    again = state(loom, type="change", values={"rocker_m": 180.0})
    assert again["problem"] == "" and numbers(again)["sley_stroke_m"] == pytest.approx(84.991, abs=5e-4)


@pytest.mark.parametrize(
    ("message", "says"),
    [
        ({"type": "nonsense"}, "does not know"),
        ({}, "does not know"),
        ({"type": "change", "values": {"crank_m": "long"}}, "must be a number"),
        ({"type": "change", "values": {"crank_m": None}}, "must be a number"),
        ({"type": "change", "values": {"crank_m": math.inf}}, "finite"),
        ({"type": "change", "values": {"beauty": 1.0}}, "no parameter"),
        ({"type": "change", "values": [1.0]}, "object"),
        ({"type": "speed", "rpm": 0.0}, "must lie between"),
        ({"type": "speed", "rpm": True}, "must be a number"),
        ({"type": "dwell", "mm": -1.0}, "positive"),
        ({"type": "machine", "name": "spinning_jenny"}, "no machine"),
        ({"type": "load", "name": "x.yaml", "text": "groups: 7"}, "x.yaml"),
        ({"type": "load", "name": "x.json", "text": "{"}, "not valid JSON"),
        ({"type": "load", "name": "x.json", "text": '{"format": "other"}'}, "not a shared design"),
        ({"type": "pick", "index": 0}, "search again"),
        ({"type": "balance", "way": "prayer"}, "lacks masses|no balancing method"),
        ({"type": "tolerance", "free": {}, "width": 0.0}, "must be positive"),
    ],
)
def test_nonsense_is_refused_and_changes_nothing(loom: PageSession, message: dict, says: str) -> None:  # type: ignore[type-arg]
    before = loom.design
    with pytest.raises(TwinError, match=says):
        loom.answer(message)
    assert loom.design is before


def test_two_designs_side_by_side(loom: PageSession) -> None:
    state(loom, type="pin", on=True)
    head = state(loom, type="change", values={"crank_m": 42.0})
    stroke = {n["name"]: n["value"] for n in head["pinned"]["numbers"]}["sley_stroke_m"]
    assert stroke == pytest.approx(84.991, abs=5e-4) and numbers(head)["sley_stroke_m"] > 87.0
    assert state(loom, type="pin", on=False)["pinned"] is None


def test_the_pinned_design_is_analysed_once_while_a_slider_moves(
    loom: PageSession, monkeypatch: pytest.MonkeyPatch
) -> None:
    analysed: list[Design] = []
    analyse = session_module.analyse

    def counted(design: Design) -> object:
        analysed.append(design)
        return analyse(design)

    monkeypatch.setattr(session_module, "analyse", counted)
    pinned = state(loom, type="pin", on=True)["pinned"]
    for step in range(5):
        head = state(loom, type="speed", rpm=100.0 + step, gesture=1)
        assert head["pinned"]["numbers"] == pinned["numbers"]
    assert len(analysed) == 1 + 5


def test_files_come_back_as_they_went(loom: PageSession, tmp_path: Path) -> None:
    state(loom, type="change", values={"crank_m": 41.0, "axis_ratio": 0.9})
    state(loom, type="speed", rpm=250.0)
    wanted = numbers(state(loom, type="hello"))
    saved = loom.file("yaml", 0.0)
    path = tmp_path / saved.name
    path.write_bytes(saved.content)
    machine = ttc.load_machine(path)
    assert machine.parameters["crank_m"] == pytest.approx(0.041)
    for kind in ("yaml", "json"):
        file = loom.file(kind, 0.0)
        other = PageSession(Design.of(machines.tufting()))
        head = state(other, type="load", name=file.name, text=file.content.decode())
        if kind == "yaml":
            head = state(other, type="speed", rpm=250.0)
        assert numbers(head) == pytest.approx(wanted, rel=1e-12)
    transfer = PageSession(Design.of(machines.needle_transfer()))
    state(transfer, type="change", values={"stroke_m": 33.0})
    again = state(loom, type="load", name="t.yaml", text=transfer.file("yaml", 0.0).content.decode())
    assert value_of(again, "stroke_m") == pytest.approx(33.0)


@pytest.mark.slow
def test_exports_can_be_read_elsewhere(loom: PageSession) -> None:
    rows = loom.file("csv", 0.0).content.decode().splitlines()
    assert len(rows) == 721 and rows[0].startswith("shaft angle [deg],Displacement: sley [mm]")
    assert loom.file("png", 1.0).content[:4] == b"\x89PNG"
    assert b"<svg" in loom.file("svg", 1.0).content
    drawing = ezdxf.read(io.StringIO(loom.file("dxf", 0.0).content.decode()))
    links = list(drawing.modelspace().query("LINE[layer=='LINKS']"))
    lengths = sorted(round((line.dxf.end - line.dxf.start).magnitude, 3) for line in links)
    assert {40.0, 100.0, 180.0, 189.5} <= set(lengths)
    assert drawing.units == 4 and len(drawing.modelspace().query("LWPOLYLINE")) >= 3
    first, second = drawing.modelspace().query("ELLIPSE[layer=='LINKS']")  # the pitch curves, which touch
    for gear in (first, second):
        assert gear.dxf.major_axis.magnitude == pytest.approx(71.233) and gear.dxf.ratio == pytest.approx(0.85)
    near = [
        math.dist(a, b)
        for a in np.array(list(first.flattening(0.01)))[:, :2]
        for b in np.array(list(second.flattening(0.01)))[:, :2]
        if abs(a[0] - b[0]) < 1.0 and abs(a[1] - b[1]) < 1.0
    ]
    assert min(near) < 0.5


def test_picker_of_a_user_s_own_is_shown_changed_and_saved(tmp_path: Path) -> None:
    first_look()[0].result()
    session = PageSession(Design.of(ttc.load_machine(EXAMPLES / "picker.yaml")))
    head, floats = unpack(session.answer({"type": "hello"}))
    begin, size = head["analysis"]["charts"][0]["curves"]["picker"]
    theta, speed = np.arange(size) * (2.0 * math.pi / size), 18.85
    run = ttc.load_machine(EXAMPLES / "picker.yaml").simulate(
        end_s=4.0 * math.pi / speed, times=(2.0 * math.pi + theta) / speed
    )
    way = 1e3 * run.positions[run.model.index["picker"]]
    assert floats[begin : begin + size] == pytest.approx(way, abs=1e-3)
    assert numbers(head)["picker_stroke_m"] == pytest.approx(np.ptp(way), rel=1e-3)
    assert {name for name, _ in head["analysis"]["marks"]} == {"rear stop hits", "strap touches", "buffer touches"}
    softer = state(session, type="change", values={"buffer.stiffness_1": 2e4, "stick.stroke_1_to_m": 165.0})
    assert numbers(softer)["stick_stroke_m"] == pytest.approx(165.0)
    assert numbers(softer)["picker_stroke_m"] != numbers(head)["picker_stroke_m"]
    faster = state(session, type="speed", rpm=190.0)
    assert numbers(faster)["stick_largest_speed_m_s"] > numbers(softer)["stick_largest_speed_m_s"]
    saved = tmp_path / "softer.yaml"
    saved.write_bytes(session.file("yaml", 0.0).content)
    again = ttc.load_machine(saved)
    assert again.pads[1].stiffness == (2e4, 0.0, 4e8) and again.driven.strokes[0].to == pytest.approx(0.165)


@pytest.mark.slow
def test_cam_of_a_user_s_own_turns_with_its_sizes_as_sliders() -> None:
    session = PageSession(Design.of(ttc.load_machine(EXAMPLES / "cam_loom.yaml")))
    head = state(session, type="hello")
    assert numbers(head)["beater_stroke_m"] == pytest.approx(300.0 * 0.2)
    assert "on sley" in next(c for c in head["analysis"]["charts"] if c["title"] == "Reactions")["curves"]
    larger = state(session, type="change", values={"beat_up_cam.base_radius_m": 65.0})
    assert numbers(larger)["beater_stroke_m"] == pytest.approx(60.0) and not larger["problem"]
    head, _ = unpack(session.answer({"type": "sensitivity", "free": {"beater.radius_m": [290, 310]}}))
    place = [n["text"] for n in head["numbers"]].index("beater stroke")
    assert head["rows"][0]["changes"][place] == pytest.approx(0.1 * 0.2)  # of a swing of 0.2 rad


def test_what_is_compared_goes_with_another_machine_and_stays_with_one_alike(loom: PageSession) -> None:
    state(loom, type="pin", on=True)
    alike = loom.file("yaml", 0.0).content.decode()
    assert state(loom, type="load", name="alike.yaml", text=alike)["pinned"]
    assert not state(loom, type="machine", name="tufting")["pinned"]


def test_sensitivity_of_the_stroke_is_the_slope_of_the_stroke(loom: PageSession) -> None:
    head, _ = unpack(loom.answer({"type": "sensitivity", "free": {"crank_m": [30, 50]}}))
    (row,) = head["rows"]
    place = [n["text"] for n in head["numbers"]].index("sley stroke")
    before = numbers(state(loom, type="hello"))["sley_stroke_m"]
    after = numbers(state(loom, type="change", values={"crank_m": 40.1}))["sley_stroke_m"]
    assert row["step"] == "0.1 mm" and row["changes"][place] == pytest.approx(after - before, rel=2e-2)


def curved() -> PageSession:
    """A tufting machine whose needles meet a force of 500 N on the way in and 200 N on the way out."""
    law = ForceCurve("cloth", "needle_position_m", (0.559, 0.565, 0.58), (500.0,) * 3, (200.0,) * 3)
    machine = machines.tufting()
    assert isinstance(machine, Machine)
    loads = tuple(load for load in machine.loads if not isinstance(load, Backing))
    return PageSession(Design.of(replace(machine, loads=(*loads, law))))


def test_a_force_curve_is_dragged_and_the_torque_follows() -> None:
    session = curved()
    dragged = {"type": "curve", "name": "cloth", "ways": {"in": [800.0] * 3, "out": [200.0] * 3}, "gesture": "cloth 1"}
    for message, force in (({"type": "hello"}, 500.0), (dragged, 800.0)):
        head, floats = unpack(session.answer(message))
        begin, size = head["curves"][0]["place"]
        place = floats[begin : begin + size].astype(np.float64) / 1e3
        slope = (np.roll(place, -1) - np.roll(place, 1)) / (4.0 * math.pi / size)
        expected = np.where(place >= 0.559, np.where(slope > 0.0, force, -200.0), 0.0) * slope
        torque = next(chart for chart in head["analysis"]["charts"] if chart["title"].startswith("Torque"))
        begin, size = torque["curves"]["loads"]
        smooth = np.abs(place - 0.559) > 1e-3  # the force steps there
        assert floats[begin : begin + size][smooth] == pytest.approx(expected[smooth], abs=2e-2)
        depth = place.max() - 0.559
        assert head["curves"][0]["work_J"] == pytest.approx([force * depth, 200.0 * depth], rel=1e-5)
    saved = session.file("yaml", 0.0).content.decode()
    again = PageSession(Design.of(machines.tufting()))
    assert state(again, type="load", name="a.yaml", text=saved)["curves"][0]["ways"]["in"] == [800.0] * 3
    for kind in ("undo", "redo", "reset"):
        forces = [500.0] * 3 if kind != "redo" else [800.0] * 3
        head = state(session, type=kind)
        assert head["curves"][0]["ways"]["in"] == forces
    assert head["curves"][0]["base"]["in"] == [500.0] * 3


@pytest.mark.parametrize(
    ("message", "says"),
    [
        ({"name": "hem", "ways": {"in": [1.0]}}, "no force curve 'hem'"),
        ({"name": "cloth", "ways": {"in": [1.0]}}, "1 values for 3 knots"),
        ({"name": "cloth", "ways": {"in": [1.0, None, 2.0]}}, "must be a number"),
        ({"name": "cloth", "ways": {"out": [1.0]}}, "ways: must be an object"),
        ({"name": "cloth", "ways": [1.0]}, "ways: must be an object"),
    ],
)
def test_forces_that_fit_no_curve_are_refused(message: dict, says: str) -> None:  # type: ignore[type-arg]
    with pytest.raises(TwinError, match=says):
        curved().answer({"type": "curve", **message})


def test_tolerances_give_scrap_and_spread(loom: PageSession) -> None:
    limit = {"number": "sley_stroke_m", "sense": "<=", "value": 84.991}
    message = {"type": "tolerance", "free": {"crank_m": [30, 50]}, "limits": [limit], "width": 0.1}
    head, _ = unpack(loom.answer(message))
    row = next(r for r in head["rows"] if r["text"] == "sley stroke")
    assert head["scrap"] == pytest.approx(0.5, abs=0.02)  # half the cranks are longer, and the stroke grows with them
    assert row["worst_low"] < row["low"] < row["mean"] < row["high"] < row["worst_high"]
    assert row["worst_high"] - row["nominal"] == pytest.approx(0.1 * 3.0 * row["sigma"] / 0.1, rel=0.06)


def test_balancing_makes_a_machine_of_its_own_and_undo_takes_it_back() -> None:
    session = PageSession(Design.of(machines.tufting()))
    head = state(session, type="balance", way="counterweight")
    assert "0.3936 to 0.00461 N m" in head["said"] and head["pinned"] is not None
    assert any(p["name"] == "l1#2.mass_kg" for p in head["design"]["parameters"])
    for way in ("force", "spring", "second-linkage", "flywheel"):
        assert state(session, type="balance", way=way)["said"]
    for _ in range(5):
        head = state(session, type="undo")
    assert value_of(head, "l1_m") == pytest.approx(15.0)


def test_recording_lies_over_the_torque() -> None:
    machine = machines.tufting()
    measured = overlay("bags/tufting_160rpm_synthetic", machine)
    known = np.isfinite(measured.torque_Nm)
    assert known.mean() > 0.9
    head, floats = unpack(PageSession(Design.of(machine), measured).answer({"type": "hello"}))
    begin, size = head["recording"]["torque"]
    assert floats[begin : begin + size][known] == pytest.approx(measured.torque_Nm[known], rel=1e-5, abs=1e-5)
    torque = ttc.compile(machine, ["balancing_torque_Nm"], method="exact").evaluate(
        measured.theta_rad, np.full(360, machine.nominal_speed_rad_s), np.zeros(360)
    )["balancing_torque_Nm"]
    assert np.corrcoef(torque[known], measured.torque_Nm[known])[0, 1] > 0.95


def written(path: Path, set_back_s: float = 0.0, degrees: bool = False, most_Nm: float = math.inf) -> Path:
    """Write twelve seconds of the tufting machine; the torque's clock is set back at eight."""
    time = np.arange(6000) / 500.0
    stamps, theta = 10**18 + np.rint(time * 1e9).astype(np.int64), np.mod(16.0 * time, 2.0 * np.pi)
    torque = ttc.compile(machines.tufting(), ["balancing_torque_Nm"]).evaluate(theta, 16.0, 0.0)["balancing_torque_Nm"]
    torque = np.minimum(torque + 0.02 * np.random.default_rng(3).normal(size=time.size), most_Nm)
    with BagWriter(path) as bag:
        bag.write_joint_states("main_shaft/angle", stamps, ["main_shaft"], np.degrees(theta) if degrees else theta)
        late = np.where(time > 8.0, round(set_back_s * 1e9), 0)
        bag.write_wrenches("balancing_torque/measured", stamps - late, torque)
    return path


def test_remarks_on_a_recording_are_shown_with_it(tmp_path: Path) -> None:
    machine = machines.tufting()
    right = overlay(written(tmp_path / "right"), machine)
    assert right.notes == ()
    known = np.isfinite(right.torque_Nm)
    back = overlay(written(tmp_path / "back", set_back_s=3600.0), machine)
    assert len(back.notes) == 1
    assert np.quantile(np.abs(back.torque_Nm - right.torque_Nm)[known], 0.98) < 0.1  # except at the step of the load
    bag = written(tmp_path / "degrees", degrees=True)
    assert "give --angle-unit deg" in overlay(bag, machine).notes[0]
    mended = overlay(bag, machine, MachineTopics(angle_unit_rad=math.radians(1.0)))
    assert np.quantile(np.abs(mended.torque_Nm - right.torque_Nm)[known], 0.98) < 0.1
    cut = overlay(written(tmp_path / "cut", most_Nm=12.0), machine)
    assert len(cut.notes) == 1 and np.nanmax(cut.torque_Nm) < 12.0 < np.nanmax(right.torque_Nm)
    head = state(PageSession(Design.of(machine), cut), type="hello")
    assert any(note.startswith("Recording: ") and "12 N m" in note for note in head["analysis"]["notes"])


def test_round_gears_are_drawn() -> None:
    session = PageSession(Design.of(machines.elliptic_gear_beatup(axis_ratio=1.0)))
    drawing = ezdxf.read(io.StringIO(session.file("dxf", 0.0).content.decode()))
    assert [gear.dxf.ratio for gear in drawing.modelspace().query("ELLIPSE[layer=='LINKS']")] == [1.0, 1.0]


def test_an_invalid_angle_or_ripple_is_an_error() -> None:
    session = PageSession(Design.of(machines.tufting()))
    for angle in (math.inf, math.nan, 1e308):
        with pytest.raises(TwinError, match="angle: must be a finite number"):
            session.file("png", angle)
    for ripple, words in ((0, "between 0 and 1"), ("x", "must be a number")):
        with pytest.raises(TwinError, match=words):
            session.answer({"type": "balance", "way": "flywheel", "ripple": ripple})


def test_a_standstill_does_not_distort_the_torque_of_the_turning_shaft(tmp_path: Path) -> None:
    """Record six seconds of standstill in the backing, where a still needle has no friction, then some turns."""
    machine, time = machines.tufting(), np.arange(6000) / 500.0
    stamps, speed = np.rint(time * 1e9).astype(np.int64), 16.0 * (time >= 6.0)
    theta = 0.9 + 16.0 * np.maximum(time - 6.0, 0.0)
    torque = ttc.compile(machine, ["balancing_torque_Nm"]).evaluate(theta, speed, np.zeros_like(time))
    with BagWriter(tmp_path / "bag") as bag:
        bag.write_joint_states("main_shaft/angle", stamps, ["main_shaft"], theta)
        bag.write_wrenches("balancing_torque/measured", stamps, torque["balancing_torque_Nm"])
    found = overlay(tmp_path / "bag", machine)
    there = found.torque_Nm[np.abs(np.degrees(found.theta_rad) - math.degrees(0.9)) < 5.0]
    assert there.size >= 9 and np.nanmin(there) > 10.0  # the step itself lies in one of them
    with BagWriter(tmp_path / "rest") as bag:
        bag.write_joint_states("main_shaft/angle", stamps[:2000], ["main_shaft"], theta[:2000])
        bag.write_wrenches("balancing_torque/measured", stamps[:2000], torque["balancing_torque_Nm"][:2000])
    with pytest.raises(RecordingError):
        overlay(tmp_path / "rest", machine)


def test_a_sley_that_swings_in_its_dwell_has_one_beat_up() -> None:
    text = (EXAMPLES / "cam_loom.yaml").read_text()
    start = text.index("strokes: [")
    lift = "{start_rad: 3.6, turn_rad: 0.8, to: 0.03}, {start_rad: 4.4, turn_rad: 0.8, to: 0}"
    at = text.index("]}", start)
    session = PageSession(Design.of(machines.tufting()))
    head = state(session, type="load", name="l.yaml", text=f"{text[:at]}, {lift}{text[at:]}")
    marks = [(name, round(angle)) for name, angle in head["analysis"]["marks"] if "rear" not in name]
    assert marks == [("beat-up", 92), ("beater front", 252)]


def test_shared_design_holds_what_is_searched_for(loom: PageSession) -> None:
    message = {"type": "search", "free": {"crank_m": [39, 41]}, "goals": [{"number": "sley_dwell_rad", "sense": "max"}]}
    loom.task(message)
    shared = json.loads(loom.file("json", 0.0).content)
    assert shared["task"]["free"] == {"crank_m": [39, 41]}
    other = PageSession(Design.of(machines.tufting()))
    assert state(other, type="load", name="d.json", text=json.dumps(shared))["task"]["free"]


def test_marks_and_dwell_stand_where_the_paper_has_them(loom: PageSession) -> None:
    analysis = state(loom, type="hello")["analysis"]
    marks = dict(analysis["marks"])
    assert min(marks["beat-up"], 360.0 - marks["beat-up"]) == pytest.approx(0.0, abs=1e-6)
    ((name, begin, end),) = analysis["dwells"]
    assert name == "sley dwell" and (begin, end) == pytest.approx((91.0, 291.0), abs=0.5)
    dwell = next(n["value"] for n in analysis["numbers"] if n["name"] == "sley_dwell_rad")
    assert end - begin == pytest.approx(dwell, abs=1e-9)


def test_what_is_not_compiled_yet_is_waited_for_and_all_else_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    compiling: Future[None] = Future()
    monkeypatch.setattr(first_look_module, "first_look", lambda: (compiling, time.monotonic() - 30.0))
    monkeypatch.setattr(session_module, "first_look", first_look_module.first_look)
    session = PageSession(Design.of(machines.tufting()))
    waiting = state(session, type="machine", name="needle_transfer")
    assert waiting["analysis"] is None and waiting["compiling_s"] >= 30.0 and session.awaited is compiling
    assert state(session, type="undo")["analysis"]["numbers"] and session.awaited is None
    state(session, type="redo")
    compiling.set_result(None)
    head, _ = unpack(session.state())
    assert head["compiling_s"] is None and session.awaited is None
    assert any(n["name"] == "impacts" for n in head["analysis"]["numbers"])


@pytest.mark.campaign
@pytest.mark.slow
def test_many_changes_leave_nothing_behind(loom: PageSession) -> None:
    def changed(times: int) -> int:
        for k in range(times):
            state(loom, type="change", values={"crank_m": 40.0 + 1e-3 * k}, gesture="drag")
        gc.collect()
        return len(gc.get_objects())

    changed(70)  # plans of the last 64 evaluations are cached
    before = changed(20)
    assert changed(60) - before < 500
