"""The signal that shaft estimators are judged on: rippled speed, knocks, jittered stamps, lost samples, counts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

RIPPLE = ((1, 0.02, 0.7), (2, 0.01, 2.1))


@dataclass
class ShaftSignal:
    """Samples as an encoder gives them, and the truth at their stamps."""

    stamps_ns: np.ndarray
    angles: np.ndarray
    theta: np.ndarray
    omega: np.ndarray
    alpha: np.ndarray
    time: np.ndarray
    knock_times: np.ndarray


def _ripple(theta: np.ndarray, ripple: tuple[tuple[int, float, float], ...]) -> tuple[np.ndarray, np.ndarray]:
    value, slope = np.ones_like(theta), np.zeros_like(theta)
    for order, size, phase in ripple:
        value += size * np.cos(order * theta + phase)
        slope -= order * size * np.sin(order * theta + phase)
    return value, slope


def make_signal(
    seed: int,
    *,
    duration_s: float = 12.0,
    rate_hz: float = 500.0,
    rpm: float = 160.0,
    bits: int | None = 16,
    jitter_s: float = 20e-6,
    dropped: float = 0.05,
    knocks: bool = False,
    knock_rate_hz: float = 1.0,
    knock_size: float = 0.015,
    knock_s: float = 0.04,
    ripple: tuple[tuple[int, float, float], ...] = RIPPLE,
    level: object = None,
    wrapped: bool = True,
) -> ShaftSignal:
    """omega = level(t) * b(t) * ripple(theta); theta by fine RK4, knots at 1/8 of a sample; truth at the stamps."""
    rng = np.random.default_rng(seed)
    mean = rpm * 2 * np.pi / 60
    count = int(duration_s * rate_hz)
    stamps = np.arange(count) / rate_hz
    jitter = rng.normal(0.0, jitter_s, count)
    starts = np.sort(rng.uniform(0, duration_s, rng.poisson(duration_s * knock_rate_hz))) if knocks else np.zeros(0)
    theta0 = rng.uniform(0, 2 * np.pi)

    def level_of(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if level is None:
            base, slope = np.full_like(t, mean), np.zeros_like(t)
        else:
            base, slope = level(t)  # type: ignore[operator]
        b, db = np.ones_like(t), np.zeros_like(t)
        for start in starts:
            d = np.maximum(t - start, 0.0) / knock_s
            b -= knock_size * d * np.exp(1 - d)
            db -= np.where(d > 0, knock_size / knock_s * (1 - d) * np.exp(1 - d), 0.0)
        return base * b, slope * b + base * db

    # theta' = level(t) ripple(theta): separable, so theta = G(integral of the level); integrate the level finely.
    fine = 16
    grid = np.arange(-fine, (count + 1) * fine + 1) / (rate_hz * fine)
    cuts = np.unique(np.concatenate([grid, starts]))
    mid = (cuts[1:] + cuts[:-1]) / 2
    half = np.diff(cuts) / 2
    node = np.sqrt(0.6)
    advance = (
        half / 9 * (5 * level_of(mid - node * half)[0] + 8 * level_of(mid)[0] + 5 * level_of(mid + node * half)[0])
    )
    phase = np.concatenate([[0.0], np.cumsum(advance)])
    phase -= np.interp(0.0, cuts, phase)
    turn = np.linspace(0, 2 * np.pi, 4097)
    inverse = 1 / _ripple(turn[:-1], ripple)[0]
    spectrum = np.fft.rfft(inverse) / 4096
    order = np.arange(1, 41)

    def clock(theta: np.ndarray) -> np.ndarray:
        """The integral of 1 / ripple: grows as the level's integral does."""
        total = spectrum[0].real * theta
        for k, s in zip(order, spectrum[1:41], strict=True):
            total = total + 2 / k * (s.real * np.sin(k * theta) + s.imag * (np.cos(k * theta) - 1))
        return total

    def angle_at(t: np.ndarray) -> np.ndarray:
        index = np.clip(np.searchsorted(cuts, t, side="right") - 1, 0, cuts.size - 2)
        start = cuts[index]
        h2, m2 = (t - start) / 2, (t + start) / 2
        more = h2 / 9 * (5 * level_of(m2 - node * h2)[0] + 8 * level_of(m2)[0] + 5 * level_of(m2 + node * h2)[0])
        target = clock(np.array([theta0]))[0] + phase[index] + more
        theta = target / spectrum[0].real
        for _ in range(20):
            theta = theta - (clock(theta) - target) * _ripple(theta, ripple)[0]
        return theta

    keep = rng.random(count) >= dropped
    keep[:3] = True
    theta = angle_at(stamps)
    seen = angle_at(stamps + jitter)
    if bits is not None:
        step = 2 * np.pi / 2**bits
        seen = np.round(seen / step) * step
    if wrapped:
        seen = np.mod(seen, 2 * np.pi)
    speed, slope = level_of(stamps)
    value, dvalue = _ripple(theta, ripple)
    omega = speed * value
    alpha = slope * value + speed * dvalue * omega
    stamps_ns = np.round(stamps * 1e9).astype(np.int64) + 1_700_000_000_000_000_000
    return ShaftSignal(stamps_ns[keep], seen[keep], theta[keep], omega[keep], alpha[keep], stamps[keep], starts)
