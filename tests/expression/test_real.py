"""Symbolic numbers: a float to every check, an expression of parameters to the graph, and C that gives the same."""

from __future__ import annotations

import math
import shutil
import subprocess
from ctypes import CDLL, POINTER, c_double
from fractions import Fraction
from pathlib import Path

import pytest

from textile_twin_core.expression import (
    Expr,
    absolute,
    at_least,
    atan2,
    const,
    cos,
    interpret,
    real,
    select,
    sign,
    sin,
    sqrt,
    variable,
)
from textile_twin_core.expression.c_source import PLAIN_SINCOS, c_function, hoisted, with_parameters
from textile_twin_core.expression.real import Symbolic, number_of

A, B = Symbolic.parameter("a", 3.0), Symbolic.parameter("b", 4.0)


def value(expr: Expr, **numbers: float) -> float:
    (opened,) = with_parameters([expr], {name: name for name in numbers})
    return float(interpret([opened], numbers, math)[0])


@pytest.mark.parametrize(
    ("number", "law"),
    [
        (2.0 - A * B / 5 + 1, lambda a, b: 3.0 - a * b / 5.0),
        (Fraction(1, 4) * A - B**2, lambda a, b: 0.25 * a - b * b),
        (1.0 / (A + B) - -A, lambda a, b: 1.0 / (a + b) + a),
        (abs(A - B), lambda a, b: abs(a - b)),
        (sum((A, B)), lambda a, b: a + b),
        (real.hypot(A, B), math.hypot),
        (real.atan2(A, B) + real.cos(A) * real.sin(B), lambda a, b: math.atan2(a, b) + math.cos(a) * math.sin(b)),
        (real.acos(A / 5.0) + real.sqrt(B) + real.tan(A), lambda a, b: math.acos(a / 5.0) + math.sqrt(b) + math.tan(a)),
    ],
)
def test_arithmetic_keeps_the_law(number: Symbolic, law: object) -> None:
    assert callable(law)
    assert float(number) == pytest.approx(law(3.0, 4.0), rel=1e-15)
    assert value(number.expr, a=2.5, b=4.5) == pytest.approx(law(2.5, 4.5), rel=1e-14)


def test_a_symbolic_number_is_a_number_to_choices_and_never_left_out() -> None:
    zero = Symbolic.parameter("zero", 0.0)
    assert A < B and max(A, B) is B and math.isfinite(A)
    assert zero and zero != 0.0 and A != 3.0 and Symbolic.parameter("a", 3.0) == A
    assert real.sqrt(4.0) == 2.0 and not isinstance(real.sqrt(4.0), Symbolic)
    assert number_of(const(2.0)) == 2.0 and number_of((A + 1).expr) > 3.9
    with pytest.raises(TypeError):
        number_of(variable("theta"))


@pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")
def test_c_gives_what_the_interpreter_gives(tmp_path: Path) -> None:
    """Every operation, with what follows from parameters alone computed once."""
    x = variable("x")
    parts = [
        sin(A * x) / cos(x) + sqrt(x * x + B), absolute(x - A) - sign(x) * (-x), atan2(x, A * B),
        select(at_least(x, B), A / B, x * x), const(0.1) * x + (A - B),
    ]  # fmt: skip
    taken, (shown,) = hoisted([parts], "c")
    assert all("x" not in repr(e) or e.op == "parameter" for e in taken)
    constants = with_parameters(taken, {"a": "p[0]", "b": "p[1]"})
    source = f"#include <math.h>\n{PLAIN_SINCOS}" + c_function("void fix(const double *p, double *c)", constants, "c")
    source += c_function("void run(const double *c, double x, double *y)", shown, "y")
    (tmp_path / "f.c").write_text(source)
    subprocess.run(["cc", "-shared", "-fPIC", "-O1", "-o", "f.so", "f.c", "-lm"], cwd=tmp_path, check=True)
    library = CDLL(str(tmp_path / "f.so"))
    library.run.argtypes = [POINTER(c_double), c_double, POINTER(c_double)]
    found, held = (c_double * len(parts))(), (c_double * len(taken))()
    for a, b in ((3.0, 4.0), (2.0, 0.7)):
        library.fix((c_double * 2)(a, b), held)
        for at in (-1.3, 0.0, 0.4, 5.0):
            library.run(held, at, found)
            true = interpret(with_parameters(parts, {"a": "a", "b": "b"}), {"a": a, "b": b, "x": at}, math)
            assert list(found) == pytest.approx(true, rel=1e-14, abs=1e-15)
