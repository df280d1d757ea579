"""Logs that may mean several things: refused in one line that names the columns and an option that exists."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from tests.generators.logs import DEG, RAD, TIME, TORQUE, N, moments, table
from textile_twin_core.cli.import_log import parser
from textile_twin_core.cli.main import main
from textile_twin_core.recordings import open_bag
from textile_twin_core.recordings.log_mapping import read_mapping
from textile_twin_core.recordings.log_units import choose, unit_in_name

K = np.arange(N)
NONE = np.full(N, np.nan)
HALF = np.where(K < N // 2, 1.0, np.nan)
BACK = TIME.copy()
BACK[500] = -100.0
PLAIN = table("time,angle_rad,torque", TIME, RAD, TORQUE)
WITH_SPEED = table("time,angle_rad,torque,speed", TIME, RAD, TORQUE, np.full(N, 16.0))


def timed(head: str, times: list[str] | np.ndarray) -> str:
    return table(head, times, RAD, TORQUE)


def date(text: str) -> str:
    return table("Timestamp;angle [rad]", [text] * N, RAD, mark=";")


REFUSED: dict[str, tuple[str, list[str], str]] = {
    # columns
    "an angle without a unit": (table("time,angle,torque", TIME, TIME * 16.0, TORQUE), [], "--angle-unit"),
    "two angles": (table("time,angle_1,angle_2", TIME, RAD, RAD), [], "--angle"),
    "channels": (table("t,kanal 1,kanal 2", TIME, DEG, TORQUE), [], r"kanal 1 \(.*--angle|--angle.*kanal 1 \("),
    "a missing column": (table("time,angle", TIME, RAD), ["--torque", "moment"], "no column 'moment'"),
    "volts": (table("time,angle,torque [V]", TIME, RAD, TORQUE), [], "--torque-scale"),
    "per cent": (table("t [s],phi [deg],torque [%]", TIME, DEG, TORQUE), [], "N m"),
    "inches": (table("time_s,angle_rad,torque_in", TIME, RAD, TORQUE), [], "'in'.*--torque-scale"),
    "two torques": (table("t [s],phi [deg],a [Nm],b [Nm]", TIME, DEG, TORQUE, TORQUE), [], "--torque"),
    "a unit of nothing": (table("time,angle", TIME, RAD), ["--angle-unit", "furlong"], "furlong"),
    "counts": (table("t_s,Encoder [counts]", TIME, TIME * 500.0 // 1.0), [], "--angle-unit 4096"),
    "count": (table("t_s,Encoder [count]", TIME, TIME * 500.0 // 1.0), [], "--angle-unit 4096"),
    "inc": (table("t_s,Encoder [inc]", TIME, TIME * 500.0 // 1.0), [], "--angle-unit 4096"),
    "ticks": (table("t_s,Encoder [ticks]", TIME, TIME * 500.0 // 1.0), [], "--angle-unit 4096"),
    "mega or milli": (table("time [s],angle [rad],torque [MNM]", TIME, RAD, TORQUE), [], "MNM"),
    "megaseconds": (table("time [Ms],angle [rad]", TIME, RAD), [], "'Ms'"),
    "megaradians": (table("time [s],angle [Mrad]", TIME, RAD), [], "'Mrad'"),
    "a quantity in Mm": (table("time_s,angle_rad,c [Mm]", TIME, RAD, RAD), ["--quantity", "sley_m=c [Mm]"], "Mm"),
    "another speed": (WITH_SPEED, ["--speed", "speed", "--speed-unit", "rpm"], "9.5"),
    "a speed in furlong": (WITH_SPEED, ["--speed", "speed", "--speed-unit", "furlong"], "--speed-unit"),
    "no speed": (PLAIN, ["--speed-unit", "rpm"], "--speed"),
    "text for a torque": (table("time,angle_rad,torque", TIME, RAD, ["high"] * N), ["--torque", "torque"], "high"),
    "signs of thousands or decimals": (table("time_s;angle_rad;torque_Nm", TIME, RAD, ["1,234"] * N, mark=";"), [],
                                       "mapping"),
    "all values in one column": (
        "time;topic;value\n" + "".join(f"{0.002 * k:.3f};/a.x;{k}\n{0.002 * k:.3f};/b.y;0\n" for k in range(99)),
        ["--angle", "value", "--angle-unit", "rad"], "/a.x.*/b.y"),
    # times
    "no times": (table("angle,torque", RAD, TORQUE), [], "--rate"),
    "a count": (timed("n,angle_rad,torque_Nm", K.astype(float)), [], "--rate"),
    "samples": (timed("sample,angle_rad,torque_Nm", K.astype(float)), [], "--rate"),
    "rows by two": (timed("row,angle_rad,torque_Nm", 2.0 * K), [], "--rate"),
    "steps of one": (timed("time,angle_rad,torque_Nm", K.astype(float)), [], "--time-unit"),
    "steps of two": (timed("time,angle_rad,torque_Nm", 2.0 * K), [], "--time-unit"),
    "steps of a half": (timed("time,angle_rad,torque_Nm", 0.5 * K), [], "--time-unit"),
    "steps of a hundred": (timed("time,angle_rad,torque_Nm", 100.0 * K), [], "ms or us"),
    "steps of none": (timed("time,angle_rad,torque_Nm", ["7"] * N), [], "--rate"),
    "no time at all": (timed("time,angle_rad,torque_Nm", [f"{1.7e12 + k:.0f}" for k in K]), ["--time", "time",
                       "--time-unit", "s"], "is no time"),
    "falling": (timed("time [s],angle_rad,torque_Nm", TIME[::-1]), [], "decreases, first at row 2.*--rate"),
    "falling since 1970": (timed("time [s],angle_rad,torque_Nm", 1.7e9 + TIME[::-1]), [], "decreases, first at row 2"),
    "far before the first": (timed("time [s],angle_rad,torque_Nm", BACK), [], "row 501"),
    "an angle that rises evenly": (table("theta,torque", 16.0 * TIME, TORQUE), ["--angle", "theta", "--angle-unit",
                                   "rad"], "--time or --rate"),
    "a timer and dates apart": (table("Timestamp;time [s];angle [rad]", moments(lambda at: f"{at:%Y-%m-%d %H:%M:%S}"),
                                3.0 * TIME, RAD, mark=";"), [], "--time"),
    "3 April or March": (date("03/04/2026 10:00:00.5"), [], "03/04/2026.*2026-10-25"),
    "3-4": (date("3-4-2026 10:00:00.5"), [], "3-4-2026.*2026-10-25"),
    "a hundredth": (date("11:59:50:12"), [], "11:59:50:12.*2026-10-25"),
    "a year of two digits": (date("22/11/26 23:59:50"), [], "22/11/26.*2026-10-25"),
    "a month of 25": (date("25/25/2026 10:00:00"), [], "25/25/2026.*2026-10-25"),
    "thirteen o'clock PM": (date("13:05:00 PM"), [], "13:05:00 PM"),
    "text for dates": (table("angle [deg],torque [Nm],Datum", DEG, TORQUE, ["2.1.26 10:00"] * N), [], "2.1.26"),
    "another clock": (table("time [s],angle [deg],timestamp [s],torque [Nm]", TIME, DEG, 500.0 + TIME, TORQUE),
                      ["--time", "time [s]"], "'timestamp \\[s\\]'.*--torque-time"),
    "a rate for two clocks": (table("Time,Angle,Time,Torque", TIME, DEG, TIME + 0.05, TORQUE), ["--rate", "500"],
                              "'Time_2'"),
    # columns without common rows
    "no number of an angle": (table("time_s,angle_rad", TIME, ["nan"] * N), ["--angle", "angle_rad"], "angle_rad"),
    "no number of a torque": (table("time_s,angle_rad,M", TIME, RAD, [""] * N), ["--torque", "M"], "'M'"),
    "torque without a time": (table("time_s,angle_rad,torque_Nm", TIME * HALF, RAD, TORQUE * HALF[::-1]), [], "torque"),
    "angle without a time": (table("time_s,angle_rad,torque_Nm", TIME * HALF, RAD * HALF[::-1], TORQUE), [], "angle"),
    "second angle without a time": (table("time_s,angle_rad,b_rad", TIME * HALF, RAD, RAD * HALF[::-1]),
                                    ["--second-angle", "b_rad"], "second angle"),
    "quantity without a time": (table("time_s,angle_rad,c", TIME * HALF, RAD, RAD * HALF[::-1]),
                                ["--quantity", "sley_m=c"], "sley_m"),
    # options
    "a rate beyond": (PLAIN, ["--rate", "1e12"], "--rate"),
    "rate and time": (PLAIN, ["--rate", "500", "--time", "time"], "--rate and --time"),
    "scale and unit": (PLAIN, ["--torque-scale", "5", "--torque-unit", "Nm"], "--torque-scale and --torque-unit"),
    "a quantity's unit": (PLAIN, ["--quantity-unit", "mm"], "--quantity-unit goes with --quantity"),
    "an offset of nothing": (PLAIN, ["--torque-offset", "5"], "--torque-offset goes with --torque-log"),
    # mappings
    "an unknown key": (PLAIN, ["time: {colum: t}"], "unknown key 'colum'.*fraction"),
    "an unknown channel": (PLAIN, ["shaft: 1"], "unknown key 'shaft'"),
    "a list": (PLAIN, ["- 1"], "no keys and values"),
    "a missing column of it": (PLAIN, ["angle: {column: nowhere, unit: deg}"], "no column 'nowhere'"),
    "an incomplete form": (PLAIN, ["text: {decimal: ','}"], "it needs separator"),
    "a rate in words": (PLAIN, ["time: {column: time, rate_hz: fast}"], "time.rate_hz.*fast"),
    "a unit of nothing in it": (PLAIN, ["angle: {column: angle_rad, unit: furlong}"], "furlong"),
    "a second log without its file": (PLAIN, ["torque_log: {offset_s: 3}"], "--torque-log"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_refused_in_one_line_with_options_that_exist(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text, options, says = REFUSED[name]
    (tmp_path / "log.csv").write_text(text.replace("nan", ""), encoding="utf-8")
    if options and not options[0].startswith("--"):
        (tmp_path / "mine.yaml").write_text(options[0] + "\n")
        options = ["--mapping", str(tmp_path / "mine.yaml")]
    assert main(["import", str(tmp_path / "log.csv"), "--out", str(tmp_path / "bag"), *options]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "fault" not in said and re.search(says, said), said
    known = {option for action in parser()._actions for option in action.option_strings}
    assert set(re.findall(r"--[a-z][a-z-]+", said)) <= known, said
    assert not (tmp_path / "bag").exists()


def _with(rows: dict[int, str], text: str = PLAIN) -> str:
    """Replace lines, counted from 1."""
    lines = text.splitlines()
    for number, line in rows.items():
        lines[number - 1] = line
    return "\n".join(lines) + "\n"


REPORTED: dict[str, tuple[str, list[str], str, tuple[int, int]]] = {
    "torn rows": (_with({k: "7,8" for k in range(100, 200)}), [], "100 of 900 rows", (800, 800)),
    "a word": (_with({301: "0.6,#ERR,1"}), [], "line 301: column 'angle_rad' has '#ERR'", (899, 900)),
    "empty cells": (_with({k: f"{0.002 * k},,1" for k in range(301, 313)}), [], "12 rows without a number.*row 300",
                    (888, 900)),
    "times that go back": (table("time,angle_rad,torque", np.mod(TIME, 1.0), RAD, TORQUE), ["--time", "time"],
                           "decreases at 1 rows, first at row 501", (900, 900)),
    "times that stand": (table("time,angle_rad,torque", np.round(TIME, 2), RAD, TORQUE), [],
                         r"7\d\d rows have the time of the row before", (900, 900)),
    "degrees as radians": (table("time [s],angle [rad]", TIME, DEG), [], "--angle-unit deg", (900, 0)),
    "radians as degrees": (table("time [s],angle [deg]", TIME, RAD), [], "--angle-unit rad", (900, 0)),
    "gradians as degrees": (table("time [s],angle [grad]", TIME, DEG / 0.9), [], "--angle-unit gon", (900, 0)),
    "65536 a turn": (table("time [s],encoder", TIME, DEG / 360.0 * 65536.0 // 1.0), [],
                     "65536 a turn; a counter wraps there", (900, 0)),
    "too fast": (table("time [ms],angle [rad]", TIME, RAD), [], "2e-06 s.*--time-unit", (900, 0)),
    "too slow": (table("time [hours],angle [rad]", TIME, RAD), [], "7.2 s.*--time-unit", (900, 0)),
    "a speed of another shaft": (table("time [s],angle [rad],speed [rad/s]", TIME, RAD, np.full(N, 8.0)), [],
                                 "speed .*left out", (900, 0)),
    "a torque of words": (table("time,angle_rad,torque_Nm", TIME, RAD, ["high"] * N), [], "'torque_Nm' holds text",
                          (900, 0)),
    "a joined log": (PLAIN + PLAIN, ["--rate", "500"], "line 902: the header once more, in 1 row", (1800, 1800)),
}  # fmt: skip


@pytest.mark.parametrize("name", REPORTED)
def test_reported_in_words(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text, options, says, (angles, torques) = REPORTED[name]
    (tmp_path / "log.csv").write_text(text, encoding="utf-8")
    assert main(["import", str(tmp_path / "log.csv"), "--out", str(tmp_path / "bag"), *options]) == 0
    said = capsys.readouterr().out
    assert re.search(says, said), said
    bag = open_bag(tmp_path / "bag")
    assert len(bag.read_angles()) == angles
    assert (len(bag.read_torques()) if torques else 0) == torques


def test_rows_out_of_order_make_the_recording_of_those_in_order(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shuffled = np.argsort(np.arange(N) // 30 + np.random.default_rng(3).random(N), kind="stable")
    for name, rows in (("right", np.arange(N)), ("shuffled", shuffled)):
        text = table("time,angle_rad,torque", *(each[rows] for each in (TIME, RAD, TORQUE)))
        (tmp_path / f"{name}.csv").write_text(text, encoding="utf-8")
        assert main(["import", str(tmp_path / f"{name}.csv"), "--out", str(tmp_path / name)]) == 0
    assert "sorted by time" in capsys.readouterr().out
    right, sorted_by_time = (open_bag(tmp_path / name) for name in ("right", "shuffled"))
    np.testing.assert_array_equal(sorted_by_time.read_angles().stamps, right.read_angles().stamps)
    np.testing.assert_array_equal(sorted_by_time.read_angles().angles_rad, right.read_angles().angles_rad)
    np.testing.assert_array_equal(sorted_by_time.read_torques().torque_Nm, right.read_torques().torque_Nm)


@pytest.mark.parametrize(("unit", "turn"), [("deg", 360.0), ("rev", 1.0), ("deg", 720.0), ("rad", 3.0), ("400", 400.0)])
def test_right_units_are_not_doubted(
    unit: str, turn: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "log.csv").write_text(table("time [s],angle", TIME, DEG / 360.0 * turn))
    options = ["--angle", "angle", "--angle-unit", unit]
    assert main(["import", str(tmp_path / "log.csv"), "--out", str(tmp_path / "bag"), *options]) == 0
    assert "wraps at" not in capsys.readouterr().out


def test_rounded_readings_are_restored(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    time = np.arange(3000) / 500.0
    turns = np.rint((1.343 * time + 0.003 * np.sin(8.44 * time)) * 8192.0) / 8192.0
    cells = [f"{360.0 * (turn % 1.0):.3f}".replace(".", ",") for turn in turns]
    text = table("Zeit [s];Winkel [deg]", time, cells, mark=";", decimal=",")
    (tmp_path / "log.csv").write_text(text)
    assert main(["import", str(tmp_path / "log.csv"), "--out", str(tmp_path / "bag")]) == 0
    assert "an encoder of 8192 counts a turn" in capsys.readouterr().out
    steps = np.diff(np.unwrap(open_bag(tmp_path / "bag").read_angles().angles_rad)) * 8192.0 / (2.0 * np.pi)
    assert np.abs(steps - np.rint(steps)).max() < 1e-6


def test_a_corrected_mapping_is_followed_and_not_written_over(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The corrections: an ambiguous date, another unit, the torque in another column."""
    dates = [f"03/04/2026 10:00:0{t:.3f}" for t in TIME]
    text = table("date,kanal 1 [deg],kanal 2 [Nm],kanal 3 [Nm]", dates, DEG * 10.0, TORQUE * 0.0, TORQUE * 10.0)
    (tmp_path / "log.csv").write_text(text)
    (tmp_path / "bag.mapping.yaml").write_text(
        "text: {separator: ',', decimal: '.', names_line: 1, first_line: 2, day_first: true}\n"
        "time: {column: date, unit: date}\n"
        "angle: {column: 'kanal 1 [deg]', unit: 0.1 deg}\n"
        "torque: {column: 'kanal 3 [Nm]', scale: 0.1}\n"
        "speed: null\n"
    )
    command = ["import", str(tmp_path / "log.csv"), "--out", str(tmp_path / "bag")]
    assert main(command) == 2
    assert "--mapping" in capsys.readouterr().err
    assert main([*command, "--mapping", str(tmp_path / "bag.mapping.yaml")]) == 0
    bag = open_bag(tmp_path / "bag")
    np.testing.assert_allclose(bag.read_torques().torque_Nm, TORQUE, atol=1e-6)
    first = np.datetime64(int(bag.read_angles().stamps[0]), "ns")
    assert abs(first - np.datetime64("2026-04-03T10:00:00")) < np.timedelta64(1000, "ns")
    assert main([*command, "--force", "--angle", "kanal 1 [deg]", "--rate", "500", "--torque", "kanal 3 [Nm]"]) == 0
    assert "rate_hz: 500" in (tmp_path / "bag.mapping.yaml").read_text()


def test_a_named_column_of_times_is_read_without_the_mappings_steps(tmp_path: Path) -> None:
    """The mapping is of a log of intervals; this log of the same logger has times in another column."""
    intervals = np.diff(TIME, prepend=TIME[0])
    text = table("dt [s],stamp [ms],angle [deg],torque [Nm]", intervals, TIME * 1e3, DEG, TORQUE)
    (tmp_path / "log.csv").write_text(text)
    (tmp_path / "mine.yaml").write_text(
        "time: {column: 'dt [s]', unit: s, steps: true}\n"
        "angle: {column: 'angle [deg]', unit: deg}\ntorque: {column: 'torque [Nm]', unit: N m}\nspeed: null\n"
    )
    command = ["import", str(tmp_path / "log.csv"), "--out", str(tmp_path / "bag")]
    assert main([*command, "--mapping", str(tmp_path / "mine.yaml"), "--time", "stamp [ms]"]) == 0
    stamps = open_bag(tmp_path / "bag").read_angles().stamps
    np.testing.assert_allclose((stamps - stamps[0]) * 1e-9, TIME - TIME[0], atol=1e-6)


def test_a_name_is_not_taken_for_another() -> None:
    names = [
        "Force [N]",
        "slider_N",
        "coupler",
        "Momentanwert",
        "Capacity",
        "Facility",
        "Position [mm]",
        "nMotor",
        "fast",
    ]
    assert not any(choose(kind, names) for kind in ("time", "angle", "torque", "speed"))
    assert unit_in_name("角度（°）") == "deg" and unit_in_name("Winkelgeschwindigkeit [rad/s]") == "rad/s"
    assert choose("angle", ["Winkelgeschwindigkeit [rad/s]"]) == []


def test_a_word_far_below_that_is_no_utf_8(tmp_path: Path) -> None:
    rows = [f"{0.002 * k:.3f},{(2.0 * k) % 360:.6f},{k % 7}.123456789,ok" for k in range(8000)]
    rows[7900] = rows[7900].rpartition(",")[0] + ",gestört"
    text = "\n".join(["time [s],angle [deg],torque [Nm],state", *rows])
    for encoding in ("utf-8", "latin-1"):
        (tmp_path / "log.csv").write_bytes(text.encode(encoding))
        assert main(["import", str(tmp_path / "log.csv"), "--out", str(tmp_path / "bag"), "--force"]) == 0
        assert open_bag(tmp_path / "bag").read_torques().torque_Nm.size == 8000


def test_the_mapping_of_the_page_is_one(tmp_path: Path) -> None:
    """The example in docs/commissioning.md has known keys only."""
    page = (Path(__file__).parents[2] / "docs/commissioning.md").read_text(encoding="utf-8")
    example = next(block for block in page.split("```yaml\n")[1:] if "names_line" in block).split("```")[0]
    (tmp_path / "mine.yaml").write_text(example, encoding="utf-8")
    mapping = read_mapping(tmp_path / "mine.yaml")
    assert mapping.angle.unit == "0.1 deg" and mapping.torque.clock is not None and mapping.torque_log is not None
    assert mapping.text is not None and mapping.text.day_first and mapping.quantities["sley_position_m"].unit == "mm"
