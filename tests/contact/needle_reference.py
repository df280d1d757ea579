"""The needle transfer's forward stroke with 30 digits, written for this machine without code of the package.

Equations 13 and 14 of Pejchar and Beran (2011) are solved by their own Taylor series in steps of 50 to 300
microseconds; the four conditions (pin, cone, pad, contact of F and G) are flags.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import mpmath as mp

ORDER = 24
ZERO = mp.mpf(0)


def number(text: str) -> mp.mpf:
    return mp.mpf(text)


@dataclass
class Stroke:
    """One run; `events` are (time [s], name) in order."""

    start_2: str
    pad: str
    law: str
    length: str
    duration: str
    restitution: str = "0.6"
    contacts: int = 4
    """F-G is followed up to so many impacts"""
    events: list[tuple[mp.mpf, str]] = field(default_factory=list)
    largest_deceleration_s: mp.mpf = ZERO
    leaves_pin_m: mp.mpf = ZERO
    h: mp.mpf = ZERO

    def series_1(self, t: mp.mpf, h: mp.mpf) -> list[mp.mpf]:
        """Taylor coefficients of x_1 at t in powers of u, over a step h."""
        rise, whole = number(self.length), number(self.duration)
        coefficients = [mp.mpf(0)] * (ORDER + 1)
        if t >= whole:
            coefficients[0] = rise
            return coefficients
        s = t / whole
        if self.law == "cycloidal":
            parts = (mp.mpf(0), mp.mpf(1), -1 / (2 * mp.pi), 2 * mp.pi, mp.mpf(0))
        else:
            f = 1 / (4 + mp.pi)
            if s < mp.mpf(1) / 8:
                parts = (mp.mpf(0), mp.pi * f, -f / 4, 4 * mp.pi, mp.mpf(0))
            elif s < mp.mpf(7) / 8:
                parts = (2 * f, mp.pi * f, -9 * f / 4, 4 * mp.pi / 3, mp.pi / 3)
            else:
                parts = (4 * f, mp.pi * f, -f / 4, 4 * mp.pi, mp.mpf(0))
        base, slope, wave, w, phase = parts
        coefficients[0] = rise * (base + slope * s)
        coefficients[1] = rise * slope * h / whole
        step = w * h / whole
        scale = mp.mpf(1)
        for k in range(ORDER + 1):
            coefficients[k] += rise * wave * scale * mp.sin(w * s + phase + k * mp.pi / 2)
            scale *= step / (k + 1)
        return coefficients

    def run(self, until: str) -> Stroke:
        """Integrate from standstill to `until` seconds."""
        x2, v2, x3, v3 = number(self.start_2), mp.mpf(0), number("0.0929"), mp.mpf(0)
        pin, cone, pad = True, True, False
        t, end = mp.mpf(0), number(until)
        whole = number(self.duration)
        breaks = [whole / 8, 7 * whole / 8, whole, end]
        while t < end and [name for _, name in self.events].count("F-G") < self.contacts:
            h = mp.mpf("5e-5") if pad else mp.mpf("3e-4")
            ahead = [b for b in breaks if b > t]
            h = min(h, ahead[0] - t)
            x1 = self.series_1(t, h)
            a2, a3, forces = self.bodies(x1, h, (x2, v2, x3, v3), pin, cone, pad)
            watch = self.watch(x1, a2, a3, forces, pin, cone, pad)
            found = [(first_negative(p), name) for name, p in watch.items()]
            hits = [(u, name) for u, name in found if u is not None]
            u, name = min(hits) if hits else (mp.mpf(1), "")
            self.extremes(t, h, u, x1, a2, pad)
            t = ahead[0] if not name and h == ahead[0] - t else t + u * h
            x2, x3 = at(a2, u), at(a3, u)
            v1, v2, v3 = (at(slope(p), u) / h for p in (x1, a2, a3))
            if name:
                self.events.append((t, name))
            if name == "pin released":
                pin = False
            elif name == "pin hit":
                pin, v2 = True, v1
            elif name == "cone released":
                cone = False
            elif name == "cone hit":
                cone, v3 = True, v1
            elif name == "pad touched":
                pad, pin = True, False
            elif name == "pad left":
                pad = False
            elif name == "F-G":
                e, m2, m3 = number(self.restitution), M2, M3
                impulse = (1 + e) * (v3 - v2) / (1 / m2 + 1 / m3)
                v2, v3 = v2 + impulse / m2, v3 - impulse / m3
                cone = False
                x3 = x2 + number("0.0547") - number("0.0268")
        return self

    def bodies(
        self,
        x1: list[mp.mpf],
        h: mp.mpf,
        state: tuple[mp.mpf, mp.mpf, mp.mpf, mp.mpf],
        pin: bool,
        cone: bool,
        pad: bool,
    ) -> tuple[list[mp.mpf], list[mp.mpf], tuple[list[mp.mpf], list[mp.mpf]]]:
        """Compute the series of x_2 and x_3, and of the forces on them other than those of pin and cone."""
        a2, a3 = [state[0], state[1] * h], [state[2], state[3] * h]
        if pin:
            a2 = [c + (number(self.start_2) if k == 0 else 0) for k, c in enumerate(x1)]
        if cone:
            a3 = [c + (number("0.0929") if k == 0 else 0) for k, c in enumerate(x1)]
        deep: list[mp.mpf] = []
        square: list[mp.mpf] = []
        f2: list[mp.mpf] = []
        f3: list[mp.mpf] = []
        for k in range(ORDER - 1):
            one = mp.mpf(1 if k == 0 else 0)
            s1 = a2[k] - x1[k] - one * number("0.089")
            s2 = a3[k] - a2[k] - one * (number("0.0292") + number("0.0081"))
            r1 = (k + 1) * (a2[k + 1] - x1[k + 1]) / h
            r2 = (k + 1) * (a3[k + 1] - a2[k + 1]) / h
            pull = 690 * s2 + number("3.32") * r2
            force = -900 * s1 - number("13.16") * r1 + pull
            if pad:
                deep.append(1000 * (a2[k] - one * number(self.pad)))
                square.append(mp.fsum(deep[i] * deep[k - i] for i in range(k + 1)))
                cube = mp.fsum(square[i] * deep[k - i] for i in range(k + 1))
                force -= number("1573.9") * cube - number("2e-10") * square[k] + number("445.17") * deep[k]
                force -= number("28.5") * (k + 1) * a2[k + 1] / h
            f2.append(force)
            f3.append(-pull)
            grow = h * h / ((k + 1) * (k + 2))
            if not pin:
                a2.append(f2[k] / M2 * grow)
            if not cone:
                a3.append(f3[k] / M3 * grow)
        self.h = h
        return a2, a3, (f2, f3)

    def watch(
        self,
        x1: list[mp.mpf],
        a2: list[mp.mpf],
        a3: list[mp.mpf],
        forces: tuple[list[mp.mpf], list[mp.mpf]],
        pin: bool,
        cone: bool,
        pad: bool,
    ) -> dict[str, list[mp.mpf]]:
        """Return functions that turn negative at an event."""
        bend = [c / self.h**2 for c in slope(slope(x1))]
        found: dict[str, list[mp.mpf]] = {}
        if pin:
            found["pin released"] = [f - M2 * b for f, b in zip(forces[0], bend, strict=True)]
        else:
            found["pin hit"] = minus(x1, a2, number(self.start_2))
        if cone:
            found["cone released"] = [f - M3 * b for f, b in zip(forces[1], bend, strict=True)]
        else:
            found["cone hit"] = minus(x1, a3, number("0.0929"))
        if pad:
            found["pad left"] = minus(a2, [number(self.pad)], mp.mpf(0))
        else:
            found["pad touched"] = minus([number(self.pad)], a2, mp.mpf(0))
        found["F-G"] = minus(a2, a3, number("0.0547") - number("0.0268"))
        return found

    def extremes(self, t: mp.mpf, h: mp.mpf, u: mp.mpf, x1: list[mp.mpf], a2: list[mp.mpf], pad: bool) -> None:
        """Record the first largest deceleration of element 2 on the pad, and its earlier gap from the pin."""
        touches = [name for _, name in self.events].count("pad touched")
        if pad and touches == 1:
            jerk = slope(slope(slope(a2)))
            turn = first_negative([-c for c in jerk])
            if turn is not None and turn <= u and self.largest_deceleration_s == 0:
                self.largest_deceleration_s = t + turn * h
        if touches == 0:
            for k in range(11):
                gap = number(self.start_2) + at(x1, u * k / 10) - at(a2, u * k / 10)
                self.leaves_pin_m = max(self.leaves_pin_m, gap)


M2, M3 = mp.mpf("0.0426"), mp.mpf("0.0051")


def at(p: list[mp.mpf], u: mp.mpf) -> mp.mpf:
    total = mp.mpf(0)
    for c in reversed(p):
        total = total * u + c
    return total


def slope(p: list[mp.mpf]) -> list[mp.mpf]:
    return [k * c for k, c in enumerate(p)][1:]


def minus(a: list[mp.mpf], b: list[mp.mpf], constant: mp.mpf) -> list[mp.mpf]:
    """constant + a - b."""
    size = max(len(a), len(b))
    result = [(a[k] if k < len(a) else 0) - (b[k] if k < len(b) else 0) for k in range(size)]
    result[0] += constant
    return result


def first_negative(p: list[mp.mpf]) -> mp.mpf | None:
    """Find the first u in (0, 1] where p turns negative, on 64 samples; a start within 1e-18 counts as zero."""
    quiet = mp.mpf("1e-18")

    def function(u: mp.mpf) -> mp.mpf:
        return at(p, u)

    before = mp.mpf(0)
    if p[0] < -quiet:
        return mp.mpf(0)
    for k in range(1, 65):
        u = mp.mpf(k) / 64
        if function(u) < -quiet:
            low, high = before, u
            if function(low) <= 0:
                low = u / 2**10
                if function(low) < 0:
                    return mp.mpf(0)
            return mp.findroot(function, (low, high), solver="anderson", tol=mp.mpf("1e-40"), verify=False)
        before = u
    return None
