"""Name of the fault that a few turns show against a band, and its text for a person."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.comparison.fault_band import SERIES, Band
from textile_twin_core.comparison.fault_signatures import BINS, KINDS, TurnFeatures

OF_SAMPLES = ("stuck", "dropout")
"""Faults that show in the samples themselves, independent of all others."""
SIDE = {
    "load_force": "needle",
    "cloth": "needle",
    "blunt_needles": "needle",
    "constant_torque": "drive",
    "sensor_offset": "sensor",
    "sensor_gain": "sensor",
    "phase": "sensor",
    "noise": "sensor",
    "profile": "drive",
    "dropout": "sensor",
    "stuck": "sensor",
}
_MOST = 0.6
"""Share of the change that one explanation must take to be named."""
_AS_USUAL = 4.0
"""Largest distance of the mean of some turns from a band that contains them, in standard deviations."""
_CERTAIN = 4.0
"""Least size of a signature beside cloth, in its standard deviations over the turns that are examined."""
_NOISE, _PROFILE, _DROPOUT = (SERIES.index(name) for name in ("noise", "profile", "dropout"))
_ACTS = 0.1
"""Share of the largest torque of the loads above which they act."""
_BROAD = 1.0 / 3.0
"""Least share of the angles at which the loads act that a change of theirs takes: a bump alone may be a bearing."""
_LOAD, _PIERCE = (KINDS.index(name) for name in ("load_force", "blunt_needles"))
_EVIDENCE = {"sensor_offset": "constant_torque", "cloth": "load_force"}
_TO_RPM = 30.0 / math.pi


def evidence_of(kind: str) -> str:
    """Return the series (see `SERIES`) that raises alarms of a kind."""
    return _EVIDENCE.get(kind, kind)


def alarm_thresholds(
    band: Band, torque_Nm: float, least_load: float, least_share: float, least_phase_rad: float, least_pierce: float
) -> FloatArray:
    """Smallest change of each series that is worth an alarm, (series,)."""
    lost = 0.1 * abs(band.mean[_DROPOUT])
    torque = least_share * torque_Nm
    return np.array([least_load, torque, least_share, least_phase_rad, least_pierce, 0.25, 0.7, lost, 0.2])


def agrees_with(turns: TurnFeatures, band: Band, worth: FloatArray) -> bool:
    """Return true if turns agree with a band."""
    away = np.abs(np.mean(band.rows(turns), axis=0) - band.mean)
    return bool(np.all(away < np.maximum(worth, _AS_USUAL * band.sigma / math.sqrt(turns.number.size))))


def named(turns: TurnFeatures, band: Band, worth: FloatArray, has_pierce: bool = False) -> tuple[str, float]:
    """Return the kind of fault that a few turns show, and its size; empty when it has gone.

    A single signature is named if it alone explains most of the new residual (the likeliest of one-parameter
    explanations). A change in that part of the turn alone in which the loads act is one of the loads, whatever its
    shape. Otherwise a change that is the same in every turn is an unknown torque, and any other is noise.
    Beside a pierce, needles and cloth together are one explanation, and usual differences of the cloth are no fault.
    """
    rows = np.mean(band.rows(turns), axis=0) - band.mean
    for kind in OF_SAMPLES:
        k = SERIES.index(kind)
        if rows[k] > worth[k] and rows[k] > 3.0 * band.sigma[k]:
            return kind, float(rows[k])
    learnt = band.mean[: len(KINDS)]
    normal = np.mean(turns.normal, axis=0)
    right = np.mean(turns.right, axis=0) - normal @ learnt
    power = float(np.mean(turns.rms_Nm**2))
    power += float(learnt @ normal @ learnt - 2.0 * learnt @ (right + normal @ learnt))
    excess = power - math.exp(2.0 * band.mean[_NOISE])
    if has_pierce:
        noise = _CERTAIN**2 * math.exp(2.0 * band.mean[_NOISE]) / float(np.sum(turns.count))
        kind, size = _beside_cloth(normal, right, (excess, noise), rows, worth)
        if kind:
            return kind, size
    else:
        taken = right**2 / np.maximum(np.diag(normal), 1e-300)
        best = int(np.argmax(taken))
        size = float(right[best] / max(normal[best, best], 1e-300))
        alone = taken[best] > _MOST * excess and abs(size) > worth[best]
        share = 0.0 if alone and best == _LOAD else _of_the_loads(turns, band, best)
        if abs(share) > worth[_LOAD]:
            return "load_force", share
        if alone:
            return KINDS[best], size
    profiles = np.nan_to_num(turns.profile_Nm - band.profile_Nm)
    lasting, each = float(np.mean(np.mean(profiles, axis=0) ** 2)), float(np.mean(profiles**2))
    if lasting > _MOST * each and rows[_PROFILE] > worth[_PROFILE]:
        return "profile", _offset(turns, band) or float(np.sqrt(lasting))
    return ("noise", float(rows[_NOISE])) if rows[_NOISE] > worth[_NOISE] else ("", 0.0)


def _of_the_loads(turns: TurnFeatures, band: Band, best: int) -> float:
    """Change of the loads as share of them, where a change by shaft angle is better explained by the loads than by the
    best signature: any torque at the angles where they act, and none at all others (Akaike's criterion). 0 otherwise.
    """
    by_angle = np.mean(turns.by_angle_Nm, axis=0)
    seen = np.isfinite(by_angle).all(axis=0)
    change, columns = (by_angle[0] - band.residual_Nm)[seen], by_angle[1:, seen]
    load, other = columns[_LOAD], columns[best]
    acts = np.abs(load) > _ACTS * np.max(np.abs(load), initial=0.0)
    inside = change[acts] ** 2
    if not acts.any() or acts.all() or not inside.any():
        return 0.0
    variance = band.profile_sigma_Nm[seen] ** 2 / turns.number.size
    outside = float(np.sum(change[~acts] ** 2))
    signature = change - other * (change @ other) / max(float(other @ other), 1e-300)
    free = 2.0 * float(np.sum(variance[acts]))
    broad = float(np.sum(inside)) ** 2 / float(np.sum(inside**2)) > _BROAD * inside.size
    lasting = outside < (1.0 - _MOST) * float(np.sum(change**2))
    if not (broad and lasting and outside + free < float(signature @ signature)):
        return 0.0
    return float(change[acts] @ load[acts]) / float(load[acts] @ load[acts])


def _offset(turns: TurnFeatures, band: Band) -> float:
    """Torque that is the same at all angles, of a shaft that turns both ways; 0 where the change differs by angle."""
    seen = np.isfinite(turns.profile_Nm).any(axis=0)
    away = np.mean(np.nan_to_num(turns.profile_Nm - band.profile_Nm), axis=0)[seen]
    mean = float(np.mean(away)) if away.size else 0.0
    return mean if mean**2 > _MOST * float(np.mean(away**2)) else 0.0


def _beside_cloth(
    normal: FloatArray, right: FloatArray, power: tuple[float, float], rows: FloatArray, worth: FloatArray
) -> tuple[str, float]:
    """Name a change beside cloth that differs as usual: needles, cloth, or the signature that adds most to them.

    power: of the change, and the least of a signature that is certain.
    """
    excess, certain = power
    both = (_LOAD, _PIERCE)
    process = _taken(normal, right, both)
    k = max((k for k in range(len(KINDS)) if k not in both), key=lambda k: _taken(normal, right, (*both, k)))
    whole = _taken(normal, right, (*both, k))
    size = float(_sizes(normal, right, (*both, k))[k])
    blunt, other = rows[_PIERCE] > worth[_PIERCE], abs(rows[_LOAD]) > worth[_LOAD]
    competes = whole - _taken(normal, right, (k,)) if blunt or other else 0.0
    if abs(size) > worth[k] and whole - process > max(_MOST * (excess - process), competes, certain):
        return KINDS[k], size
    if process > _MOST * excess and (blunt or other):
        kind = _PIERCE if blunt else _LOAD
        return KINDS[kind], float(rows[kind])
    return "", 0.0


def _sizes(normal: FloatArray, right: FloatArray, columns: Sequence[int]) -> FloatArray:
    """Sizes of some signatures together, 0 for all others."""
    found = np.zeros(right.size)
    some = list(columns)
    found[some] = np.linalg.lstsq(normal[np.ix_(some, some)], right[some], rcond=1e-9)[0]
    return found


def _taken(normal: FloatArray, right: FloatArray, columns: Sequence[int]) -> float:
    """Power of the residual that some signatures explain together."""
    return float(right @ _sizes(normal, right, columns))


def alarm_text(
    kind: str, size: float, turns: TurnFeatures, band: Band, speed_known: bool, has_pierce: bool = False
) -> tuple[str, str]:
    """Return the kind and the text of the alarm for a fault of a kind and size that some turns show."""
    speed = float(np.mean(turns.speed_rad_s))
    against = kind == "constant_torque" and size * math.copysign(1.0, speed) < 0.0
    offset = kind == "profile" and _offset(turns, band) != 0.0
    name = "sensor_offset" if against or offset else "cloth" if has_pierce and kind == "load_force" else kind
    away = np.mean(np.nan_to_num(turns.profile_Nm - band.profile_Nm), axis=0)
    angle = (float(np.argmax(np.abs(away))) + 0.5) * 360.0 / BINS
    freer = "" if offset else " (or the drive runs freer)"
    text = {
        "load_force": f"needle side: the loads changed by {size:+.1%}",
        "cloth": f"needle side: other cloth or yarn, its force changed by {size:+.1%} on the way in and on the way out",
        "blunt_needles": f"needle side: blunt needles, the pierce grew by {size:.1%} and the way out did not",
        "constant_torque": f"drive side: friction changed by {size:+.3g} N m (or the torque sensor's offset)",
        "sensor_offset": f"torque sensor: offset changed by {size:+.3g} N m" + freer,
        "sensor_gain": f"torque sensor: gain changed by {size:+.1%}",
        "phase": f"encoder or its coupling: the angle slipped by {math.degrees(size):+.2f} deg",
        "noise": f"torque sensor: {math.exp(min(size, 20.0)):.2g} times as much noise as learnt",
        "profile": f"drive side: a torque that the model does not know, most at {angle:.0f} deg",
        "dropout": "torque sensor: samples are missing",
        "stuck": "torque sensor: its value is frozen",
    }[name]
    if speed_known or kind in OF_SAMPLES:
        return name, text
    now, learnt = (abs(each) * _TO_RPM for each in (speed, float(np.median(band.speeds_rad_s))))
    return name, (
        f"at another speed than learnt ({now:.0f} rpm, learnt at {learnt:.0f}), where friction or a delay shows that"
        f" the machine file does not have; if it has them, {text}"
    )
