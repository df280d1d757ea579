"""Causal shaft estimation: an extended Kalman filter whose speed ripples with harmonics of the shaft angle."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from textile_twin_core.arrays import FloatArray
from textile_twin_core.shaft.gate import SampleGate, Unwrapper
from textile_twin_core.shaft.report import SampleReport
from textile_twin_core.shaft.states import ShaftStates


class CausalEstimator:
    """first version"""

    def __init__(
        self,
        *,
        harmonics: int = 2,
        encoder_bits: float | None = None,
        resolution_rad: float | None = None,
        stamp_jitter_s: float | None = None,
        wrapping: str = "auto",
        period_rad: float = 2 * math.pi,
        gap_s: float = 1.0,
    ) -> None:
        self._k = harmonics
        if encoder_bits is not None:
            resolution_rad = 2 * math.pi / 2**encoder_bits
        self._resolution = resolution_rad or 0.0
        self._jitter = 20e-6 if stamp_jitter_s is None else stamp_jitter_s
        self._wrapping, self._period, self._gap = wrapping, period_rad, gap_s
        self._orders = np.concatenate([np.arange(1, harmonics + 1), np.arange(1, harmonics + 1)]).astype(float)
        self._phases = np.concatenate([np.zeros(harmonics), np.full(harmonics, math.pi / 2)])
        self.reset()

    def reset(self) -> None:
        self._report = SampleReport()
        self._gate = SampleGate(self._report)
        self._unwrap = Unwrapper(self._wrapping, self._period)
        self._seen = 0
        n = 3 + 2 * self._k
        self._n = n
        self._x = np.zeros(n)
        self._P = np.zeros((n, n))
        self._var = (self._resolution**2) / 12
        self._burst = 0.0
        self._since = 0
        self._typical = 0.0
        self._suspect = False

    @property
    def report(self) -> SampleReport:
        return self._report

    def finish(self) -> ShaftStates:
        return ShaftStates.empty()

    def step(
        self, stamps: npt.ArrayLike, angles: npt.ArrayLike, velocities: npt.ArrayLike | None = None
    ) -> ShaftStates:
        block = self._gate.admit(stamps, angles, velocities)
        rows = np.zeros((len(block), 5))
        cov = np.zeros((len(block), 3, 3))
        skip = max(0, 2 - self._seen)
        for i, (dt, raw) in enumerate(zip(block.step_s.tolist(), block.angles.tolist(), strict=True)):
            self._sample(dt, raw, rows[i], cov[i])
        return ShaftStates.from_rows(block.stamps[skip:], block.index[skip:], rows[skip:], cov[skip:])

    def _start(self, angle: float, keep_ripple: bool) -> None:
        x, P, n = self._x, self._P, self._n
        x[0] = angle
        old = P[3:, 3:].copy() + np.eye(n - 3) * 1e-5
        P[:] = 0
        P[0, 0] = 1e-4
        P[1, 1] = max(100.0, x[1] ** 2)
        x[2] = 0.0
        P[2, 2] = 100.0
        if keep_ripple:
            P[3:, 3:] = old
        else:
            P[3:, 3:] = np.eye(n - 3) * 4e-4
            x[3:] = 0
        self._since = 0

    def _sample(self, dt: float, raw: float, row: FloatArray, cov: FloatArray) -> None:
        x, P = self._x, self._P
        self._seen += 1
        if self._seen == 1:
            self._start(self._unwrap.begin(raw), False)
            return
        if self._seen == 2:
            local = self._unwrap.local(raw, x[0])
            x[1] = (local - x[0]) / dt
            x[0] = local
            P[0, 0] = 1e-5
            P[1, 1] = 2e-5 / dt**2
            self._typical = dt
            return
        gap = dt > self._gap and dt > 10 * self._typical
        if not gap:
            self._typical += 0.01 * (min(dt, 10 * self._typical) - self._typical)
        theta, v, u = x[0], x[1], x[2]
        k, ph, c = self._orders, self._phases, x[3:]
        decay = math.exp(-dt / 0.05)
        ramp = 0.05 * (1 - decay)
        arg = k * theta - ph
        h = 1 + float(c @ np.cos(arg))
        h1 = float((-k * c) @ np.sin(arg))
        h2 = float((-k * k * c) @ np.cos(arg))
        om = v * h
        al = u * h + v * h1 * om
        jerk = -u / 0.05 * h + 2 * u * h1 * om + v * h2 * om * om + v * h1 * al
        delta = dt * (om + dt / 2 * (al + dt / 3 * jerk))
        bm = np.cos(k * (theta + delta / 2) - ph)
        hm = 1 + float(c @ bm)
        F = np.eye(self._n)
        F[0, 0] += v * h1 * dt
        F[0, 1] = dt * hm
        F[0, 2] = dt * dt / 2 * hm
        F[0, 3:] = v * dt * bm
        F[1, 2] = ramp
        F[2, 2] = decay
        if gap:
            self._report.gaps += 1
            local = self._unwrap.local(raw, theta + v * dt)
            self._start(local, True)
        else:
            q = 400.0 / 0.05 * 2 if self._burst > 0 else 1e-3
            P[:] = F @ P @ F.T
            P[2, 2] += q * dt
            P[1, 1] += 1e-6 * dt
            d = np.arange(3, self._n)
            P[d, d] += 1e-10 * dt
            x[0] = theta + delta
            x[1] = v + u * ramp
            x[2] = u * decay
            local = self._unwrap.local(raw, x[0])
        r = self._var + (x[1] * self._jitter) ** 2 + 1e-12
        S = P[0, 0] + r
        nu = local - x[0]
        z = nu / math.sqrt(S)
        if abs(nu) > 0.05 + 8 * math.sqrt(S) and not self._suspect:
            self._suspect = True
            self._report.outliers += 1
        else:
            if self._suspect and abs(nu) > 0.05 + 8 * math.sqrt(S):
                self._report.jumps += 1
                self._report.outliers -= 1
                vel = x[1]
                self._start(local, True)
                x[1] = vel
            else:
                gain = P[:, 0] / S
                x += gain * nu
                P -= np.outer(gain, P[0])
                P[:] = (P + P.T) / 2
            self._suspect = False
            self._z = 0.8 * getattr(self, "_z", 0.0) + z
            if self._z**2 * 0.36 > 12:
                self._burst = 0.1
            else:
                self._burst -= dt
        self._since += 1
        theta, v, u = x[0], x[1], x[2]
        arg = k * theta - ph
        cs, sn = np.cos(arg), np.sin(arg)
        h = 1 + float(c @ cs)
        h1 = float((-k * c) @ sn)
        h2 = float((-k * k * c) @ cs)
        row[0] = theta
        row[1] = v * h
        row[2] = u * h + v * v * h * h1
        row[3] = self._unwrap.origin
        row[4] = self._since > 50
        M = np.zeros((3, self._n))
        M[0, 0] = 1
        M[1, 0], M[1, 1] = v * h1, h
        M[1, 3:] = v * cs
        M[2, 0] = u * h1 + v * v * (h1 * h1 + h * h2)
        M[2, 1] = 2 * v * h * h1
        M[2, 2] = h
        M[2, 3:] = u * cs + v * v * (h1 * cs - h * k * sn)
        cov[:] = M @ P @ M.T
        if abs(theta) > 1e4:
            x[0] = self._unwrap.rebase(theta)
