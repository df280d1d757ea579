"""Scalar expressions of the shaft state: written once by the mechanics, evaluated by several back ends.

The groups of a mechanism write their closed forms with these expressions. One graph serves plain floats (`scalar`),
long arrays (`loop`, compiled), any other number type such as mpmath's (`interpret`), and exact partial derivatives.
Nodes that an output does not need are never evaluated.
"""

from textile_twin_core.expression.graph import Expr, const, variable
from textile_twin_core.expression.interpret import interpret
from textile_twin_core.expression.operations import absolute, at_least, atan2, cos, select, sign, sin, sqrt, square
from textile_twin_core.expression.piecewise_polynomial import piecewise
from textile_twin_core.expression.traversal import derivative, substitute, topological_order

__all__ = [
    "Expr",
    "absolute",
    "at_least",
    "atan2",
    "const",
    "cos",
    "derivative",
    "interpret",
    "piecewise",
    "select",
    "sign",
    "sin",
    "sqrt",
    "square",
    "substitute",
    "topological_order",
    "variable",
]
