"""Units of the columns of a log in the spellings of many loggers, and the quantities that names of columns mean."""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Iterable, Mapping

from textile_twin_core.comparison.readings import ANGLE_TURNS
from textile_twin_core.inference.torque_units import UNITS_PER_NM

COUNTS = "counts"
"""Unit of an angle in counts of an encoder, whose number a turn is unknown."""
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "hours": 3600.0, "days": 86400.0}
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
_UNITS_OF = {"time": TIME_UNITS, "angle": {**ANGLE_TURNS, COUNTS: 1.0}, "torque": TORQUE_UNITS, "speed": SPEED_UNITS}
_ALL = {**TIME_UNITS, **ANGLE_TURNS, **SPEED_UNITS, **TORQUE_UNITS, **QUANTITY_UNITS, COUNTS: 1.0}

BRACKETS = r"[\[(（【][^\])）】]*[\])）】]"
_MILLI = ("ms", "mm", "mm/s", "mN m")
"""Units whose prefix means mega in upper case."""
_SPELLINGS = {
    unit: name
    for name, spellings in {
        "N m": "nm n*m n·m n.m n∙m n⋅m 牛米 牛·米", "N cm": "ncm", "N mm": "nmm", "kN m": "knm", "daN m": "danm",
        "lbf ft": "lbft ftlb ftlbf lbfft", "lbf in": "lbin inlb lbfin inlbf", "ozf in": "ozin inoz ozfin",
        "kgf cm": "kgfcm kgcm kgf·cm", "kgf m": "kgfm kgm kgf·m", "mN m": "mnm",
        "deg": "degree degrees ° grad 度 º gradi graus grados derece degrés",
        "rad": "radian radians 弧度 radyan radianti",
        "rev": "revolutions u turns giri tours devir umdr 圈",
        COUNTS: "count counts inc incs ticks tick cts inkremente increments pulses impulse imp impulses",
        "s": "sec seconds second sek 秒 sn saniye", "ms": "msec millis 毫秒",
        "us": "µs μs usec micros", "hours": "h hr hrs hour stunden", "min": "minutes", "days": "day",
        "rpm": "1/min u/min min-1 r/min min^-1 min⁻¹ 1/min. tr/min giri/min d/dk dev/dk devir/dakika rot/min 转/分",
        "deg/s": "°/s", "rad/s": "rad/sn",
    }.items()
    for unit in spellings.split()
}  # fmt: skip
INDEX = re.compile(r"\[(\d{1,2}|'[^']*'|\"[^\"]*\")\]")
"""Element of a list, as in `effort[0]` and `effort['main_shaft']`, not a unit. Counts of a turn have more digits."""
_MULTIPLE = re.compile(
    r"(?P<number>\d+([.,]\d+)?(e[+-]?\d+)?|1/\d+)\s*[*·×x]?\s*(?P<unit>[^\d\s/*·×.,-].*)", re.IGNORECASE
)
"""A multiple or a part of a unit, such as `0.1deg`, `1/10 °`, `100 ns`."""

# English, German, French, Italian, Spanish, Portuguese, Turkish and Chinese, as `_plain` writes them.
_WORDS = {
    "time": r"\b(time|zeit|uhrzeit|zeitstempel|t[0-9]?|stamp|timestamp|secs?|seconds|date|temps|horodatage|tempo|tiempo"
    r"|zaman|sure|saat|x value|micros|millis)\b|时间|時間|时刻",
    "angle": r"angle|winkel|theta|encoder|position|phi|drehgeber|angolo|posizione|encodeur|codeur|angulo|posicion"
    r"|posicao|\b(pos|aci|acisi|konum|enkoder|kodlayici)\b|角|编码器|編碼器|位置",
    "torque": r"torque|effort|moment(?!an)|\b(couple|md|tq|tork|torku|par motor)\b|coppia|扭矩|转矩|轉矩|力矩",
    "speed": r"speed|velocity|drehzahl|geschwindigkeit|omega|rpm|velocita|velocidad|vitesse|rotacao"
    r"|\b(n|giri|hiz|hizi|devir)\b|速",
}
_TURKISH = str.maketrans("İÝıý", "IIii")
"""Turkish letters without their dots, and the letters shown when cp1254 is read as cp1252."""
_LETTER_OF_TYPE = r"\b[a-z]{1,2}(?=[A-Z][a-z])"
"""Letters of type before a variable's name in a controller: fAngle, lrActPos."""


def choose(kind: str, names: Iterable[str], unit_given: bool = False) -> list[str]:
    """Choose columns by names of a kind: time, angle, torque or speed; without any, angle and torque by their unit.

    Candidates with a unit of another quantity are dropped, unless none would remain. If none would, the end of a name
    may not be a unit (theta_m), but brackets (Position [mm]) are: these candidates are dropped, too, unless the unit is
    given or the kind is torque, whose column is better refused for its unit than left out.
    """
    own, names = _UNITS_OF[kind], list(names)
    others = set(_ALL) - set(own)
    unit_of = {name: base_unit(unit_in_name(name)) for name in names}
    spoken = [name for name in names if re.search(_WORDS[kind], _plain(name))]
    if not spoken and kind in ("angle", "torque"):
        return [name for name in names if unit_of[name] in own and unit_of[name] not in ("rev", COUNTS)]
    fitting = [name for name in spoken if unit_of[name] not in others]
    bracketed = {name for name in names if re.search(BRACKETS, INDEX.sub("", name))}
    own_unit = [name for name in fitting if unit_of[name] in own or name not in bracketed]
    fitting = own_unit or fitting  # T [°C] beside t [s]
    unsure = [name for name in spoken if name in fitting or name not in bracketed]
    if unit_given:
        return unsure or spoken
    return fitting or (spoken if kind == "torque" else unsure)


def _plain(name: str) -> str:
    """Convert the name of a column to plain lower-case words, without unit, accents, letters of type and camel case."""
    bare = re.sub(BRACKETS, " ", name).strip() or name
    bare = re.sub(r"(?<=[A-Za-z])\d{1,2}$", "", bare) if re.search(r"[./]", bare) else bare  # field.effort0
    bare = re.sub(r"[_ ][Nsm]$", "", bare)
    words = re.sub(r"[\W_]+", " ", re.sub(_LETTER_OF_TYPE, "", bare))
    words = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", words)
    letters = unicodedata.normalize("NFKD", words.translate(_TURKISH).lower())
    return "".join(letter for letter in letters if not unicodedata.combining(letter))


def spelled(unit: str) -> str:
    """Return a unit in the spelling of these tables; unchanged if it is unknown, or m may be milli or mega."""
    plain = unit.strip()
    multiple = _MULTIPLE.fullmatch(plain)
    if multiple is not None and plain.lower() not in _SPELLINGS:
        return f"{_number(multiple['number']):.12g} {spelled(multiple['unit'])}"
    squeezed = {name.replace(" ", "").lower(): name for name in _ALL if name != "MN m"}
    lower = plain.lower()
    bare = re.sub(r"[\s.*·∙⋅-]|(?<=lb)s", "", lower)
    found = _SPELLINGS.get(lower) or squeezed.get(lower.replace(" ", "")) or _SPELLINGS.get(bare) or plain
    if found not in _MILLI or plain[0] == "m":
        return found
    # A name all in capitals has lost its case: no machine's log has megametres, but MNM may be either.
    if found == "mN m":
        return "MN m" if plain.endswith("m") else plain
    return found if plain.isupper() else plain


def _number(text: str) -> float:
    above, _, below = text.replace(",", ".").partition("/")
    return float(above) / float(below or 1.0)


def unit_factor(unit: str, units: Mapping[str, float]) -> float | None:
    """Return SI units per unit, for a unit of a table or a multiple of it (`0.1 deg`); None for any other.

    Examples:
        >>> unit_factor("10 N cm", TORQUE_UNITS)
        0.1
    """
    number, _, rest = unit.partition(" ")
    if unit in units:
        return units[unit]
    try:
        return float(number) * units[rest] if rest in units else None
    except ValueError:
        return None


def unit_in_name(name: str) -> str:
    """Return the unit in a column's name: 'Torque [Ncm]', 'angle (deg)', 'theta_rad', 'time_s'; '' without one."""
    name = INDEX.sub(" ", name).strip() or name
    bracket = re.search(BRACKETS, name)
    if bracket:
        return spelled(bracket[0][1:-1])
    last = re.split(r"[_/ ]", name)[-1]
    if len(name) == 1:
        return ""  # n, t: a name of one letter is that of the quantity
    return spelled(last) if is_unit(last) and spelled(last) != name and spelled(last) != COUNTS else ""


def is_unit(text: str) -> bool:
    """Return true if a text is a known unit, in any spelling, with or without brackets."""
    bare = text[1:-1] if re.fullmatch(BRACKETS, text) else text
    return base_unit(spelled(bare)) in _ALL


def base_unit(unit: str) -> str:
    """Return the unit of which another is a multiple."""
    number, _, rest = unit.partition(" ")
    return rest if rest and re.fullmatch(r"[\d.e+-]+", number) else unit
