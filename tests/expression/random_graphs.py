"""Random expressions with their values in extended precision and a bound of rounding."""

from __future__ import annotations

import math
from dataclasses import dataclass

import mpmath as mp
from hypothesis import strategies as st

from textile_twin_core.expression import (
    Expr,
    absolute,
    at_least,
    atan2,
    const,
    cos,
    select,
    sign,
    sin,
    sqrt,
    square,
    variable,
)

X, Y = variable("x"), variable("y")
DIGITS = 40
_UNIT = mp.mpf(2) ** -53
_CONSTANTS = (0.0, 1.0, -1.0, 2.0, -2.0, 0.5, -0.5, 0.3, -0.3, 1.7, 3.0, -0.1)
_LARGEST = 1e6


@dataclass(frozen=True)
class Carried:
    """An expression, its value, and a bound of the rounding of its parts."""

    expression: Expr
    value: mp.mpf
    bound: mp.mpf


@dataclass(frozen=True)
class Program:
    """Steps (operation, three places in what was made so far) from x, y and constants, and the values of x and y."""

    steps: tuple[tuple[str, int, int, int], ...]
    x: float
    y: float

    def run(self) -> list[Carried]:
        """Execute the steps; those that would divide by nearly zero, be discontinuous or grow too large are skipped."""
        with mp.workdps(DIGITS):
            made = [Carried(e, mp.mpf(v), mp.mpf(0)) for e, v in ((X, self.x), (Y, self.y))]
            made += [Carried(const(c), mp.mpf(c), mp.mpf(0)) for c in _CONSTANTS]
            for op, *places in self.steps:
                following = _apply(op, *(made[-1 - place % len(made)] for place in places))
                if following is not None and abs(following.value) < _LARGEST:
                    made.append(following)
            return made[2 + len(_CONSTANTS) :]


def programs(most: int = 14) -> st.SearchStrategy[Program]:
    """Random programs; numbers of a machine's size."""
    place = st.one_of(st.integers(0, 3), st.integers(0, 25))  # what was made last, or anything
    step = st.tuples(st.sampled_from(OPERATIONS), place, place, place)
    number = st.floats(-2.0, 2.0).map(lambda value: round(value, 3))
    return st.builds(Program, st.lists(step, min_size=1, max_size=most).map(tuple), number, number)


OPERATIONS = (
    *("add", "sub", "mul", "reached") * 3,
    *("div", "neg", "square", "sqrt", "sin", "cos", "abs", "sign", "at_least", "select", "atan2"),
)


def _apply(op: str, a: Carried, b: Carried, c: Carried) -> Carried | None:
    v, w = a.value, b.value
    made: tuple[Expr, mp.mpf, mp.mpf] | None = None
    match op:
        case "add":
            made = a.expression + b.expression, v + w, a.bound + b.bound + _UNIT * (abs(v) + abs(w))
        case "sub":
            made = a.expression - b.expression, v - w, a.bound + b.bound + _UNIT * (abs(v) + abs(w))
        case "mul":
            made = a.expression * b.expression, v * w, abs(v) * b.bound + abs(w) * a.bound
        case "div" if abs(w) > 0.01:
            made = a.expression / b.expression, v / w, (a.bound + abs(v / w) * b.bound) / abs(w)
        case "neg":
            made = -a.expression, -v, a.bound
        case "square":
            made = square(a.expression), v * v, 2 * abs(v) * a.bound
        case "sqrt" if abs(v) > 0.01:
            root = mp.sqrt((factor := math.copysign(1.7, v)) * v)
            made = sqrt(factor * a.expression), root, 1.7 * a.bound / root
        case "sin":
            made = sin(a.expression), mp.sin(v), a.bound + _UNIT
        case "cos":
            made = cos(a.expression), mp.cos(v), a.bound + _UNIT
        case "abs":
            made = absolute(a.expression), abs(v), a.bound
        case "sign" if abs(v) > 0.001:
            made = sign(a.expression), mp.sign(v), mp.mpf(0)
        case "at_least" if abs(v - w) > 0.001:
            made = at_least(a.expression, b.expression), mp.mpf(v >= w), mp.mpf(0)
        case "reached" if abs((level := (factor := math.copysign(1.7, w)) * v + 0.5) - 0.3) > 0.001:
            made = at_least(factor * a.expression + 0.5, 0.3), mp.mpf(level >= 0.3), mp.mpf(0)
        case "select" if abs(v - 0.3) > 0.001:  # of a condition, which is 0 or 1 around x, too
            chosen = w if v >= 0.3 else c.value
            made = select(at_least(a.expression, 0.3), b.expression, c.expression), chosen, b.bound + c.bound
        case "atan2" if mp.hypot(v, w) > 0.01 and (w > 0.001 or abs(v) > 0.001):
            made = atan2(a.expression, b.expression), mp.atan2(v, w), (a.bound + b.bound) / mp.hypot(v, w) + 4 * _UNIT
    if made is None:
        return None
    return Carried(made[0], made[1], made[2] + _UNIT * abs(made[1]))
