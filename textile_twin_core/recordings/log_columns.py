"""Which column of a log is what, and in which unit: told by the user, by its name, or by its values."""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.comparison.readings import ANGLE_TURNS, angle_unit, radians_of, shown_turn
from textile_twin_core.comparison.torque_units import UNITS_PER_NM
from textile_twin_core.errors import RecordingError
from textile_twin_core.recordings.log_time import TIME_UNITS

SPEED_UNITS = {"rad/s": 1.0, "rpm": math.pi / 30.0, "deg/s": math.pi / 180.0, "rev/s": 2.0 * math.pi}
TORQUE_UNITS = {
    "N m": 1.0,
    **{name: 1.0 / count for name, count in UNITS_PER_NM.items() if " or " not in name},
    "kgf m": 9.80665,
    "daN m": 10.0,
    "mN m": 1e-3,
    "MN m": 1e6,
}
"""N m per unit."""
QUANTITY_UNITS = {
    "m": 1.0, "mm": 1e-3, "cm": 1e-2, "in": 0.0254, "rad": 1.0, "deg": math.pi / 180.0, "m/s": 1.0, "mm/s": 1e-3,
    "m/s2": 1.0, **SPEED_UNITS, "N": 1.0, "kN": 1e3,
}  # fmt: skip
"""SI units per unit of other quantities."""

# English, German, French, Italian, Spanish, Portuguese, Turkish and Chinese, as `_plain` writes them.
_WORDS = {
    "time": r"\b(time|zeit|uhrzeit|zeitstempel|t|stamp|timestamp|seconds|date|temps|horodatage|tempo|tiempo|zaman|sure"
    r"|saat)\b|时间|時間|时刻",
    "angle": r"angle|winkel|theta|encoder|position|phi|drehgeber|angolo|posizione|encodeur|codeur|angulo|posicion"
    r"|posicao|\b(pos|aci|acisi|konum|enkoder|kodlayici)\b|角|编码器|編碼器|位置",
    "torque": r"torque|moment(?!an)|\b(couple|md|tq|tork|torku|par motor)\b|coppia|扭矩|转矩|轉矩|力矩",
    "speed": r"speed|velocity|drehzahl|geschwindigkeit|omega|rpm|velocita|velocidad|vitesse|rotacao"
    r"|\b(n|giri|hiz|hizi|devir)\b|速",
}
_TURKISH = str.maketrans("İÝıý", "IIii")
"""Its letters without their dots, and what becomes of them where cp1254 is read as cp1252."""
_BRACKETS = r"[\[(（【][^\])）】]*[\])）】]"
_MILLI = ("ms", "mm", "mm/s", "mN m")
"""Units that begin with a prefix which means mega when it is written large."""
_LETTER_OF_TYPE = r"\b[a-z]{1,2}(?=[A-Z][a-z])"
"""That stands before a variable's name in a controller: fAngle, lrActPos."""
_SPELLINGS = {
    "nm": "N m", "n*m": "N m", "n·m": "N m", "n.m": "N m", "ncm": "N cm", "nmm": "N mm", "knm": "kN m",
    "danm": "daN m", "lbft": "lbf ft", "ftlb": "lbf ft", "ftlbf": "lbf ft", "lbin": "lbf in", "inlb": "lbf in",
    "lbfft": "lbf ft", "lbfin": "lbf in", "inlbf": "lbf in", "ozin": "ozf in", "inoz": "ozf in", "ozfin": "ozf in",
    "kgfcm": "kgf cm", "kgcm": "kgf cm", "kgfm": "kgf m",
    "mnm": "mN m", "kgm": "kgf m", "degree": "deg", "degrees": "deg",
    "°": "deg", "grad": "deg", "radian": "rad", "radians": "rad", "revolutions": "rev", "u": "rev", "turns": "rev",
    "sec": "s", "seconds": "s", "second": "s", "msec": "ms", "µs": "us", "μs": "us", "usec": "us", "1/min": "rpm",
    "u/min": "rpm", "min-1": "rpm", "r/min": "rpm", "min^-1": "rpm", "min⁻¹": "rpm", "1/min.": "rpm", "tr/min": "rpm",
    "giri/min": "rpm", "d/dk": "rpm", "dev/dk": "rpm", "devir/dakika": "rpm", "rot/min": "rpm", "转/分": "rpm",
    "度": "deg", "º": "deg", "gradi": "deg", "graus": "deg", "grados": "deg", "derece": "deg", "degrés": "deg",
    "弧度": "rad", "radyan": "rad", "radianti": "rad", "°/s": "deg/s", "rad/sn": "rad/s", "sn": "s", "saniye": "s",
    "h": "hours", "hr": "hours", "hrs": "hours", "hour": "hours", "stunden": "hours", "minutes": "min", "day": "days",
    "sek": "s", "秒": "s", "毫秒": "ms", "n∙m": "N m", "n⋅m": "N m", "牛米": "N m", "牛·米": "N m", "kgf·cm": "kgf cm",
    "kgf·m": "kgf m", "giri": "rev", "tours": "rev", "devir": "rev", "umdr": "rev", "圈": "rev",
}  # fmt: skip


@dataclass(frozen=True)
class Column:
    """A column that was chosen: its name and its unit ('' unknown)."""

    name: str
    unit: str


def spelled(unit: str) -> str:
    """A unit as the tables here write it; as it was where it is none that is known, or m may be milli or mega."""
    plain = unit.strip()
    known = {*TIME_UNITS, *ANGLE_TURNS, *SPEED_UNITS, *TORQUE_UNITS, *QUANTITY_UNITS}
    squeezed = {name.replace(" ", "").lower(): name for name in known if name != "MN m"}
    lower = plain.lower()
    bare = re.sub(r"[\s.*·∙⋅-]|(?<=lb)s", "", lower)
    found = _SPELLINGS.get(lower) or squeezed.get(lower.replace(" ", "")) or _SPELLINGS.get(bare) or plain
    if found not in _MILLI or plain[0] == "m":
        return found
    # A name in capitals throughout keeps no case: no machine's log has megametres, but MNM may be either.
    if found == "mN m":
        return "MN m" if plain.endswith("m") else plain
    return found if plain.isupper() else plain


def unit_in_name(name: str) -> str:
    """The unit in a column's name: 'Torque [Ncm]', 'angle (deg)', 'theta_rad', 'time_s'; '' when there is none."""
    bracket = re.search(_BRACKETS, name)
    if bracket:
        return spelled(bracket[0][1:-1])
    last = re.split(r"[_/ ]", name)[-1]
    if len(name) == 1:
        return ""  # n, t: a name of one letter is that of the quantity
    return spelled(last) if is_unit(last) and spelled(last) != name else ""


def is_unit(text: str) -> bool:
    """Whether a text is a unit that is known, in any spelling, with or without brackets."""
    bare = text[1:-1] if re.fullmatch(_BRACKETS, text) else text
    return spelled(bare) in {*TIME_UNITS, *ANGLE_TURNS, *SPEED_UNITS, *TORQUE_UNITS, *QUANTITY_UNITS}


def choose(kind: str, names: Iterable[str], unit_told: bool = False) -> list[str]:
    """Columns whose names speak of a kind: time, angle, torque or speed; where none does, angle and torque by unit.

    One in a unit of something else is none where another is left. Where none is, the end of a name may be no unit
    (theta_m), brackets (Position [mm]) are one: then none is left, unless the unit is told, or the kind is torque,
    whose column is better refused for its unit than left out.
    """
    own = {"time": TIME_UNITS, "angle": ANGLE_TURNS, "torque": TORQUE_UNITS, "speed": SPEED_UNITS}[kind]
    others = {*TIME_UNITS, *ANGLE_TURNS, *SPEED_UNITS, *TORQUE_UNITS, *QUANTITY_UNITS} - {*own}
    names = list(names)
    spoken = [name for name in names if re.search(_WORDS[kind], _plain(name))]
    if not spoken and kind in ("angle", "torque"):
        return [name for name in names if unit_in_name(name) in own and unit_in_name(name) != "rev"]
    fitting = [name for name in spoken if unit_in_name(name) not in others]
    own_unit = [name for name in fitting if unit_in_name(name) in own or not re.search(_BRACKETS, name)]
    fitting = own_unit or fitting  # T [°C] beside t [s]
    unsure = [name for name in spoken if name in fitting or not re.search(_BRACKETS, name)]
    if unit_told:
        return unsure or spoken
    return fitting or (spoken if kind == "torque" else unsure)


def _plain(name: str) -> str:
    """A column's name as plain words: without its unit, accents, letters of type and humps, in small letters."""
    bare = re.sub(_BRACKETS, " ", name).strip() or name
    bare = re.sub(r"[_ ][Nsm]$", "", bare)
    words = re.sub(r"[\W_]+", " ", re.sub(_LETTER_OF_TYPE, "", bare))
    words = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", words)
    letters = unicodedata.normalize("NFKD", words.translate(_TURKISH).lower())
    return "".join(letter for letter in letters if not unicodedata.combining(letter))


def angle_radians(column: Column, values: FloatArray) -> tuple[FloatArray, str]:
    """Radians, and the unit taken: as told, as named, or as the leaps of a wrapped angle show.

    A unit may be a number, the counts of one turn. Raises RecordingError when nothing tells it.
    """
    unit = column.unit
    if unit:
        try:
            factor = radians_of(unit)
        except ValueError:
            known = f"{', '.join(ANGLE_TURNS)}, or the counts of a turn"
            raise RecordingError(f"column '{column.name}': angle in '{unit}'? there are: {known}") from None
        words = unit if unit in ANGLE_TURNS else f"{shown_turn(float(unit))} a turn"
        return values * factor, words + _other_unit(unit, values)
    seen = angle_unit(values)
    if not seen.wrapped:
        raise RecordingError(
            f"column '{column.name}' never begins anew, so its unit cannot be seen; tell it: --angle-unit "
            f"{', '.join(ANGLE_TURNS)} or the counts of a turn"
        )
    return values * seen.to_radians, f"{seen.name}, as seen: {shown_turn(seen.turn)} a turn"


def _other_unit(unit: str, values: FloatArray) -> str:
    """What speaks against a unit that is told, in words: leaps as those of another one. Empty without any."""
    seen = angle_unit(values)
    other = next((short for short, turn in ANGLE_TURNS.items() if seen.wrapped and turn == seen.turn), "")
    if not other or math.isclose(ANGLE_TURNS[other] * radians_of(unit), 2.0 * math.pi):
        return ""
    return (
        f"; but it begins anew each {shown_turn(seen.turn)}, as {seen.name} do: if they are, tell --angle-unit {other}"
    )


def times_as_fast(stamps: IntArray, theta: FloatArray, omega: FloatArray) -> float:
    """How many times as fast an angle turns as a speed (n,) says, by least squares; 1 where it cannot be told.

    stamps [ns], theta [rad], wrapped or not, omega [rad/s].
    """
    told = 0.5 * (omega[1:] + omega[:-1]) * np.diff(stamps) * 1e-9
    turned = np.diff(theta)
    turned -= 2.0 * math.pi * np.rint(turned / (2.0 * math.pi))
    good = np.isfinite(told) & np.isfinite(turned) & (told != 0.0)
    told, turned = told[good], turned[good]
    # Too few samples a turn leave the way between two of them open.
    if not told.size or np.percentile(np.abs(turned), 95.0) > 0.5 * math.pi or np.abs(turned).sum() < 2.0 * math.pi:
        return 1.0
    return float(told @ turned / (told @ told))


def torque_newton_metres(column: Column, values: FloatArray, scale: float | None) -> tuple[FloatArray, str]:
    """N m, and the unit taken; `scale` is N m per unit, for volts and other units of one's own."""
    if scale is not None:
        return values * scale, f"{scale:g} N m per {column.unit or 'unit'}"
    unit = column.unit or "N m"
    if unit not in TORQUE_UNITS:
        raise RecordingError(
            f"column '{column.name}': torque in '{unit}'? there are: {', '.join(TORQUE_UNITS)}; for any other give"
            " --torque-scale, N m per unit"
        )
    taken = unit if column.unit else "N m (taken for granted)"
    return values * TORQUE_UNITS[unit], taken


def quantity_si(column: Column, values: FloatArray) -> tuple[FloatArray, str]:
    """A displacement, angle, speed or force in SI units, and the unit taken: as told, as named, else SI."""
    if column.unit and column.unit not in QUANTITY_UNITS:
        known = ", ".join(QUANTITY_UNITS)
        raise RecordingError(f"column '{column.name}': a quantity in '{column.unit}'? there are: {known}")
    return values * QUANTITY_UNITS.get(column.unit, 1.0), column.unit or "SI units (taken for granted)"


def looks_like_time(values: FloatArray) -> bool:
    """Whether a column rises throughout in nearly equal steps."""
    finite = values[np.isfinite(values)]
    step = np.diff(finite[:10_000])
    return finite.size > 2 and bool((step > 0.0).all()) and float(np.median(step)) > 0.2 * float(step.max(initial=0.0))


def describe(columns: Mapping[str, FloatArray]) -> str:
    """The columns with their ranges, for a person who is to choose."""
    rows = []
    for name, values in columns.items():
        finite = values[np.isfinite(values)]
        span = f"{finite.min():.6g} .. {finite.max():.6g}" if finite.size else "empty"
        rows.append(f"{name} ({span})")
    return ", ".join(rows)
