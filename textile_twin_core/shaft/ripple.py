"""How the shaft moves: a speed level with a drive's response to load, rippled by harmonics of the shaft angle.

    theta' = v (1 + h(theta)),   h = sum over orders k of  a_k cos(k theta) + b_k sin(k theta)
    v = V + w,   V' = U,   U' = white noise (intensity adapted)
    w'' = -2 w'/T - w/T^2 + impulses              (a drive that pulls the speed back after a load knock)

The state is (theta, V, U, w, w', log T, a_k, b_k, ...). The ripple belongs to the angle since it comes from the inertia
and the loads of the mechanism; V, U and w carry what does not repeat.
"""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.arrays import FloatArray

THETA, LEVEL, SLOPE, DIP, DIP_RATE, LOG_RESPONSE, FIRST_RIPPLE = range(7)
LOG_SHORTEST, LOG_LONGEST = math.log(0.004), math.log(1.0)
"""Bounds of log T [T in s]."""


class Ripple:
    """Values of the ripple h and its derivatives at one angle; sums by recurrence in plain floats.

    Attributes:
        value: 1 + h.
        slope: h'.
        bend: h''.
        basis: [cos k1 theta, sin k1 theta, cos k2 theta, ...].
        basis_slope: its derivative.
    """

    __slots__ = ("basis", "basis_slope", "bend", "slope", "value")

    def __init__(self, theta: float, orders: list[int], coefficients: list[float]) -> None:
        value, slope, bend = 1.0, 0.0, 0.0
        basis: list[float] = []
        basis_slope: list[float] = []
        at = 0
        for k in orders:
            c, s = math.cos(k * theta), math.sin(k * theta)
            a, b = coefficients[at], coefficients[at + 1]
            at += 2
            wave, turned = a * c + b * s, b * c - a * s
            value += wave
            slope += k * turned
            bend -= k * k * wave
            basis += (c, s)
            basis_slope += (-k * s, k * c)
        self.value, self.slope, self.bend = value, slope, bend
        self.basis, self.basis_slope = basis, basis_slope


def advance(state: list[float], ripple: Ripple, step: float, transition: FloatArray) -> None:
    """Move the state on by `step` seconds in place and fill its transition matrix (identity elsewhere).

    The angle by a Taylor series of third order, V, U, w exactly; the derivatives of the angle at mid-step.
    """
    level, slope, dip, rate, log_response = state[1:FIRST_RIPPLE]
    response = math.exp(min(max(log_response, LOG_SHORTEST), LOG_LONGEST))
    v, u = level + dip, slope + rate
    pull = -(dip / response + 2.0 * rate) / response
    h, h1, h2 = ripple.value, ripple.slope, ripple.bend
    omega = v * h
    alpha = u * h + v * h1 * omega
    jerk = pull * h + 2.0 * u * h1 * omega + v * (h2 * omega * omega + h1 * alpha)
    moved = step * (omega + step / 2.0 * (alpha + step / 3.0 * jerk))
    half = moved / 2.0
    mid = h + h1 * half
    decay = math.exp(-step / response)
    part = step / response
    together = dip / response + rate
    travel = (v + u * step / 2.0) * step
    transition[THETA] = [
        1.0 + v * (h1 + h2 * half) * step,
        step * mid,
        step * step / 2.0 * mid,
        response * (2.0 - (2.0 + part) * decay) * mid,
        response * response * (1.0 - (1.0 + part) * decay) * mid,
        decay * step * step * part / 3.0 * together * mid,
        *[travel * (b + d * half) for b, d in zip(ripple.basis, ripple.basis_slope, strict=True)],
    ]
    transition[LEVEL, SLOPE] = step
    transition[DIP:LOG_RESPONSE, DIP:FIRST_RIPPLE] = (
        ((1.0 + part) * decay, step * decay, decay * step * part * together),
        (-part / response * decay, (1.0 - part) * decay, decay * part * (2.0 - part) * together),
    )
    state[THETA] += moved
    state[LEVEL] = level + step * slope
    state[DIP] = ((1.0 + part) * dip + step * rate) * decay
    state[DIP_RATE] = (-part / response * dip + (1.0 - part) * rate) * decay


def observe(state: list[float], ripple: Ripple, gradient: FloatArray) -> tuple[float, float, float]:
    """(theta, omega, alpha) of a state; fills the (3, n) gradient."""
    theta, level, slope, dip, rate = state[:LOG_RESPONSE]
    v, u = level + dip, slope + rate
    h, h1, h2 = ripple.value, ripple.slope, ripple.bend
    omega = v * h
    alpha = u * h + v * h1 * omega
    gradient[1] = [v * h1, h, 0.0, h, 0.0, 0.0, *[v * b for b in ripple.basis]]
    by_theta, by_speed = u * h1 + v * v * (h1 * h1 + h * h2), 2.0 * v * h * h1
    by_value, by_slope = u + v * v * h1, v * v * h
    by_ripple = [by_value * b + by_slope * d for b, d in zip(ripple.basis, ripple.basis_slope, strict=True)]
    gradient[2] = [by_theta, by_speed, h, by_speed, h, 0.0, *by_ripple]
    return theta, omega, alpha


def blank_gradient(size: int) -> FloatArray:
    """A (3, n) gradient for `observe` with its constant row in place."""
    gradient = np.zeros((3, size))
    gradient[0, THETA] = 1.0
    return gradient
