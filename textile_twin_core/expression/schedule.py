"""The order of operations: one in which few results are alive at a time, so that they stay in the cache."""

from __future__ import annotations

import heapq
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import or_
from typing import Final, NamedTuple

from textile_twin_core.expression.graph import Expr
from textile_twin_core.expression.in_place import APART, SINCOS_WORK, hosts, read_by
from textile_twin_core.expression.traversal import topological_order

_LEAVES: Final = frozenset({"const", "variable"})
_TURNS: Final = frozenset({"sin", "cos"})
_BEAM, _EFFORT = 60, 2_000_000
"""Orders followed at a time: at most, and times the square of the number of steps."""
_LARGEST_SEARCH = 1500
_BUFFER_COST, _COPY_COST = 3, 2
"""What one more buffer and one more copy cost, measured on long arrays."""


@dataclass(frozen=True)
class _Step:
    """An operation, or sine and cosine of one angle at once. A mask has the step's own bit for each step in it."""

    results: tuple[Expr, ...]
    needs: int
    """Mask of the steps whose results it reads."""
    kept: int
    """How many of its results go to buffers, not to an output."""
    apart: bool
    """Whether its results must lie apart from its arguments."""
    work: int
    """Buffers needed while it runs, beside arguments and results."""
    joins: bool
    hosts: int
    """Mask of the steps onto whose result it may write what it joins; without one it needs a copy."""


def schedule(outputs: Sequence[Expr], joined: Collection[Expr] = ()) -> list[Expr]:
    """Every node that the outputs need but the `joined` (see `in_place`), each after its arguments.

    A beam search over the orders: the best so far are followed side by side, one step after the other. Very large
    graphs keep the order of their definition.
    """
    order = topological_order(outputs)
    inner = [node for node in order if node.op not in _LEAVES and node not in joined]
    if len(inner) <= _LARGEST_SEARCH:
        inner = [e for step in _search(_steps(inner, set(outputs), joined)) for e in step.results]
    return [node for node in order if node.op in _LEAVES] + inner


def _steps(nodes: Sequence[Expr], outputs: Collection[Expr], joined: Collection[Expr]) -> list[_Step]:
    together: dict[tuple[str, Expr], list[Expr]] = {}
    for node in nodes:
        together.setdefault(("turn", node.args[0]) if node.op in _TURNS else ("", node), []).append(node)
    bit = {node: 1 << k for k, results in enumerate(together.values()) for node in results}
    steps = []
    for results in together.values():
        node, turn = results[0], results[0].op in _TURNS
        parts = [] if turn else [a for a in node.args if a in joined]
        places = [y for part, y in hosts(node) if part in joined and y not in outputs and node not in outputs]
        steps.append(
            _Step(
                tuple(results),
                needs=reduce(or_, (bit.get(a, 0) for a in read_by(node, joined)), 0),
                kept=sum(e not in outputs for e in results),
                apart=turn or any(e.op in APART for e in (node, *parts)),
                work=SINCOS_WORK + 2 - len(results) if turn else 0,
                joins=bool(parts),
                hosts=reduce(or_, (bit.get(y, 0) for y in places), 0),
            )
        )
    return steps


class _Order(NamedTuple):
    """The first steps of an order: what they cost, how many results are alive after them, and on the way in all."""

    cost: int
    alive: int
    alive_sum: int
    done: int
    most: int
    copies: int
    last: int
    before: _Order | None


def _search(steps: Sequence[_Step]) -> list[_Step]:
    read = [[k for k in range(n) if step.needs >> k & 1] for n, step in enumerate(steps)]
    readers = [0] * len(steps)
    for n, made in enumerate(read):
        for k in made:
            readers[k] |= 1 << n
    users = [[n for n in range(k, len(steps)) if mask >> n & 1] for k, mask in enumerate(readers)]
    beam = [_Order(0, 0, 0, 0, 0, 0, -1, None)]
    ready = {0: [n for n, step in enumerate(steps) if not step.needs]}
    width = max(1, min(_BEAM, _EFFORT // max(len(steps), 1) ** 2))
    for _ in steps:
        found: dict[int, _Order] = {}
        for order in beam:
            for n in ready[order.done]:
                done = order.done | 1 << n
                gone = [k for k in read[n] if not readers[k] & ~done]
                longer = _after(order, n, steps[n], done, gone, sum(steps[k].kept for k in gone))
                known = found.get(done)
                if known is None or longer < known:
                    found[done] = longer
        beam = heapq.nsmallest(width, found.values())
        ready = {
            order.done: [n for n in ready[order.before.done] if n != order.last]
            + [n for n in users[order.last] if not steps[n].needs & ~order.done]
            for order in beam
            if order.before is not None
        }
    best, result = beam[0], []
    while best.before is not None:
        result.append(steps[best.last])
        best = best.before
    return result[::-1]


def _after(order: _Order, n: int, step: _Step, done: int, gone: Sequence[int], released: int) -> _Order:
    alive = order.alive - released + step.kept
    copied = step.joins and not any(step.hosts >> k & 1 for k in gone)
    at_once = order.alive + step.kept + step.work if step.apart or copied else alive
    most, copies = max(order.most, at_once), order.copies + copied
    cost = _BUFFER_COST * most + _COPY_COST * copies
    return _Order(cost, alive, order.alive_sum + alive, done, most, copies, n, order)
