"""Units of time, angle, torque, speed and other quantities, in the spellings of many loggers."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

from textile_twin_core.comparison.readings import ANGLE_TURNS
from textile_twin_core.inference.torque_units import UNITS_PER_NM

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

BRACKETS = r"[\[(（【][^\])）】]*[\])）】]"
_MILLI = ("ms", "mm", "mm/s", "mN m")
"""Units whose prefix means mega in upper case."""
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


INDEX = re.compile(r"\[(\d{1,2}|'[^']*'|\"[^\"]*\")\]")
"""Element of a list, as in `effort[0]` and `effort['main_shaft']`, not a unit. Counts of a turn have more digits."""
_MULTIPLE = re.compile(
    r"(?P<number>\d+([.,]\d+)?(e[+-]?\d+)?|1/\d+)\s*[*·×x]?\s*(?P<unit>[^\d\s/*·×.,-].*)", re.IGNORECASE
)
"""A multiple or a part of a unit, such as `0.1deg`, `1/10 °`, `100 ns`."""


def spelled(unit: str) -> str:
    """Return a unit in the spelling of these tables; unchanged if it is unknown, or m may be milli or mega."""
    plain = unit.strip()
    multiple = _MULTIPLE.fullmatch(plain)
    if multiple is not None and plain.lower() not in _SPELLINGS:
        return f"{_number(multiple['number']):.12g} {spelled(multiple['unit'])}"
    known = {*TIME_UNITS, *ANGLE_TURNS, *SPEED_UNITS, *TORQUE_UNITS, *QUANTITY_UNITS}
    squeezed = {name.replace(" ", "").lower(): name for name in known if name != "MN m"}
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
    return spelled(last) if is_unit(last) and spelled(last) != name else ""


def is_unit(text: str) -> bool:
    """Return true if a text is a known unit, in any spelling, with or without brackets."""
    bare = text[1:-1] if re.fullmatch(BRACKETS, text) else text
    return base_unit(spelled(bare)) in {*TIME_UNITS, *ANGLE_TURNS, *SPEED_UNITS, *TORQUE_UNITS, *QUANTITY_UNITS}


def base_unit(unit: str) -> str:
    """Return the unit of which another is a multiple."""
    number, _, rest = unit.partition(" ")
    return rest if rest and re.fullmatch(r"[\d.e+-]+", number) else unit
