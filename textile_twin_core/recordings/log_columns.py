"""Quantities and units of the columns of a log: given by the user, by their names, or by their values."""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Iterable, Mapping

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.comparison.readings import ANGLE_TURNS, angle_unit, radians_of, shown_turn
from textile_twin_core.errors import RecordingError
from textile_twin_core.recordings.log_units import (
    BRACKETS,
    INDEX,
    QUANTITY_UNITS,
    SPEED_UNITS,
    TIME_UNITS,
    TORQUE_UNITS,
    base_unit,
    unit_factor,
    unit_in_name,
)

# English, German, French, Italian, Spanish, Portuguese, Turkish and Chinese, as `_plain` writes them.
_WORDS = {
    "time": r"\b(time|zeit|uhrzeit|zeitstempel|t[0-9]?|stamp|timestamp|secs?|seconds|date|temps|horodatage|tempo|tiempo"
    r"|zaman|sure|saat)\b|时间|時間|时刻",
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
    own = {"time": TIME_UNITS, "angle": ANGLE_TURNS, "torque": TORQUE_UNITS, "speed": SPEED_UNITS}[kind]
    others = {*TIME_UNITS, *ANGLE_TURNS, *SPEED_UNITS, *TORQUE_UNITS, *QUANTITY_UNITS} - {*own}
    names = list(names)
    unit_of = {name: base_unit(unit_in_name(name)) for name in names}
    spoken = [name for name in names if re.search(_WORDS[kind], _plain(name))]
    if not spoken and kind in ("angle", "torque"):
        return [name for name in names if unit_of[name] in own and unit_of[name] != "rev"]
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


def angle_radians(name: str, unit: str, values: FloatArray) -> tuple[FloatArray, str, str]:
    """Return radians (n,), the unit, and its source in words: configured, named, or shown by the wraps.

    A unit may be a number, the counts of one turn, or a multiple of a unit. Raises RecordingError for an unknown unit.
    """
    if unit:
        factor = unit_factor(unit, {short: radians_of(short) for short in ANGLE_TURNS})
        try:
            factor = radians_of(unit) if factor is None else factor
        except ValueError:
            known = f"{', '.join(ANGLE_TURNS)}, or the counts of a turn"
            raise RecordingError(f"column '{name}': angle in '{unit}'? there are: {known}") from None
        plain = re.fullmatch(r"[\d.e+]+", unit) is not None
        words = f"{shown_turn(float(unit))} a turn" if plain else unit
        return values * factor, unit, words + _other_unit(factor, values)
    seen = angle_unit(values)
    if not seen.wrapped:
        raise RecordingError(
            f"column '{name}' never begins anew, so its unit cannot be seen; tell it: --angle-unit "
            f"{', '.join(ANGLE_TURNS)} or the counts of a turn"
        )
    return values * seen.to_radians, seen.option, f"{seen.name}, as seen: {shown_turn(seen.turn)} a turn"


def _other_unit(factor: float, values: FloatArray) -> str:
    """Describe wraps at another unit than one of `factor` radians; empty without such wraps."""
    seen = angle_unit(values)
    other = next((short for short, turn in ANGLE_TURNS.items() if seen.wrapped and turn == seen.turn), "")
    if not other or math.isclose(ANGLE_TURNS[other] * factor, 2.0 * math.pi):
        return ""
    return (
        f"; but it begins anew each {shown_turn(seen.turn)}, as {seen.name} do: if they are, tell --angle-unit {other}"
    )


def torque_newton_metres(name: str, unit: str, values: FloatArray, scale: float | None) -> tuple[FloatArray, str, str]:
    """Return N m (n,), the unit, and its source; `scale` is N m per unit, for volts and other own units."""
    if scale is not None:
        return values * scale, unit, f"{scale:g} N m per {unit or 'unit'}"
    factor = unit_factor(unit or "N m", TORQUE_UNITS)
    if factor is None:
        raise RecordingError(
            f"column '{name}': torque in '{unit}'? there are: {', '.join(TORQUE_UNITS)}; for any other give"
            " --torque-scale, N m per unit"
        )
    return values * factor, unit or "N m", unit or "N m (taken for granted)"


def quantity_si(name: str, unit: str, values: FloatArray) -> tuple[FloatArray, str]:
    """Convert a displacement, angle, speed or force to SI, and return its unit: configured, named, otherwise SI."""
    factor = unit_factor(unit, QUANTITY_UNITS) if unit else 1.0
    if factor is None:
        known = ", ".join(QUANTITY_UNITS)
        raise RecordingError(f"column '{name}': a quantity in '{unit}'? there are: {known}")
    return values * factor, unit or "SI units (taken for granted)"


def looks_like_time(values: FloatArray) -> bool:
    """Return true if a column rises throughout in nearly equal steps."""
    finite = values[np.isfinite(values)]
    step = np.diff(finite[:10_000])
    return finite.size > 2 and bool((step > 0.0).all()) and float(np.median(step)) > 0.2 * float(step.max(initial=0.0))


def describe(columns: Mapping[str, FloatArray]) -> str:
    """List the columns with their ranges, for a person who chooses."""
    rows = []
    for name, values in columns.items():
        finite = values[np.isfinite(values)]
        span = f"{finite.min():.6g} .. {finite.max():.6g}" if finite.size else "empty"
        rows.append(f"{name} ({span})")
    return ", ".join(rows)
