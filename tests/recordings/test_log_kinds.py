"""Logs of users, five of each kind: clocks in several columns, joined logs, indices in names, long form."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from textile_twin_core.arrays import FloatArray
from textile_twin_core.cli.main import main
from textile_twin_core.recordings import open_bag
from textile_twin_core.recordings.log_mapping import read_mapping

N = 1200
EPOCH = 1_790_000_000.25
TIME = np.arange(N) * 0.002
ANGLE = 16.0 * TIME + 0.3 + 0.02 * np.sin(40.0 * TIME)
SPEED = 16.0 + 0.8 * np.cos(40.0 * TIME)
TORQUE = 3.0 * np.sin(2.0 * ANGLE) + 1.0
DEG = np.mod(np.degrees(ANGLE), 360.0)
LATE_S = 0.0503
Row = Callable[[int], str]


def table(head: str, row: Row, rows: int = N) -> str:
    return "\n".join([*([head] if head else []), *(row(k) for k in range(rows))]) + "\n"


def imported(tmp_path: Path, text: str, *options: str, code: int = 0, name: str = "log.csv") -> Path:
    (tmp_path / name).write_text(text, encoding="utf-8")
    bag = tmp_path / "bag"
    assert main(["import", str(tmp_path / name), "--out", str(bag), *options]) == code
    return bag


def check(bag: Path, torque_late_s: float = 0.0, angle_late_s: float = 0.0, rows: int = N) -> None:
    """Compare angle and torque, at their own times, with the logged ones."""
    angles, torques = open_bag(bag).read_angles(), open_bag(bag).read_torques()
    assert (len(angles), len(torques)) == (rows, rows)
    turned = np.mod(angles.angles_rad - ANGLE[:rows] + math.pi, 2.0 * math.pi) - math.pi
    np.testing.assert_allclose(turned, 0.0, atol=2e-6)
    np.testing.assert_allclose(torques.torque_Nm, TORQUE[:rows], atol=1e-6)
    np.testing.assert_allclose((angles.stamps - angles.stamps[0]) * 1e-9, TIME[:rows], atol=2e-6)
    between = (torques.stamps - angles.stamps) * 1e-9
    np.testing.assert_allclose(between, torque_late_s - angle_late_s, atol=2e-6)


TWO_CLOCKS = {
    "same name twice": ("Time,Angle,Time,Torque", lambda k: f"{TIME[k]:.4f},{DEG[k]:.6f},{TIME[k] + LATE_S:.4f},"),
    "numbered, milliseconds": (
        "t1 [ms],phi [deg],t2 [ms],M [Nm]",
        lambda k: f"{1e3 * TIME[k]:.1f},{DEG[k]:.6f},{1e3 * (TIME[k] + LATE_S):.1f},",
    ),
    "as pandas writes it": (
        "time_s,angle_deg,time_s.1,torque",
        lambda k: f"{TIME[k]:.4f},{DEG[k]:.6f},{TIME[k] + LATE_S:.4f},",
    ),
    "since 1970": (
        "timestamp,encoder,timestamp,torque",
        lambda k: f"{EPOCH + TIME[k]:.6f},{DEG[k]:.6f},{EPOCH + TIME[k] + LATE_S:.6f},",
    ),
    "with a speed between": (
        "Zeit,Winkel,Drehzahl [rad/s],Zeit,Moment",
        lambda k: f"{TIME[k]:.4f},{DEG[k]:.6f},{SPEED[k]:.6f},{TIME[k] + LATE_S:.4f},",
    ),
}


@pytest.mark.parametrize("name", TWO_CLOCKS)
def test_a_column_of_times_in_front_of_the_torque_is_that_of_the_torque(name: str, tmp_path: Path) -> None:
    head, row = TWO_CLOCKS[name]
    told = [] if name != "same name twice" else ["--time", "Time"]
    bag = imported(tmp_path, table(head, lambda k: f"{row(k)}{TORQUE[k]:.7f}"), *told)
    check(bag, LATE_S)


def test_torque_in_front_of_the_angle_and_the_name_of_both_clocks_given(tmp_path: Path) -> None:
    text = table(
        "Time,Torque,Time,Angle", lambda k: f"{TIME[k] + LATE_S:.4f},{TORQUE[k]:.7f},{TIME[k]:.4f},{DEG[k]:.6f}"
    )
    check(imported(tmp_path, text, "--time", "Time"), LATE_S)


@pytest.mark.parametrize("later", [0.0, 500.0])
def test_another_clock_of_the_same_rows_is_asked_about(
    later: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A second clock with another origin may be that of the torque, or another one of the row."""
    text = table(
        "time [s],angle [deg],plc clock [s],torque [Nm]",
        lambda k: f"{TIME[k]:.4f},{DEG[k]:.6f},{later + TIME[k]:.4f},{TORQUE[k]:.7f}",
    ).replace("plc clock", "timestamp")
    bag = imported(tmp_path, text, "--time", "time [s]", code=2 if later else 0)
    if later:
        said = capsys.readouterr().err
        assert "'timestamp [s]' stands between 'angle [deg]' and 'torque [Nm]'" in said and "--torque-time" in said
        bag = imported(tmp_path, text, "--time", "time [s]", "--torque-time", "time [s]")
    check(bag)


def test_a_pair_of_seconds_and_their_parts_for_each_channel(tmp_path: Path) -> None:
    def row(k: int) -> str:
        moments = [1790000000.25 + TIME[k], 1790000000.25 + TIME[k] + LATE_S]
        angle, torque = (f"{int(at)},{round(at % 1.0 * 1e6) * 1000}" for at in moments)
        return f"{angle},{DEG[k]:.6f},{torque},{TORQUE[k]:.7f}"

    check(imported(tmp_path, table("sec,nsec,angle,sec,nsec,torque", row)), LATE_S)


def test_a_rate_for_channels_with_times_of_their_own_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    head, row = TWO_CLOCKS["same name twice"]
    text = table(head, lambda k: f"{row(k)}{TORQUE[k]:.7f}")
    imported(tmp_path, text, "--rate", "500", code=2)
    assert "column 'Time_2' stands between 'Angle' and 'Torque'" in capsys.readouterr().err


JOINED = {
    "times of day": ("Timestamp,angle,torque", lambda k: f"02:00:0{TIME[k]:.3f},{DEG[k]:.6f},{TORQUE[k]:.7f}"),
    "semicolons, decimal comma": (
        "Zeit [s];Winkel [deg];Moment [Nm]",
        lambda k: f"{TIME[k]:.3f};{DEG[k]:.6f};{TORQUE[k]:.7f}".replace(".", ","),
    ),
    "units in a line of their own": (
        "t\tphi\tM\ns\tdeg\tNm",
        lambda k: f"{TIME[k]:.3f}\t{DEG[k]:.6f}\t{TORQUE[k]:.7f}",
    ),
    "a comment": ("# time_s angle_deg torque_Nm", lambda k: f"{TIME[k]:.3f} {DEG[k]:.6f} {TORQUE[k]:.7f}"),
    "lines above the names": (
        "Logger 7\nRate;500\n\ntime;angle;torque;state",
        lambda k: f"{TIME[k]:.3f};{DEG[k]:.6f};{TORQUE[k]:.7f};ON",
    ),
}


@pytest.mark.parametrize("rate", [False, True])
@pytest.mark.parametrize("name", JOINED)
def test_the_header_of_joined_logs_is_dropped_and_counted(
    name: str, rate: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    head, row = JOINED[name]
    cuts = [0, 401, 402, N]
    text = "".join(table(head, lambda k, a=a: row(a + k), b - a) for a, b in pairwise(cuts))  # type: ignore[misc]
    check(imported(tmp_path, text, *(["--rate", "500"] if rate else [])))
    assert "the header once more, in 2 rows of joined logs" in capsys.readouterr().out


INDEXED = {
    "elements of lists": "log_time,header.frame_id,name[0],position[0],velocity[0],effort[0]",
    "rostopic echo -p": "%time,field.header.frame_id,field.name0,field.position0,field.velocity0,field.effort0",
    "points": "time,frame,name.0,position.0,velocity.0,effort.0",
    "paths": "__time,/js/frame,/js/name,/js/main_shaft/position,/js/main_shaft/velocity,/js/main_shaft/effort",
    "named elements": "stamp,frame,name,position['main_shaft'],velocity['main_shaft'],effort['main_shaft']",
}


@pytest.mark.parametrize("name", INDEXED)
def test_an_index_in_a_name_is_no_unit(name: str, tmp_path: Path) -> None:
    head = INDEXED[name]
    text = table(
        head,
        lambda k: f"{1790000000250000000 + 2000000 * k},a,main_shaft,{ANGLE[k]:.9f},{SPEED[k]:.9f},{TORQUE[k]:.9f}",
    )
    bag = imported(tmp_path, text, "--angle-unit", "rad")
    check(bag)
    velocities = open_bag(bag).read_angles().velocities
    assert velocities is not None
    np.testing.assert_allclose(velocities, SPEED, atol=1e-8)


SPEEDS = {
    "two shafts": ("a1 velocity [rad/s],a2 velocity [rad/s]", (SPEED, -6.0 * SPEED), 0),
    "the other first": ("roller speed [rpm],shaft speed [rpm]", (40.0 * SPEED, SPEED * 30.0 / math.pi), 1),
    "a set value": ("speed set [rad/s],speed [rad/s]", (np.full(N, 16.0), SPEED), 1),
    "two units": ("Drehzahl [rpm],omega [deg/s]", (0.5 * SPEED * 30.0 / math.pi, np.degrees(SPEED)), 1),
    "without units": ("velocity[0],velocity[1]", (SPEED, 3.0 * SPEED), 0),
}


@pytest.mark.parametrize("wanted", [True, False])
@pytest.mark.parametrize("name", SPEEDS)
def test_of_several_speeds_the_one_with_which_the_angle_turns(name: str, wanted: bool, tmp_path: Path) -> None:
    head, columns, _ = SPEEDS[name]
    text = table(
        f"time [s],angle [rad],torque [Nm],{head}",
        lambda k: f"{TIME[k]:.3f},{ANGLE[k]:.9f},{TORQUE[k]:.9f},{columns[0][k]:.9f},{columns[1][k]:.9f}",
    )
    bag = imported(tmp_path, text, *([] if wanted else ["--speed", "none"]))
    check(bag)
    velocities = open_bag(bag).read_angles().velocities
    assert (velocities is not None) == wanted
    if velocities is not None:
        np.testing.assert_allclose(velocities, SPEED, atol=1e-6)


def parts(k: int, of_a_second: float) -> tuple[int, int]:
    whole = round((0.25 + TIME[k]) * of_a_second)
    return whole // round(of_a_second), whole % round(of_a_second)


def seconds_and(of_a_second: float, row: str) -> Row:
    def written(k: int) -> str:
        seconds, part = parts(k, of_a_second)
        return row.format(s=1790000000 + seconds, p=part, d=DEG[k], m=TORQUE[k], clock=f"10:59:{58 + seconds:02d}")

    return written


IN_TWO = {
    "ros2 topic echo --csv": ("", seconds_and(1e9, "{s},{p},,main_shaft,{d:.6f},{m:.7f}"),
                              ["--time", "column_1", "--angle", "column_5", "--torque", "column_6"]),
    "header of a message": (
        "header.stamp.sec,header.stamp.nanosec,position[0],effort[0]", seconds_and(1e9, "{s},{p},{d:.6f},{m:.7f}"), []
    ),
    "microseconds": ("tv_sec,tv_usec,angle,torque", seconds_and(1e6, "{s},{p},{d:.6f},{m:.7f}"), []),
    "time of day and milliseconds": ("Uhrzeit;ms;Winkel;Moment", seconds_and(1e3, "{clock};{p};{d:.6f};{m:.7f}"), []),
    "secs and nsecs behind the values": (
        "angle,torque,stamp_secs,stamp_nsecs", seconds_and(1e9, "{d:.6f},{m:.7f},{s},{p}"), []
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", IN_TWO)
def test_seconds_and_their_parts_in_two_columns(name: str, tmp_path: Path) -> None:
    head, row, options = IN_TWO[name]
    rows = 900 if "day" in name else N
    check(imported(tmp_path, table(head, row, rows), *options), rows=rows)


def signals(separator: str, names: tuple[str, str], row: str) -> Iterator[str]:
    for k in range(N):
        for name, value, late in zip(names, (DEG[k], TORQUE[k]), (0.0, 0.0007), strict=True):
            yield row.format(t=TIME[k] + late, epoch=EPOCH + TIME[k] + late, name=name, value=value).replace(
                ",", separator
            )


LONG = {
    "foxglove": (
        "elapsed time,receive time,header.stamp,topic,value",
        list(signals(",", ("/js.position[0]", "/wrench.torque.z"), "{t:.4f},{epoch:.6f},,{name},{value:.7f}")),
        ["--time", "receive time"],
    ),
    "tags": ("time;tag;value", list(signals(";", ("angle", "torque"), "{t:.4f},{name},{value:.7f}")), []),
    "name first": (
        "signal\tvalue\ttime [s]", list(signals("\t", ("Winkel", "Drehmoment"), "{name},{value:.7f},{t:.4f}")), []
    ),
    "sorted by signal": (
        "timestamp,variable,value",
        sorted(signals(",", ("phi", "torque"), "{epoch:.6f},{name},{value:.7f}"), key=lambda row: row.split(",")[1]),
        [],
    ),
    "columns named by the user": (
        "stamp,what,reading",
        list(signals(",", ("encoder", "Md"), "{epoch:.6f},{name},{value:.7f}")),
        ["--signal-column", "what", "--value-column", "reading"],
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", LONG)
def test_a_row_for_each_value(name: str, tmp_path: Path) -> None:
    head, rows, options = LONG[name]
    check(imported(tmp_path, "\n".join([head, *rows]) + "\n", *options, "--angle-unit", "deg"), 0.0007)


def test_the_column_of_all_values_is_no_angle(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    head, rows, options = LONG["foxglove"]
    imported(tmp_path, "\n".join([head, *rows]), *options, "--angle", "value", "--angle-unit", "rad", code=2)
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "holds the values of several signals, which 'topic' names" in said
    assert "/js.position[0]" in said and "/wrench.torque.z" in said


def test_a_state_beside_a_value_is_no_signal(tmp_path: Path) -> None:
    text = table(
        "time,state,value,torque",
        lambda k: f"{TIME[k]:.3f},{'ON' if k // 50 % 3 else 'OFF'},{DEG[k]:.6f},{TORQUE[k]:.7f}",
    )
    check(imported(tmp_path, text, "--angle", "value"))


JITTER = 0.002 + 2e-4 * np.sin(np.arange(N) * 1.7)
STEPPED = np.concatenate([[0.0], np.cumsum(JITTER[1:])])
STEPS = {
    "dt [ms]": (1e3 * JITTER, []),
    "delta_t_us": (1e6 * JITTER, []),
    "Zeitdifferenz [s]": (JITTER, []),
    "Δt (ms)": (1e3 * JITTER, []),
    "time [ms]": (1e3 * JITTER, ["--time-steps"]),
}


@pytest.mark.parametrize("name", STEPS)
def test_times_since_the_row_before_are_summed(name: str, tmp_path: Path) -> None:
    steps, options = STEPS[name]
    bag = imported(
        tmp_path,
        table(f"{name};angle;torque", lambda k: f"{steps[k]:.9f};{DEG[k]:.6f};{TORQUE[k]:.7f}"),
        *options,
    )
    stamps = open_bag(bag).read_angles().stamps
    np.testing.assert_allclose((stamps - stamps[0]) * 1e-9, STEPPED, atol=1e-6)


@pytest.mark.parametrize(
    ("angle", "per_rad", "torque", "per_Nm"),
    [
        ("0.1deg", 1800.0 / math.pi, "0.01 Nm", 100.0),
        ("1/10 °", 1800.0 / math.pi, "10 Ncm", 10.0),
        ("0,01 deg", 18000.0 / math.pi, "Nm", 1.0),
        ("1e-3 rad", 1e3, "100 mNm", 10.0),
        ("0.001 rev", 1e3 / (2.0 * math.pi), "0.5 lbf ft", 2.0 * 0.73756215),
    ],
)
@pytest.mark.parametrize("by_option", [True, False])
def test_parts_of_units(
    angle: str, per_rad: float, torque: str, per_Nm: float, by_option: bool, tmp_path: Path
) -> None:
    head = "time;angle;torque" if by_option else f"time;angle [{angle}];torque [{torque}]"
    options = ["--angle-unit", angle, "--torque-unit", torque] if by_option else []
    text = table(head, lambda k: f"{TIME[k]:.3f};{ANGLE[k] * per_rad:.7f};{TORQUE[k] * per_Nm:.8f}")
    check(imported(tmp_path, text, *options))


@pytest.mark.parametrize("unit", ["0.1 ms", "100us", "1/10 ms"])
def test_parts_of_a_millisecond(unit: str, tmp_path: Path) -> None:
    text = table(f"time [{unit}],angle,torque", lambda k: f"{20 * k},{DEG[k]:.6f},{TORQUE[k]:.7f}")
    check(imported(tmp_path, text))


MAPPED: list[tuple[str, Row, list[str]]] = [
    (*TWO_CLOCKS["same name twice"], ["--time", "Time"]),
    (*JOINED["lines above the names"], []),
    (*IN_TWO["ros2 topic echo --csv"][:2], IN_TWO["ros2 topic echo --csv"][2]),
]


@pytest.mark.parametrize("k", range(len(MAPPED)))
def test_a_mapping_reads_the_next_log_as_the_first(k: int, tmp_path: Path) -> None:
    head, row, options = MAPPED[k]
    text = table(head, row if k else lambda i: f"{row(i)}{TORQUE[i]:.7f}")
    imported(tmp_path, text, *options)
    mapping = tmp_path / "bag.mapping.yaml"
    (tmp_path / "mine.yaml").write_text(mapping.read_text(encoding="utf-8"), encoding="utf-8")
    first = open_bag(tmp_path / "bag").read_torques()
    bag = imported(tmp_path, text, "--mapping", str(tmp_path / "mine.yaml"), "--force")
    again = open_bag(bag).read_torques()
    np.testing.assert_array_equal(again.stamps, first.stamps)
    np.testing.assert_array_equal(again.torque_Nm, first.torque_Nm)


def test_a_corrected_mapping_is_followed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The corrections: an ambiguous date, another unit, the torque in another column."""
    text = table(
        "date,kanal 1 [deg],kanal 2 [Nm],kanal 3 [Nm]",
        lambda k: f"03/04/2026 10:00:0{TIME[k]:.3f},{ANGLE[k] * 1800.0 / math.pi:.6f},7,{TORQUE[k] * 10.0:.7f}",
    )
    imported(tmp_path, text, code=2)
    assert "whether the day or the month is first" in capsys.readouterr().err
    (tmp_path / "mine.yaml").write_text(
        "text: {separator: ',', decimal: '.', names_line: 1, first_line: 2, day_first: true}\n"
        "time: {column: date, unit: date}\n"
        "angle: {column: 'kanal 1 [deg]', unit: 0.1 deg}\n"
        "torque: {column: 'kanal 3 [Nm]', scale: 0.1}\n"
        "speed: null\n"
    )
    bag = imported(tmp_path, text, "--mapping", str(tmp_path / "mine.yaml"))
    check(bag)
    first = np.datetime64(int(open_bag(bag).read_angles().stamps[0]), "ns")
    assert abs(first - np.datetime64("2026-04-03T10:00:00")) < np.timedelta64(1000, "ns")


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("time: {colum: t}", "time: unknown key 'colum'; keys are column, fraction"),
        ("shaft: 1", "unknown key 'shaft'"),
        ("- 1", "no keys and values"),
        ("angle: {column: nowhere, unit: deg}", "no column 'nowhere'"),
        ("text: {separator: ','}", "text: incomplete, it needs decimal"),
        ("time: {column: time, rate_hz: fast}", "time.rate_hz: 'fast' is no float"),
        ("angle: {column: angle, unit: furlong}", "angle in 'furlong'?"),
    ],
)
def test_a_mapping_that_does_not_fit_is_one_line(
    content: str, says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mine.yaml").write_text(content + "\n")
    text = table("time,angle,torque", lambda k: f"{TIME[k]:.3f},{DEG[k]:.6f},{TORQUE[k]:.7f}")
    imported(tmp_path, text, "--mapping", str(tmp_path / "mine.yaml"), code=2)
    said = capsys.readouterr().err
    assert says in said and said.count("\n") == 1


def with_columns(*columns: FloatArray) -> Row:
    return lambda k: ",".join(f"{column[k]:.9g}" for column in columns)


def test_a_mapping_that_a_person_may_have_corrected_is_not_written_over(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = table("time,angle,torque", with_columns(TIME, DEG, TORQUE))
    (tmp_path / "bag.mapping.yaml").write_text("mine")
    imported(tmp_path, text, code=2)
    assert "bag.mapping.yaml exists; give it with --mapping, or replace it with --force" in capsys.readouterr().err
    imported(tmp_path, text, "--force")
    assert "column: angle" in (tmp_path / "bag.mapping.yaml").read_text()


def test_the_mapping_of_the_page_is_one(tmp_path: Path) -> None:
    """The example in docs/commissioning.md has known keys only."""
    page = (Path(__file__).parents[2] / "docs/commissioning.md").read_text(encoding="utf-8")
    example = next(block for block in page.split("```yaml\n")[1:] if "names_line" in block).split("```")[0]
    (tmp_path / "mine.yaml").write_text(example, encoding="utf-8")
    mapping = read_mapping(tmp_path / "mine.yaml")
    assert mapping.angle.unit == "0.1 deg" and mapping.torque.clock is not None
    assert mapping.text is not None and mapping.text.day_first and mapping.quantities["sley_position_m"].unit == "mm"
