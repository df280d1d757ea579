"""Pitch errors of the engine's teeth, from the recordings alone."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import BSpline
from scipy.optimize import linprog

from tests.benchmarks.engine_records import PITCH_RAD, TEETH, EngineRun

_KNOTS_A_TURN = 15
_SHARED_ORDERS = 6
_SHARE = 0.1  # directions of the pitch errors that the motion explains to all but this share stay zero


def calibrated(run: EngineRun, pitch_rad: np.ndarray) -> np.ndarray:
    """(n,) the angles of a run with the pitch errors put in: where the teeth really stand."""
    return np.asarray(run.angle_rad + pitch_rad[run.tooth])


def pitch_errors(runs: list[EngineRun]) -> np.ndarray:
    """(57,) how far each tooth stands ahead of its nominal place [rad].

    In each run angle plus pitch error is a smooth function of time: a cubic spline with a knot every 24 degrees, and
    both by least squares at once; the median over runs. Orders 0 to 6 of the turn are motion as well as pitch: of the
    sets that differ by such orders, the one with the least sum of magnitudes (a tooth or two stand wrong, not all).
    """
    middle = np.median([_run_pitch(run) for run in runs], axis=0)
    waves = np.outer(np.arange(TEETH) * PITCH_RAD, np.arange(_SHARED_ORDERS + 1))
    table = np.concatenate([np.cos(waves), np.sin(waves[:, 1:])], axis=1)
    n, one = table.shape[1], np.eye(TEETH)
    answer = linprog(
        np.r_[np.zeros(n), np.ones(TEETH)],
        A_ub=np.block([[table, -one], [-table, -one]]),
        b_ub=np.r_[middle, -middle],
        bounds=[(None, None)] * n + [(0.0, None)] * TEETH,
    )
    return np.asarray(middle - table @ answer.x[:n])


def one_pass_pitch_errors(runs: list[EngineRun]) -> np.ndarray:
    """(57,) the mere deviation from a spline of 16 knots a turn: half of the worst tooth's error is left in."""
    return np.asarray(np.median([_deviation(run) for run in runs], axis=0))


def _deviation(run: EngineRun) -> np.ndarray:
    q, _ = np.linalg.qr(_splines(run, 16))
    rest = q @ (q.T @ run.angle_rad) - run.angle_rad
    return np.array([np.median(rest[run.tooth == tooth]) for tooth in range(TEETH)])


def _run_pitch(run: EngineRun) -> np.ndarray:
    q, _ = np.linalg.qr(_splines(run, _KNOTS_A_TURN))
    teeth = np.eye(TEETH)[run.tooth]
    answer = np.linalg.lstsq(teeth - q @ (q.T @ teeth), q @ (q.T @ run.angle_rad) - run.angle_rad, rcond=_SHARE)
    return np.asarray(answer[0])


def _splines(run: EngineRun, knots_a_turn: int) -> np.ndarray:
    """(n, m) cubic B-splines over the times of the teeth."""
    turns = (run.angle_rad[-1] - run.angle_rad[0]) / (2.0 * np.pi)
    knots = np.linspace(run.time_s[0], run.time_s[-1], int(turns * knots_a_turn) + 1)
    ends = np.r_[[knots[0]] * 3, knots, [knots[-1]] * 3]
    return np.asarray(BSpline.design_matrix(run.time_s, ends, 3).toarray())
