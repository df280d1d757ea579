"""Intensities of loads as steps over phase and direction, each at its exact shaft angle, without kinematics."""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import pairwise

from textile_twin_core.expression import Expr, at_least, const, sign, substitute, topological_order, variable
from textile_twin_core.expression.scalar import compile_scalar
from textile_twin_core.machine.events import crossings
from textile_twin_core.twin.linear_form import depends_on

PHASE = variable("phase")
"""Wrapped shaft angle, from half an interval below 0 to half an interval below 2 pi [rad]."""
DIRECTION = variable("direction")
"""Direction of rotation: the sign of the shaft speed."""
_BELOW_ORIGIN = 0.1
_ONLY_THETA = {"theta"}
_PIECEWISE = {"phase", "direction"}


def as_phase_steps(intensity: Expr) -> list[tuple[Expr, Expr]] | None:
    """Write the intensity as a sum of products: (function of phase and direction, function of speed and acceleration).

    Every discontinuity over the angle becomes a comparison of the phase.

    Returns:
        The factors; None if a smooth function of the angle, or a step that depends on angle and speed together,
            remains.
    """
    split = _split_signs(intensity)
    pieces: dict[Expr, Expr] = {sign(variable("omega")): DIRECTION}
    for node in reversed(topological_order([split])):  # largest pieces first
        if depends_on(node) == _ONLY_THETA and _is_staircase(node):
            pieces[node] = _steps(node)
    (result,) = substitute([split], pieces)
    return None if "theta" in depends_on(result) else _products(result)


def _products(expression: Expr) -> list[tuple[Expr, Expr]] | None:
    """Expand an expression into products of a function of phase and direction and one without them."""
    needs = depends_on(expression)
    if needs <= _PIECEWISE:
        return [(expression, const(1.0))]
    if not needs & _PIECEWISE:
        return [(const(1.0), expression)]
    parts = [_products(a) for a in expression.args]
    sums = [part for part in parts if part is not None]
    if len(sums) < len(parts):
        return None
    if expression.op == "mul":
        return [(a * c, b * d) for a, b in sums[0] for c, d in sums[1]]
    if expression.op == "add":
        return sums[0] + sums[1]
    if expression.op == "sub":
        return sums[0] + [(-a, b) for a, b in sums[1]]
    if expression.op == "neg":
        return [(-a, b) for a, b in sums[0]]
    return None


def _split_signs(expression: Expr) -> Expr:
    """Rewrite sign(f(theta) g) as sign(f) sign(g), and group the factors of theta alone."""
    parts: dict[Expr, Expr] = {}
    for node in topological_order([expression]):
        if node.op == "sign" and node.args[0].op in ("mul", "neg"):
            parts[node] = _product(sign(factor) for factor in _factors(node.args[0]))
    (split,) = substitute([expression], parts)
    if split.op not in ("mul", "neg"):
        return split
    factors = _factors(split)
    of_theta = _product(f for f in factors if depends_on(f) == _ONLY_THETA)
    return of_theta * _product(f for f in factors if depends_on(f) != _ONLY_THETA)


def _product(factors: Iterable[Expr]) -> Expr:
    result = const(1.0)
    for factor in factors:
        result *= factor
    return result


def _factors(product: Expr) -> list[Expr]:
    """Return the factors of a product; a sub-product of theta alone stays whole."""
    if product.op == "mul" and depends_on(product) != _ONLY_THETA:
        return [f for a in product.args for f in _factors(a)]
    if product.op == "neg":
        return [const(-1.0), *_factors(product.args[0])]
    return [product]


def _step_levels(expression: Expr) -> list[Expr]:
    """Return the levels whose zero crossings are discontinuities of an expression; empty for a smooth one."""
    levels = []
    for node in topological_order([expression]):
        if node.op == "sign":
            levels.append(node.args[0])
        elif node.op == "at_least":
            levels.append(node.args[0] - node.args[1])
    return levels


def _is_staircase(expression: Expr) -> bool:
    """Return true if the angle enters through sign and at_least alone, so that the value changes in steps."""
    if expression.op in ("sign", "at_least", "const"):
        return True
    return bool(expression.args) and all(_is_staircase(a) for a in expression.args)


def _steps(staircase: Expr) -> Expr:
    """Write a staircase over theta as a sum of comparisons of the phase, one per discontinuity."""
    edges = sorted({angle for level in _step_levels(staircase) for side in crossings(level) for angle in side})
    edges = [a - 2.0 * math.pi for a in edges if a > 2.0 * math.pi - _BELOW_ORIGIN] + edges
    function = compile_scalar([staircase], ["theta"])
    heights = [function(0.5 * (a + b))[0] for a, b in pairwise([-_BELOW_ORIGIN, *edges, 2.0 * math.pi])]
    result = const(heights[0])
    for angle, (before, after) in zip(edges, pairwise(heights), strict=True):
        result += (after - before) * at_least(PHASE, angle)
    return result
