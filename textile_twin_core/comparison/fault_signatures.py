"""Signatures of faults in the residual: one column of torque per kind, and their sizes turn by turn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from textile_twin_core.arrays import BoolArray, FloatArray, IntArray
from textile_twin_core.comparison.process_force import LoadTorque, pierce_of
from textile_twin_core.comparison.range_ends import RangeEnds
from textile_twin_core.comparison.residual import load_steps
from textile_twin_core.comparison.shaft_track import TURN
from textile_twin_core.comparison.uncertainty import turn_normals, turn_scores
from textile_twin_core.dynamics.loads import ShaftFriction
from textile_twin_core.inference.measurement import Hypothesis
from textile_twin_core.machine import Machine
from textile_twin_core.twin import compile_machine

BINS = 36
_SLOW = 0.05
_PHASE_STEP = 1e-3
_JUMP_GUARD_RAD = 0.15
"""Samples this close to a discontinuity of the load are left out: else it would dominate the slip of an angle."""

KINDS = ("load_force", "constant_torque", "sensor_gain", "phase", "blunt_needles")
"""Signatures in the order of their columns: the declared loads, a constant torque, the whole torque, its derivative by
the shaft angle (a slipped encoder, or a delay), and the pierce of a force curve."""


@dataclass(frozen=True)
class TurnFeatures:
    """Turns of the shaft, (t,) each, and features of their residuals.

    Attributes:
        number: the turn. start_ns: stamp of its first sample. count: samples in it.
        speed_rad_s: its mean speed along the path of the shaft, negative backwards.
        cut_off: samples at an end of the sensor's range, which are not fitted.
        sizes: (t, 5) size of each signature of `KINDS`, as share of the load, N m, share of the torque, rad, share of
            the pierce.
        noise_Nm: (t,) scatter of the residual that no signature explains. profile_Nm: (t, BINS) its mean by shaft
            angle, nan without samples. by_angle_Nm: (t, 1 + 5, BINS) likewise of the residual and the signatures.
        rms_Nm: of the whole residual. stuck: share of the torque samples equal to the one before.
        normal, right: (t, 5, 5) and (t, 5) of the least squares that gives the sizes, per sample.
    """

    number: IntArray
    start_ns: IntArray
    count: IntArray
    cut_off: IntArray
    speed_rad_s: FloatArray
    sizes: FloatArray
    noise_Nm: FloatArray
    profile_Nm: FloatArray
    by_angle_Nm: FloatArray
    rms_Nm: FloatArray
    stuck: FloatArray
    normal: FloatArray
    right: FloatArray

    def where(self, chosen: BoolArray | slice) -> TurnFeatures:
        """Select some of the turns."""
        return TurnFeatures(**{name: getattr(self, name)[chosen] for name in self.__dataclass_fields__})

    @staticmethod
    def joined(turns: Sequence[TurnFeatures]) -> TurnFeatures:
        """Join turns in order."""
        names = TurnFeatures.__dataclass_fields__
        return TurnFeatures(**{name: np.concatenate([getattr(each, name) for each in turns]) for name in names})


def slow_speed(omega_rad_s: FloatArray, turn: IntArray) -> FloatArray:
    """Speed (n,) below which the shaft counts as standing, by the largest one in the turn of each sample.

    Turns beside it have no effect, so live blocks and a whole recording give the same.
    """
    of_turn = np.unique(turn, return_inverse=True)[1]
    fastest = np.zeros(int(of_turn.max()) + 1 if of_turn.size else 0)
    np.maximum.at(fastest, of_turn, np.abs(omega_rad_s))
    return np.asarray(_SLOW * fastest[of_turn])


class WatchedTorque:
    """Torque of a machine whose friction counts where its shaft turns.

    Args:
        machine: The machine; its sensors are not used.

    Attributes:
        pierce: Of the force curve; None without one (see `pierce_of`).
        step_angles_rad: Angles in a turn at which the load jumps, increasing.
    """

    def __init__(self, machine: Machine) -> None:
        frictions = [load for load in machine.loads if isinstance(load, ShaftFriction)]
        others = tuple(load for load in machine.loads if not isinstance(load, ShaftFriction))
        self._viscous_Nms = sum(load.viscous_Nms for load in frictions)
        self._coulomb_Nm = sum(load.coulomb_Nm for load in frictions)
        self._twin = compile_machine(replace(machine, loads=others), ["balancing_torque_Nm", "torque_load_Nm"])
        pierce = pierce_of(machine)
        self.pierce = LoadTorque(machine, pierce) if pierce else None
        jumps = load_steps(compile_machine(machine, ["balancing_torque_Nm"]))
        self.step_angles_rad = sorted(angle % TURN for angle in jumps)

    def at(
        self, theta: FloatArray, omega: FloatArray, alpha: FloatArray, slow_rad_s: float | FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the torque, that of the loads without friction, and the direction (0: it stands) at states (n,)."""
        out = self._twin.evaluate(theta, omega, alpha)
        direction = np.where(np.abs(omega) > slow_rad_s, np.sign(omega), 0.0)
        friction = self._viscous_Nms * omega + self._coulomb_Nm * direction
        return out["balancing_torque_Nm"] + friction, out["torque_load_Nm"], direction

    def near_step(self, theta: FloatArray, omega: FloatArray, guard_s: float, guard_rad: float) -> BoolArray:
        """Return true within `guard_s`, at the present speed, or `guard_rad` of a discontinuity of the load."""
        near = np.zeros(theta.size, dtype=np.bool_)
        within = np.maximum(np.abs(omega) * guard_s, guard_rad)
        for angle in self.step_angles_rad:
            apart = theta - angle
            apart -= TURN * np.rint(apart * (1.0 / TURN))
            near |= np.abs(apart) <= within
        return near


@dataclass(frozen=True)
class Signatures:
    """Torque of each signature of `KINDS`, (n,) each [N m]."""

    load: FloatArray
    direction: FloatArray
    torque: FloatArray
    slope: FloatArray
    pierce: FloatArray


def signatures(
    machine: WatchedTorque, theta: FloatArray, omega: FloatArray, alpha: FloatArray, slow_rad_s: FloatArray
) -> Signatures:
    """Evaluate the signatures at states (n,); below `slow_rad_s` the shaft counts as standing."""
    torque, load, direction = machine.at(theta, omega, alpha, slow_rad_s)
    shifted, _, _ = machine.at(theta + _PHASE_STEP, omega, alpha, slow_rad_s)
    pierce = np.zeros_like(torque) if machine.pierce is None else machine.pierce.torque(theta, omega, alpha)
    return Signatures(load, direction, torque, (shifted - torque) / _PHASE_STEP, pierce)


def turn_features(
    machine: WatchedTorque,
    sensors: Hypothesis,
    stamps_ns: IntArray,
    torque_Nm: FloatArray,
    states: tuple[FloatArray, FloatArray, FloatArray],
    ends: RangeEnds,
    filtered: Signatures | None = None,
    turn: IntArray | None = None,
) -> TurnFeatures:
    """Features of every turn of the measured samples (n,).

    Args:
        machine: torque of the machine.
        sensors: as the machine declares them.
        stamps_ns, torque_Nm: measured torque.
        states: angle, speed and acceleration of the shaft at each sample less the delay, direction and zero applied.
        ends: finds the torques at an end of their sensor's range.
        filtered: signatures at each sample behind the filter of the sensor; None: it has no filter.
        turn: number of the turn, or of the cycle of a shaft that reverses, of each sample; None: by the shaft angle.
    """
    theta, omega, alpha = states
    whole = np.floor(theta / TURN).astype(np.int64) if turn is None else turn
    slow = slow_speed(omega, whole)
    seen = signatures(machine, theta, omega, alpha, slow) if filtered is None else filtered
    torque = seen.torque
    # At a discontinuity of the load the side is uncertain and a slope is meaningless.
    good = np.isfinite(torque) & np.isfinite(torque_Nm) & ~machine.near_step(theta, omega, 0.002, _JUMP_GUARD_RAD)
    good &= np.abs(omega) > slow
    cut = np.zeros(good.size, np.bool_)
    cut[good] = ends.find(torque_Nm[good])
    cut &= ~_mostly(cut, good, whole)
    good &= ~cut
    columns = sensors.gain * np.stack([seen.load, seen.direction, torque, seen.slope, seen.pierce], axis=1)
    residual = torque_Nm - sensors.gain * torque - sensors.offset_Nm
    turns, first, place = np.unique(whole[good], return_index=True, return_inverse=True)
    cut_off = np.bincount(np.searchsorted(turns, whole[cut]), minlength=turns.size)
    in_time = np.argsort(first)  # a shaft that turns backwards counts its turns down
    turns, first, place = turns[in_time], first[in_time], np.argsort(in_time)[place]
    cut_off = cut_off[in_time].astype(np.int64)
    columns, used = columns[good], residual[good]
    count = np.bincount(place)
    normal = turn_normals(columns, place) / count[:, None, None]
    right = turn_scores(columns, used, place) / count[:, None]
    sizes = _solved(normal, right)
    unexplained = used - np.einsum("nk,nk->n", columns, sizes[place])
    bins = np.minimum((np.mod(theta[good], TURN) * (BINS / TURN)).astype(np.int64), BINS - 1)
    cell = place * BINS + bins
    filled = np.bincount(cell, minlength=turns.size * BINS)
    filled = np.where(filled > 0, filled, np.nan).reshape(turns.size, BINS)

    def means(values: FloatArray) -> FloatArray:
        return np.bincount(cell, weights=values, minlength=turns.size * BINS).reshape(turns.size, BINS) / filled

    same = np.concatenate([[False], np.diff(torque_Nm) == 0.0])[good]
    return TurnFeatures(
        number=turns,
        start_ns=stamps_ns[good][first],
        count=count.astype(np.int64) + cut_off,
        cut_off=cut_off,
        speed_rad_s=_mean_speed(omega[good], place) / count,
        sizes=sizes,
        noise_Nm=np.sqrt(np.bincount(place, weights=unexplained**2) / count),
        profile_Nm=means(unexplained),
        by_angle_Nm=np.stack([means(each) for each in (used, *columns.T)], axis=1),
        rms_Nm=np.sqrt(np.bincount(place, weights=used**2) / count),
        stuck=np.bincount(place, weights=same) / count,
        normal=normal,
        right=right,
    )


def _mean_speed(omega: FloatArray, place: IntArray) -> FloatArray:
    """Sums of the speeds along the path, negative where most of it leads backwards."""
    way, path = np.bincount(place, weights=omega), np.bincount(place, weights=np.abs(omega))
    return np.asarray(np.where(way < -0.5 * path, -path, path))


def _mostly(cut: BoolArray, good: BoolArray, turn: IntArray) -> BoolArray:
    """Mask (n,) of the samples in turns that are mostly at an end, as with a frozen sensor."""
    of_turn = np.unique(turn, return_inverse=True)[1]
    return np.asarray((np.bincount(of_turn, cut) > 0.5 * np.bincount(of_turn, good))[of_turn])


def _solved(normal: FloatArray, right: FloatArray) -> FloatArray:
    """Sizes of the signatures of each turn; one without effect gets 0."""
    if not right.size:
        return right
    scale = np.sqrt(np.mean(np.diagonal(normal, axis1=1, axis2=2), axis=0))
    scale[scale == 0.0] = 1.0
    scaled = normal / (scale[:, None] * scale[None, :]) + 1e-6 * np.eye(scale.size)
    return np.asarray(np.linalg.solve(scaled, (right / scale)[..., None])[..., 0] / scale)
