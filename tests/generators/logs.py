"""One motion as the logs of many loggers: text of every dialect, clock and unit, five variants or more of each kind."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import datetime, timedelta
from itertools import pairwise

import numpy as np

N, STEP_S = 900, 0.002
TIME = np.arange(N) * STEP_S
ANGLE = 16.0 * TIME + 0.3 + 0.02 * np.sin(40.0 * TIME)
SPEED = 16.0 + 0.8 * np.cos(40.0 * TIME)
TORQUE = 3.0 * np.sin(2.0 * ANGLE) + 1.0
RAD, DEG = np.mod(ANGLE, 2.0 * math.pi), np.mod(np.degrees(ANGLE), 360.0)
RPM = SPEED * 30.0 / math.pi
EPOCH = 1_790_000_000
LATE_S = 0.0503
BEGIN = datetime(2026, 11, 22, 11, 59, 59)
"""A second before noon: hours of twelve turn from AM to PM in the log."""
Column = np.ndarray | list[str]


@dataclass(frozen=True)
class Form:
    """A log and how to read it: options as fields of a mapping in YAML; late_s: of the torque's stamps.

    start: stamp of the first row. no_torque: rows without a torque. speed: the log has the speed of the angle.
    within: of the angle, from its first on [rad].
    """

    text: str | bytes
    mapping: str = ""
    late_s: float = 0.0
    start: str = ""
    no_torque: tuple[int, ...] = ()
    speed: bool = False
    name: str = "log.csv"
    within: float = 1e-5


def written(column: Column, decimal: str = ".") -> list[str]:
    if isinstance(column, list):
        return column
    return [f"{value:.9f}".rstrip("0").rstrip(".").replace(".", decimal) or "0" for value in column.tolist()]


def table(head: str, *columns: Column, mark: str = ",", decimal: str = ".", end: str = "\n") -> str:
    """Text of columns below lines of a header, whose commas become the separator."""
    rows = zip(*(written(each, decimal) for each in columns), strict=True)
    lines = [*head.replace(",", mark).splitlines(), *(mark.join(row) for row in rows)]
    return end.join(lines) + end


PLAIN = (TIME, DEG, TORQUE)
USUAL = "time [s],angle [deg],torque [Nm]"


def dialects() -> Iterator[tuple[str, Form]]:
    """Separators, decimal signs, quotation marks, encodings, columns without a header."""
    for mark, decimal in ((",", "."), (";", ","), ("\t", ","), ("|", "."), ("   ", "."), (";", ".")):
        yield f"'{mark}' {decimal}", Form(table(USUAL.replace(" ", "_"), *PLAIN, mark=mark, decimal=decimal))
    yield "CRLF, ends in a separator", Form(table(USUAL + ",", *PLAIN, [""] * N, mark=";", end="\r\n"))
    quoted = [[f'"{cell}"' for cell in written(each, ",")] for each in PLAIN]
    yield "quoted decimal commas", Form(table('"Zeit [s]","Winkel [deg]","Drehmoment [Nm]"', *quoted))
    names = '"time, s","angle, shaft [deg]","torque, measured [Nm]"\n'
    yield "quoted separators", Form(names + table("", *PLAIN))
    named = "angle: {column: column_3, unit: deg}\ntorque: {column: column_2}"
    yield "no header", Form(table("", TIME, TORQUE, DEG, mark="\t", decimal=","), named)
    rate = "time: {rate_hz: 500}\nangle: {column: column_1, unit: rad}\ntorque: {column: column_2, unit: Nm}"
    yield "no header, no time", Form(table("", RAD, TORQUE, mark="   "), rate)
    minus = table(USUAL, *PLAIN, mark=";", decimal=",").replace(";-", ";\u2212")
    yield "minus signs of office programs", Form(minus)
    for sign, decimal in ((",", "."), (".", ","), ("'", "."), (" ", ","), ("\u202f", ",")):
        big = [f"{1000.0 * m:,.6f}".replace(",", "x").replace(".", decimal).replace("x", sign) for m in TORQUE]
        form = f"text: {{separator: ';', decimal: '{decimal}', thousands: \"{sign}\", names_line: 1, first_line: 2}}"
        text = table("time [s];angle [deg];torque [mNm]", TIME, DEG, big, mark=";", decimal=decimal)
        yield f"thousands '{sign}'", Form(text, form)
    german = table("Zeit [s];Winkel [°];Moment [Nm];Zustand", *PLAIN, ["läuft"] * N, mark=";", decimal=",", end="\r\n")
    for encoding in ("utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "latin-1", "cp1252"):
        yield encoding, Form(german.encode(encoding))


LANGUAGES = {
    "german": "Zeitstempel [ms],Drehwinkel [°],Antriebsmoment [Nm],Drehzahl [U/min]",
    "turkish": "Zaman [sn],Mil açısı [derece],Motor torku [Nm],Devir [d/dk]",
    "turkish capitals": "ZAMAN [sn],AÇI [derece],TORK [Nm],HIZ [d/dk]",
    "italian": "Tempo [s],Posizione albero [gradi],Coppia [Nm],Velocità [giri/min]",
    "portuguese": "Tempo [s],Ângulo [graus],Momento [Nm],Rotação [rpm]",
    "spanish": "Tiempo (s),Ángulo (grados),Par motor (N·m),Velocidad (rpm)",
    "french": "Temps [s],Angle [degrés],Couple [N.m],Vitesse [tr/min]",
    "chinese": "时间（秒）,主轴角度（度）,扭矩（N·m）,转速（转/分）",
    "traditional chinese": "時間【ms】,轉角【度】,轉矩【牛米】,轉速【r/min】",
    "controller": '"DB_Axis".Timestamp [ms],"DB_Axis".lrActPos [deg],"DB_Axis".fTorque,"DB_Axis".nSpeed [rpm]',
    "english": "Relative time [ms],Spindle Position (deg),ActTorque_Nm,Speed [1/min]",
}


def heads() -> Iterator[tuple[str, Form]]:
    """Names of columns and units, in languages, lines of their own, and comments."""
    for language, head in LANGUAGES.items():
        time = TIME * (1e3 if "ms" in head.split(",")[0] else 1.0)
        text = table(head + ",Kraft [N],Position [mm]", time, DEG, TORQUE, RPM, RPM, RPM, mark=";", end="\r\n")
        yield language, Form(text, speed=True)
        code = {"chinese": "gbk", "turkish": "cp1254", "german": "cp1252"}.get(language)
        if code:
            yield code, Form(table(head.replace("·", "."), time, DEG, TORQUE, RPM, mark=";").encode(code), speed=True)
    for head in (
        "t [s],phi [deg],[Nm]",
        "t_s,phi_deg,M_Nm",
        "t,phi,M\ns,deg,Nm",
        "t,phi,M\n[s],[deg],[Nm]",
        "t,phi,M\n(s),(deg),(Nm)",
        "Time (s),Ch1 (deg),Ch2 (Nm)",
        "Range,0,360\nTime (s),Ch1 (deg),Ch2 (Nm)",
        "Start,2026-11-22,10:00:00\nt(s),w(deg),Md(Nm)",
        "Messung 17,Halle 3\nDatum: heute\nZeit [s],Winkel [deg],Drehmoment [Nm]",
    ):
        yield head, Form(table(head, *PLAIN, mark=";"))
    for comment, mark in (("# ", ","), ("#", "\t"), ("% ", " "), ("// ", " "), ("# ", " ")):
        head = f"{comment}logger 7\n{comment}time_s,angle_deg,torque_Nm"
        yield f"names in a comment {comment}'{mark}'", Form(table(head, *PLAIN, mark=mark))
    yield (
        "keys as wide as the table",
        Form(table("Rate,500,,\nstate,t [s],phi [deg],M [Nm]", ["ON"] * N, TIME, DEG, TORQUE)),
    )
    for place in range(4):
        names, cells = USUAL.split(","), [*map(written, PLAIN)]
        names.insert(place, "state")
        cells.insert(place, ["ON" if k % 7 else "OFF" for k in range(N)])
        yield f"a column of words at {place}", Form(table(",".join(names), *cells))
    for rows, word in ((1, "#N/A"), (3, "n/a"), (300, "overflow"), (2, ""), (2, '""')):
        torque = [word if k < rows else cell for k, cell in enumerate(written(TORQUE))]
        yield f"{rows} rows '{word}'", Form(table(USUAL, TIME, DEG, torque), no_torque=tuple(range(rows)))
    yield "units of other quantities", Form(table("time [s],phi [°],torque [Nm],T [°C],torque [%]", *PLAIN, RPM, RPM))
    indexed = (
        "log_time,header.frame_id,name[0],position[0],velocity[0],effort[0]",
        "%time,field.header.frame_id,field.name0,field.position0,field.velocity0,field.effort0",
        "time,frame,name.0,position.0,velocity.0,effort.0",
        "__time,/js/frame,/js/name,/js/main_shaft/position,/js/main_shaft/velocity,/js/main_shaft/effort",
        "stamp,frame,name,position['main_shaft'],velocity['main_shaft'],effort['main_shaft']",
    )
    stamps = [str(EPOCH * 10**9 + 2_000_000 * k) for k in range(N)]
    for head in indexed:
        text = table(head, stamps, ["a"] * N, ["main_shaft"] * N, ANGLE, SPEED, TORQUE)
        yield head, Form(text, "angle: {unit: rad}", speed=True)


def units() -> Iterator[tuple[str, Form]]:
    """Units of angle and torque, parts and counts of them, given by the name or the user."""
    for angle, per_rad, torque, per_Nm in (
        ("0.1deg", 1800.0 / math.pi, "0.01 Nm", 100.0),
        ("1/10 °", 1800.0 / math.pi, "10 Ncm", 10.0),
        ("0,01 deg", 18000.0 / math.pi, "Nm", 1.0),
        ("1e-3 rad", 1e3, "100 mNm", 10.0),
        ("0.001 rev", 1e3 / (2.0 * math.pi), "0.5 lbf ft", 2.0 * 0.7375621493),
    ):
        columns = (TIME, ANGLE * per_rad, TORQUE * per_Nm)
        head = f"time\tangle [{angle}]\ttorque [{torque}]\n"
        yield f"{angle} named", Form(head + table("", *columns, mark="\t"))
        given = f"angle: {{unit: '{angle}'}}\ntorque: {{unit: {torque}}}"
        yield f"{angle} given", Form(table("time;angle;torque", *columns, mark=";"), given)
    for unit, Nm in (
        ("in-lbs", 0.1129848290), ("lb-ft", 1.355817948), ("ft·lbf", 1.355817948), ("oz-in", 0.00706155183),
        ("N·m", 1.0), ("MNm", 1e6), ("MN m", 1e6), ("MN·m", 1e6), ("mNm", 1e-3), ("mN.m", 1e-3), ("NM", 1.0),
        ("KNM", 1e3), ("V", 5.0),
    ):  # fmt: skip
        mapping = "torque: {scale: 5}" if unit == "V" else ""
        cells = [f"{m:.12g}" for m in TORQUE / Nm]
        yield unit, Form(table(f"Time (sec),Angle (Deg),Torque ({unit})", TIME, DEG, cells), mapping)
    for name, own in (("counts", True), ("count", True), ("inc", True), ("ticks", False), ("Inkremente", False)):
        turns = np.floor(np.mod(ANGLE / (2.0 * math.pi), 1.0) * 2.0**20)
        text = table(f"time [s],Encoder [{name}],torque [Nm]", TIME, turns, TORQUE)
        yield f"[{name}]", Form(text, "angle: {unit: 1048576}" if own else "")
    for bits, turn in ((16, 20_000), (24, 5_000_000), (32, 1_200_000_000)):
        for low in (0, -(2 ** (bits - 1))):
            counts = np.rint(ANGLE / (2.0 * math.pi) * turn) + 0.8 * 2.0**bits // 1.0
            shown = np.mod(counts - low, 2.0**bits) + low
            text = table("t_s,encoder,M_Nm", TIME, shown, TORQUE)
            yield (
                f"counter of {bits} bits from {low}",
                Form(text, f"angle: {{unit: {turn}}}", within=max(8.0 / turn, 1e-7)),
            )
    tenths = np.mod(np.rint(np.degrees(ANGLE) * 10.0) + 27_000.0, 2.0**16) - 2.0**15
    yield "tenths of degrees in 16 bits", Form(table("t_s,angle [0.1deg],M_Nm", TIME, tenths, TORQUE), within=1.1e-3)
    for ends in ("m", "in", "s"):
        given = "angle: {unit: rad}\ntorque: {unit: N m}"
        yield f"theta_{ends}", Form(table(f"time_s,theta_{ends},torque_m", TIME, RAD, TORQUE), given)


def moments(form: Callable[[datetime], str]) -> list[str]:
    return [form(BEGIN + timedelta(seconds=k * STEP_S)) for k in range(N)]


def _milli(at: datetime) -> str:
    return f"{at.microsecond // 1000:03d}"


def _noon(at: datetime) -> str:
    return f"{at:%I:%M:%S}.{_milli(at)} {at:%p}"


DATES: tuple[Callable[[datetime], str], ...] = (
    lambda at: f"{at:%Y-%m-%dT%H:%M:%S}.{_milli(at)}",
    lambda at: f"{at:%Y/%m/%d %H:%M:%S}.{_milli(at)}",
    lambda at: f"{at:%d.%m.%Y %H:%M:%S},{_milli(at)}",
    lambda at: f"{at:%m/%d/%Y %H:%M:%S}.{_milli(at)}",
    lambda at: f"{at:%d/%m/%Y %H:%M:%S},{_milli(at)}",
    lambda at: f"{at.month}/{at.day}/{at.year}, {_noon(at)}",
    lambda at: f"{at:%d-%m-%Y} {_noon(at).lower()}",
    lambda at: f"{at:%Y-%m-%d} {_noon(at).replace('M', '.M.')}",
    lambda at: f"{at:%Y-%m-%d %H:%M:%S}:{_milli(at)}",
    lambda at: f"{at:%m/%d/%YT%H:%M:%S}:{_milli(at)}",
    lambda at: f"{at + timedelta(hours=2):%Y-%m-%dT%H:%M:%S}.{_milli(at)}+02:00",
)
_NOON = "2026-11-22T11:59:59"


def times() -> Iterator[tuple[str, Form]]:
    """Times in units, dates, two columns, steps, and counters that pass their end."""
    k = np.arange(N)
    since = {"us": (1e6, 0.0), "ns": (1e9, 0.0), "ms since 1970": (1e3, 1.7e12), "s": (1.0, 0.0)}
    for name, (per_s, first) in since.items():
        cells = [f"{first + per_s * t:.0f}" if per_s > 1.0 else f"{t:.3f}" for t in TIME]
        yield f"{name} by their steps", Form(table("time,angle_deg,torque_Nm", cells, DEG, TORQUE))
    excel = [f"{46000.0 + t / 86400.0:.12f}" for t in TIME]
    yield "Excel's days", Form(table("time,angle_deg,torque_Nm", excel, DEG, TORQUE))
    for unit, per_s in (
        ("0.1 ms", 1e4),
        ("100us", 1e4),
        ("1/10 ms", 1e4),
        ("h", 1.0 / 3600.0),
        ("hours", 1.0 / 3600.0),
    ):
        cells = [f"{t * per_s:.12g}" for t in TIME]
        yield f"time in {unit}", Form(table(f"time [{unit}],angle_deg,torque_Nm", cells, DEG, TORQUE))
    for number, date in enumerate(DATES):
        yield (
            f"date {number}",
            Form(table("Timestamp;angle_deg;torque_Nm", moments(date), DEG, TORQUE, mark=";"), start=_NOON),
        )
    for day, clock in (
        (f"{BEGIN:%m/%d/%Y}", _noon),
        (f"{BEGIN:%d.%m.%Y}", lambda at: f"{at:%H:%M:%S}:{_milli(at)}"),
        (f"{BEGIN:%Y-%m-%d}", lambda at: f"{at:%H:%M:%S},{_milli(at)}"),
    ):
        text = table("Date;Time;angle_deg;torque_Nm", [day] * N, moments(clock), DEG, TORQUE, mark=";")
        yield f"{day} and a time of day", Form(text, start=_NOON)
    yield (
        "a date whose day is its month",
        Form(
            table(
                "when;angle_deg;torque_Nm",
                moments(lambda at: f"11/11/2026 {at:%H:%M:%S}.{_milli(at)}"),
                DEG,
                TORQUE,
                mark=";",
            ),
            start="2026-11-11T11:59:59",
        ),
    )
    night = [f"{at:%H:%M:%S}.{_milli(at)}" for at in (BEGIN + timedelta(hours=12, seconds=t) for t in TIME.tolist())]
    yield "past midnight", Form(table("Uhrzeit,angle_deg,torque_Nm", night, DEG, TORQUE))
    dated = moments(lambda at: f"{at:%Y-%m-%d %H:%M:%S}")
    timer = table("Timestamp;time [s];angle_deg;torque_Nm", dated, *PLAIN, mark=";")
    yield "a date beside a finer timer", Form(timer, "time: {column: 'time [s]'}")
    yield (
        "dates among counts",
        Form(table("logged,count,angle_deg,torque_Nm", moments(DATES[0]), k.astype(float), DEG, TORQUE), start=_NOON),
    )
    jitter = STEP_S * np.ones(N)
    for name, per_s in (("dt [ms]", 1e3), ("delta_t_us", 1e6), ("Zeitdifferenz [s]", 1.0), ("Δt (ms)", 1e3)):
        text = table(f"{name};angle_deg;torque_Nm", jitter * per_s, DEG, TORQUE, mark=";")
        yield name, Form(text, f"time: {{column: {name!r}, steps: true}}")
    stated = "time: {steps: true}"
    yield "steps stated", Form(table("time [ms];angle_deg;torque_Nm", jitter * 1e3, DEG, TORQUE, mark=";"), stated)

    def parts(per_s: int) -> tuple[list[str], list[str]]:
        whole = np.rint((0.25 + TIME) * per_s).astype(np.int64)
        return [str(EPOCH + each // per_s) for each in whole], [str(each % per_s) for each in whole]

    seconds, nanos = parts(10**9)
    echo = (
        "time: {column: column_1, fraction: column_2}\nangle: {column: column_5, unit: deg}\ntorque: {column: column_6}"
    )
    yield "ros2 topic echo --csv", Form(table("", seconds, nanos, [""] * N, ["main_shaft"] * N, DEG, TORQUE), echo)
    names = "header.stamp.sec,header.stamp.nanosec,position[0],effort[0]"
    yield "stamps of messages", Form(table(names, seconds, nanos, DEG, TORQUE))
    yield "microseconds", Form(table("tv_sec,tv_usec,angle,torque", *parts(10**6), DEG, TORQUE))
    yield "parts behind the values", Form(table("angle,torque,stamp_secs,stamp_nsecs", DEG, TORQUE, seconds, nanos))
    minute = [f"10:59:{58 + int(each) - EPOCH:02d}" if int(each) - EPOCH < 2 else "11:00:00" for each in seconds]
    day = table("Uhrzeit;ms;Winkel;Moment", minute, parts(1000)[1], DEG, TORQUE, mark=";")
    yield "time of day and ms", Form(day, "time: {column: Uhrzeit, fraction: ms}")
    for unit, bits, per_count, low in (
        ("us", 32, 1e-6, 0), ("us", 32, 1e-6, -(2**31)), ("25 us", 16, 25e-6, 0), ("ms", 16, 1e-3, -(2**15)),
        ("ns", 32, 1e-9, 0), ("ms", 32, 1e-3, 0), ("0.1 ms", 16, 1e-4, 0),
    ):  # fmt: skip
        count = np.rint(TIME / per_count) + 2.0**bits - np.rint(0.7 / per_count) - low
        shown = np.mod(count, 2.0**bits) + low
        text = table(f"clock [{unit}],angle_deg,torque_Nm", shown, DEG, TORQUE)
        yield f"clock of {bits} bits, {unit}, from {low}", Form(text, "time: {column: 'clock [" + unit + "]'}")
    seconds_of_us = np.mod(np.rint(TIME * 1e6) + 2.0**32 - 7e5, 2.0**32) * 1e-6
    yield "us shown in seconds", Form(table("time_s,angle_deg,torque_Nm", seconds_of_us, DEG, TORQUE))


def clocks() -> Iterator[tuple[str, Form]]:
    """Clocks of their own for angle and torque, and joined logs."""
    late = TIME + LATE_S
    yield (
        "same name twice",
        Form(table("Time,Angle,Time,Torque", TIME, DEG, late, TORQUE), "time: {column: Time}", LATE_S),
    )
    yield "numbered", Form(table("t1 [ms],phi [deg],t2 [ms],M [Nm]", 1e3 * TIME, DEG, 1e3 * late, TORQUE), "", LATE_S)
    yield "of pandas", Form(table("time_s,angle_deg,time_s.1,torque", TIME, DEG, late, TORQUE), "", LATE_S)
    epoch = [[f"{EPOCH + t:.6f}" for t in each] for each in (TIME, late)]
    yield "since 1970", Form(table("timestamp,encoder,timestamp,torque", epoch[0], DEG, epoch[1], TORQUE), "", LATE_S)
    head = "Zeit,Winkel,Drehzahl [rad/s],Zeit,Moment"
    yield "a speed between", Form(table(head, TIME, DEG, SPEED, late, TORQUE), "", LATE_S, speed=True)
    yield "torque first", Form(table("Time,Torque,Time,Angle", late, TORQUE, TIME, DEG), "time: {column: Time}", LATE_S)
    other = table("time [s],angle [deg],timestamp [s],torque [Nm]", TIME, DEG, 500.0 + TIME, TORQUE)
    yield "another clock of the rows", Form(other, "time: {column: 'time [s]'}\ntorque: {time: {column: 'time [s]'}}")
    joined: dict[str, tuple[str, str, Callable[[float], str]]] = {
        "Timestamp,angle,torque": (",", ".", lambda t: f"02:00:0{t:.3f}"),
        "Zeit [s];Winkel [deg];Moment [Nm]": (";", ",", lambda t: f"{t:.3f}".replace(".", ",")),
        "t\tphi\tM\ns\tdeg\tNm": ("\t", ".", lambda t: f"{t:.3f}"),
        "# time_s angle_deg torque_Nm": (" ", ".", lambda t: f"{t:.3f}"),
        "Logger 7\nRate;500\n\ntime;angle;torque": (";", ".", lambda t: f"{t:.3f}"),
    }
    for head, (mark, decimal, shown) in joined.items():
        cells = [[shown(t) for t in TIME.tolist()], written(DEG, decimal), written(TORQUE, decimal)]
        parts = [table(head, *(each[a:b] for each in cells), mark=mark) for a, b in pairwise((0, 401, 402, N))]
        yield f"joined: {head[:12]}", Form("".join(parts))
        yield f"joined, rate: {head[:12]}", Form("".join(parts), "time: {rate_hz: 500}")


def rows_by_label() -> Iterator[tuple[str, Form]]:
    """Rows that label each value, and rows of one value each."""
    ms = [f"{1e3 * t:.0f}" for t in TIME]
    rows = list(zip(ms, written(DEG), written(TORQUE), strict=True))
    for name, pattern in (
        ("plotter", "time_ms:{0},angle_deg:{1},torque_Nm:{2}"),
        ("words", "Time: {0} Position: {1} Torque: {2}"),
        ("equal signs", "t_ms={0} phi_deg={1} M_Nm={2}"),
        ("units", "Time: {0} ms; Angle: {1} deg; Torque: {2} Nm"),
        ("objects", '{{"time_ms": {0}, "joint": {{"angle_deg": {1}}}, "torque_Nm": [{2}]}}'),
        ("tabs", "time_ms:{0}\tangle_deg:{1}\ttorque_Nm:{2}"),
        ("units and spaces", "Time: {0} ms  Position: {1} deg  Torque: {2} Nm"),
        ("a label a line", "time_ms: {0}\nangle_deg: {1}\ntorque_Nm: {2}"),
    ):
        mapping = "angle: {unit: deg}\ntime: {unit: ms}" if name == "words" else ""
        yield name, Form("\n".join(pattern.format(*row) for row in rows) + "\n", mapping, name="log.txt")
    clock = [f"{at:%H:%M:%S}.{_milli(at)}" for at in (BEGIN + timedelta(seconds=t) for t in TIME.tolist())]
    for name, pattern in (
        ("a terminal's time", "[{0}] pos={1} tq={2}"),
        ("an arrow", "{0} -> Position: {1}, Torque: {2}"),
    ):
        lines = [pattern.format(stamp, *row[1:]) for stamp, row in zip(clock, rows, strict=True)]
        column = "pos" if "pos" in pattern else "Position"
        mapping = f"angle: {{column: {column}, unit: deg}}\ntorque: {{column: {'tq' if column == 'pos' else 'Torque'}}}"
        yield name, Form("\n".join(lines) + "\n", mapping, name="log.txt")
    listed = ",\n".join('{{"time_ms": {}, "angle_deg": {}, "torque_Nm": {}}}'.format(*row) for row in rows)
    yield "a list of objects", Form(f"[{listed}]\n", name="log.json")
    both = ((DEG, 0.0), (TORQUE, 0.0007))

    def signals(names: tuple[str, str], row: str) -> list[str]:
        return [
            row.format(t=TIME[k] + late, epoch=EPOCH + TIME[k] + late, name=name, value=values[k])
            for k in range(N)
            for name, (values, late) in zip(names, both, strict=True)
        ]

    paths = signals(("/js.position[0]", "/wrench.torque.z"), "{t:.4f},{epoch:.6f},,{name},{value:.7f}")
    for head, lines, mapping in (
        ("elapsed time,receive time,header.stamp,topic,value", paths, "time: {column: receive time}\n"),
        ("time;tag;value", signals(("angle", "torque"), "{t:.4f};{name};{value:.7f}"), ""),
        ("signal\tvalue\ttime [s]", signals(("Winkel", "Drehmoment"), "{name}\t{value:.7f}\t{t:.4f}"), ""),
        ("timestamp,variable,value",
         sorted(signals(("phi", "torque"), "{epoch:.6f},{name},{value:.7f}"), key=lambda row: row.split(",")[1]), ""),
        ("stamp,what,reading", signals(("encoder", "Md"), "{epoch:.6f},{name},{value:.7f}"),
         "signals: {signal: what, value: reading}\n"),
    ):  # fmt: skip
        text = "\n".join([head, *lines]) + "\n"
        yield head, Form(text, mapping + "angle: {unit: deg}", 0.0007)
    state = ["ON" if k // 50 % 3 else "OFF" for k in range(N)]
    yield (
        "a state beside a value",
        Form(table("time,state,value,torque", TIME, state, DEG, TORQUE), "angle: {column: value}"),
    )


def speeds() -> Iterator[tuple[str, Form]]:
    """Several speeds, of which one is the angle's."""
    for head, first, second in (
        ("a1 velocity [rad/s],a2 velocity [rad/s]", SPEED, -6.0 * SPEED),
        ("roller speed [rpm],shaft speed [rpm]", 40.0 * SPEED, RPM),
        ("speed set [rad/s],speed [rad/s]", np.full(N, 16.0), SPEED),
        ("Drehzahl [rpm],omega [deg/s]", 0.5 * RPM, np.degrees(SPEED)),
        ("velocity[0],velocity[1]", SPEED, 3.0 * SPEED),
    ):
        text = table(f"time [s],angle [rad],torque [Nm],{head}", TIME, RAD, TORQUE, first, second)
        yield head, Form(text, speed=True)
        yield f"{head} not wanted", Form(text, "speed: null")


def scope(
    times: list[np.ndarray], decimal: str = ",", mark: str = "\t", lines: tuple[str, ...] = (), end: str = ""
) -> str:
    """Export of TwinCAT Scope: the angle beside the first times, the torque beside the last; a part of its lines."""
    blocks = ("Name", "SymbolComment", "Data-Type", "SampleTime[ms]", "VariableSize", "SymbolBased", "Unit", "Offset")
    angle = ("Winkel Hauptwelle", "", "REAL64", "2", "8", "True", "deg (Angle)", "0")
    torque = ("fMotorTorque", "", "REAL32", "2", "4", "True", "(None)", "0")
    cells = [blocks, angle, *([blocks] if len(times) > 1 else []), torque]
    head = ["Name\tscope", "File\tC:\\scope.csv", "Starttime of export\t132959733843760000\tMontag, 2. Mai 2022", ""]
    channels = [mark.join(line) for line in zip(*cells, strict=True)]
    kept = [line.replace("\t", mark) for line in head[2 if lines else 0 :]] + channels
    kept = [line for line in kept if not lines or line.startswith(lines)]
    columns = [times[0], DEG, *times[1:], TORQUE]
    body = table("", *columns, mark=mark, decimal=decimal, end="\r\n")
    return "\r\n".join([*kept, "", ""]) + body + end


def makers() -> Iterator[tuple[str, Form]]:
    """Exports of TwinCAT Scope and LabVIEW."""
    ms = TIME * 1e3
    for decimal, mark, end in ((",", "\t", ""), (".", "\t", "EOF\r\n"), (",", ";", ""), (".", ",", "")):
        for count in (1, 2):
            yield f"scope {decimal} '{mark}' {count}", Form(scope([ms] * count, decimal, mark, (), end))
    few = (("Starttime", "Name"), ("Starttime", "Name", "Unit"), ("Name",))
    for lines in few:
        mapping = "" if "Unit" in lines else "angle: {unit: deg}"
        yield f"scope with {lines}", Form(scope([ms] * 2, ".", "\t", lines), mapping)
    yield "scope, two clocks", Form(scope([ms, ms + 0.4], "."), "", 0.4e-3)
    body = scope([ms], ".")
    head, _, rows = body.rpartition("\r\n\r\n")
    ticks = [
        f"{132_959_733_843_760_000 + 20_000 * k}{row[row.index(chr(9)) :]}" for k, row in enumerate(rows.splitlines())
    ]
    yield "scope, full stamps", Form(head + "\r\n\r\n" + "\r\n".join(ticks), start="2022-05-02T13:56:24.376")
    expo = [f"{2.0 * k:.6E}{row[row.index(chr(9)) :]}" for k, row in enumerate(rows.splitlines())]
    yield "scope, exponents", Form(head + "\r\n\r\n" + "\r\n".join(expo))
    for columns, point, mark in (
        ("One", ".", "\t"), ("One", ",", "\t"), ("Multi", ".", "\t"), ("Multi", ",", "\t"), ("No", ".", "\t"),
        ("No", ",", "\t"), ("No", ".", ","),
    ):  # fmt: skip
        step = f"0{point}002000"
        keys = [
            ("LabVIEW Measurement",), ("Writer_Version", "2"), ("Separator", "Comma" if mark == "," else "Tab"),
            ("Decimal_Separator", point), ("Multi_Headings", "Yes"), ("X_Columns", columns), ("Date", "2026/07/22"),
            ("Time", f"17:18:18{point}938945770263671875"), ("***End_of_Header***",), ("",),
        ]  # fmt: skip
        block = [
            ("Channels", "2", "", ""), ("Samples", "300", "300", ""), ("Date", "2026/07/22", "2026/07/22", ""),
            ("X_Dimension", "Time", "Time", ""), ("X0", f"0{point}0E+0", f"0{point}0E+0", ""),
            ("Delta_X", step, step, ""), ("***End_of_Header***", "", "", ""),
        ]  # fmt: skip
        names = ["X_Value", "Angle (deg)", *(["X_Value"] if columns == "Multi" else []), "Torque", "Comment"]
        cells: list[Column] = {"One": [*PLAIN], "Multi": [TIME, DEG, TIME, TORQUE], "No": [[""] * N, DEG, TORQUE]}[
            columns
        ]
        begin = "\r\n".join(mark.join(row) for row in keys) + "\r\n"
        again = "\r\n".join(mark.join(row) for row in [*block, names]) + "\r\n"
        cuts = (0, N) if columns == "No" else (0, 3, 8, N)
        parts = [
            table("", *(each[a:b] for each in cells), mark=mark, decimal=point, end="\r\n") for a, b in pairwise(cuts)
        ]
        yield f"LabVIEW {columns} {point} '{mark}'", Form(begin + again + ("\r\n" + again).join(parts), name="log.lvm")


FORMS: dict[str, Form] = {
    f"{kind.__name__}: {name}": form
    for kind in (dialects, heads, units, times, clocks, rows_by_label, speeds, makers)
    for name, form in kind()
}
