"""What an array operation needs beside its arguments.

y + c x, y sign(x) and y at_least(x, z) are done in the place of y; the multiple c x and the switch (sign, at_least)
are then `joined` to the operation and have no array of their own. So is the half of an angle in sin(x / 2).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Final

from textile_twin_core.expression.graph import Expr

SINCOS_WORK: Final = 4
"""Arrays that sine and cosine together need beside their results."""
_POWERS_OF_TWO: Final = frozenset(2.0**k for k in range(-10, 11))
"""Factors of an angle that sine and cosine take in."""
APART: Final = frozenset({"select", "sign"})
"""Operations of several steps, which must not write onto their own arguments; every other may."""


def hosts(node: Expr) -> list[tuple[Expr, Expr]]:
    """The ways to see a node as y + c x, y - c x or y times a switch: (c x or the switch, y)."""
    if node.op not in ("add", "sub", "mul") or _is_multiple(node):
        return []
    joins = _is_switch if node.op == "mul" else _is_multiple
    a, b = node.args
    return [(part, y) for part, y in ((b, a), (a, b)) if joins(part) and (part is b or node.op != "sub")]


def joinable(order: Sequence[Expr], outputs: Collection[Expr]) -> set[Expr]:
    """What every operation that needs it can do without an array for it; a switch, if one product alone needs it."""
    users: dict[Expr, list[Expr]] = {}
    for node in order:
        for a in node.args:
            users.setdefault(a, []).append(node)
    return {
        node
        for node in order
        if node not in outputs
        and (_is_multiple(node) or (_is_switch(node) and len(users[node]) == 1))
        and all(_takes_in(user, node) for user in users[node])
    }


def _takes_in(user: Expr, part: Expr) -> bool:
    if user.op in ("sin", "cos"):
        return _is_multiple(part) and part.args[0].value in _POWERS_OF_TWO
    return any(joined is part for joined, _ in hosts(user))


def read_by(node: Expr, joined: Collection[Expr]) -> list[Expr]:
    """What must be at hand for a node: its arguments, and what the `joined` among them are made of."""
    return [b for a in node.args for b in ((a, *a.args) if a in joined else (a,))]


def _is_multiple(node: Expr) -> bool:
    return node.op == "mul" and node.args[0].is_constant


def _is_switch(node: Expr) -> bool:
    return node.op in ("sign", "at_least")
