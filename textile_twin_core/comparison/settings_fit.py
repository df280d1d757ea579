"""Fit settings to a record: Gauss-Newton with Huber weights in those that are freed, the others stay."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray
from textile_twin_core.comparison.evidence import Evidence, Settings, States
from textile_twin_core.comparison.robust import huber_loss, huber_weights
from textile_twin_core.comparison.shaft_track import TURN

_STEPS = {"zero_rad": 1e-4, "delay_s": 1e-5, "drift": 1e-7}
_WIDER = 20.0
"""Steps of slopes are so much longer where the load is a mean over each sample's interval, which goes by parts."""
_LONGEST = {"zero_rad": 0.15, "delay_s": 0.01, "drift": 1e-4}
"""Longest step of one iteration."""
NONLINEAR = tuple(_STEPS)
_FEWEST_SAMPLES = 16
"""Samples below which nothing is fitted."""
LINEAR = ("gain", "load", "constant_Nm", "viscous_Nms", "inertia_kgm2", "offset_Nm")


@dataclass(frozen=True)
class SettingsFit:
    """Settings, and what is left with them: residual (m,) [N m], which samples count, their angles of the shaft.

    jacobian: (m, k) slopes of the expected torque by the freed settings, in the order of `free`. measured: (m,) torque
    [N m]. scale: of Huber's loss [N m]. Where the evidence is weighed in blocks, m is that of the blocks.
    """

    settings: Settings
    free: tuple[str, ...]
    residual: FloatArray
    good: BoolArray
    theta: FloatArray
    jacobian: FloatArray
    measured: FloatArray
    scale: float

    @property
    def turn(self) -> IntArray:
        """Turns of the shaft (m,)."""
        return np.floor(self.theta / TURN).astype(np.int64)

    @property
    def rms(self) -> float:
        """Root mean square of the residual [N m]."""
        return float(np.sqrt(np.mean(self.residual[self.good] ** 2))) if self.good.any() else np.inf


def fit_settings(evidence: Evidence, start: Settings, free: Iterable[str], iterations: int = 25) -> SettingsFit:
    """The settings near `start` under which the record is likeliest, with the settings named in `free` open."""
    names = tuple(name for name in (*NONLINEAR, *LINEAR) if name in set(free))
    # Without a gain to begin with the others have nothing to lean on.
    settings = linear_start(evidence, start, names)
    states = evidence.states(settings)
    damping = 0.0
    for _ in range(iterations if names else 0):
        residual, good, _, jacobian, _ = _weighed(evidence, settings, states, names)
        if np.count_nonzero(good) < _FEWEST_SAMPLES:
            break
        scale = evidence.scale(residual[good])
        loss = _loss(evidence.left(settings, states), scale)
        step = _step(jacobian[good], residual[good], scale, damping)
        limited = _limited(names, step)
        trial = _moved(settings, names, limited)
        trial_states = evidence.states(trial)
        trial_loss = _loss(evidence.left(trial, trial_states), scale)
        if trial_loss < loss:
            settings, states, damping = trial, trial_states, 0.1 * damping
            if loss - trial_loss < 1e-7 * loss and np.array_equal(limited, step):
                break
        elif damping > 1e3:
            break
        else:
            damping = max(10.0 * damping, 1e-3)
    residual, good, theta, jacobian, measured = _weighed(evidence, settings, states, names)
    scale = evidence.scale(residual[good])
    return SettingsFit(settings, names, residual, good, theta, jacobian, measured, scale)


def _weighed(
    evidence: Evidence, settings: Settings, states: States, names: tuple[str, ...]
) -> tuple[FloatArray, BoolArray, FloatArray, FloatArray, FloatArray]:
    """Residual, where it counts, angle of the shaft, slopes and measured torque, as the evidence weighs them."""
    measured, jacobian = evidence.torque_Nm, slopes(evidence, settings, states, names)
    residual = measured - evidence.expected(settings, states)
    good = states.good & np.isfinite(jacobian).all(axis=1)
    told, good = evidence.weighed(np.column_stack([residual, states.theta, measured, jacobian]), good)
    return told[:, 0], good, told[:, 1], told[:, 3:], told[:, 2]


def linear_start(evidence: Evidence, start: Settings, names: tuple[str, ...]) -> Settings:
    """The start with its freed linear settings solved for, by least squares."""
    linear = [name for name in names if name in LINEAR]
    if not linear:
        return start
    states = evidence.states(start)
    good, columns = states.good, {**_parts(states), "offset_Nm": np.ones_like(states.omega)}
    base = start.changed({name: 0.0 for name in linear if name != "gain"})
    torque = evidence.expected(replace(base, gain=1.0, offset_Nm=0.0), states)
    free_gain, others = "gain" in linear, [name for name in linear if name != "gain"]
    # With the gain fixed the parts are weighed as the sensor shows them.
    weigh = 1.0 if free_gain else start.gain
    matrix = [torque] if free_gain else []
    matrix += [columns[name] * (1.0 if name == "offset_Nm" else weigh) for name in others]
    target = evidence.torque_Nm - (0.0 if "offset_Nm" in linear else start.offset_Nm)
    if not free_gain:
        target = target - start.gain * torque
    told, good = evidence.weighed(np.stack([*matrix, target], axis=1), good)
    matter, target = told[good, :-1], told[good, -1]
    # Where several could carry the same each carries a part, whatever its unit.
    size = np.sqrt(np.mean(matter**2, axis=0)) + 1e-300 if target.size else np.ones(matter.shape[1])
    found = (np.linalg.lstsq(matter / size, target, rcond=1e-10)[0] / size).tolist()
    gain = found.pop(0) if free_gain else start.gain
    if gain == 0.0:
        return start
    values = dict(zip(others, found, strict=True))
    scaled = {name: value if name == "offset_Nm" or not free_gain else value / gain for name, value in values.items()}
    return start.changed({**scaled, "gain": gain})


def slopes(evidence: Evidence, settings: Settings, states: States, names: tuple[str, ...]) -> FloatArray:
    """(m, k) derivatives of the expected torque by the named settings."""
    columns = []
    for name in names:
        if name in _STEPS:
            step = _STEPS[name] * (_WIDER if evidence.governed else 1.0)
            ends = [settings.changed({name: getattr(settings, name) + side * step}) for side in (-1.0, 1.0)]
            low, high = (evidence.expected(end, evidence.states(end)) for end in ends)
            columns.append(np.where(states.sudden, 0.0, (high - low) / (2.0 * step)))
        elif name == "gain":
            columns.append((evidence.expected(settings, states) - settings.offset_Nm) / settings.gain)
        elif name == "offset_Nm":
            columns.append(np.ones_like(states.omega))
        else:
            columns.append(settings.gain * _parts(states)[name])
    return np.stack(columns, axis=1) if columns else np.empty((states.omega.size, 0))


def _parts(states: States) -> dict[str, FloatArray]:
    """Torque (m,) in the shaft per unit of the settings that add to it [N m]."""
    friction = {"constant_Nm": states.terms.direction, "viscous_Nms": states.omega}
    return {"load": states.terms.load, **friction, "inertia_kgm2": states.alpha}


def _loss(left: tuple[FloatArray, BoolArray], scale: float) -> float:
    """Mean of Huber's loss of a residual where it counts, infinite with too few samples."""
    residual = left[0][left[1]]
    if residual.size < _FEWEST_SAMPLES:
        return np.inf
    return float(np.mean(huber_loss(residual, scale)))


def _step(jacobian: FloatArray, residual: FloatArray, scale: float, damping: float) -> FloatArray:
    weight = huber_weights(residual, scale)
    sizes = np.sqrt(np.mean(jacobian**2, axis=0)) + 1e-300
    scaled = jacobian / sizes
    normal = (scaled * weight[:, None]).T @ scaled
    normal[np.diag_indices_from(normal)] *= 1.0 + damping
    right = (scaled * weight[:, None]).T @ residual
    return np.asarray(np.linalg.lstsq(normal, right, rcond=1e-9)[0] / sizes)


def _limited(names: tuple[str, ...], step: FloatArray) -> FloatArray:
    excess = [abs(step[k]) / _LONGEST[name] for k, name in enumerate(names) if name in _LONGEST]
    limited: FloatArray = step / max([1.0, *excess])
    return limited


def _moved(settings: Settings, names: tuple[str, ...], step: FloatArray) -> Settings:
    return settings.changed({name: getattr(settings, name) + float(step[k]) for k, name in enumerate(names)})
