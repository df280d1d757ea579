"""The order of operations: one in which few results are alive at a time, so that they stay in the cache."""

from __future__ import annotations

import heapq
import random
from collections.abc import Collection, Iterator, Sequence
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
_TRIES, _FEWEST_TRIES, _TRIED = 12, 2, 10_000
"""Greedy orders tried: at most, at least, and times the number of steps."""
_LARGEST = 5000
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

    The cheapest that a beam search finds, which follows the best beginnings side by side, or greedy tries, which serve
    larger graphs better: what frees most comes first, then what was met last. Very large graphs keep the order of their
    definition.
    """
    order = topological_order(outputs)
    inner = [node for node in order if node.op not in _LEAVES and node not in joined]
    if len(inner) <= _LARGEST:
        steps = _Steps(_steps(inner, set(outputs), joined))
        rng = random.Random(1)
        count = max(_FEWEST_TRIES, min(_TRIES, _TRIED // max(len(inner), 1)))
        tries = [_greedy(steps, rng) for _ in range(count)]
        best = min([_as_defined(steps), _beam(steps), *tries])
        inner = [e for n in best.numbers() for e in steps.all[n].results]
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


class _Steps:
    """The steps, and by the number of a step: those it reads, the mask of those that read it, and their numbers."""

    def __init__(self, steps: Sequence[_Step]) -> None:
        self.all = steps
        number = {1 << n: n for n in range(len(steps))}
        self.read = [[number[bit] for bit in _bits(step.needs)] for step in steps]
        self.readers = [0] * len(steps)
        for n, made in enumerate(self.read):
            for k in made:
                self.readers[k] |= 1 << n
        self.users = [[number[bit] for bit in _bits(mask)] for mask in self.readers]
        self.first = [n for n, step in enumerate(steps) if not step.needs]

    def now_ready(self, done: int, last: int) -> list[int]:
        """The steps that may follow because `last` was done."""
        return [n for n in self.users[last] if not self.all[n].needs & ~done]

    def freed(self, n: int, done: int) -> int:
        """How many of the steps that step n reads nobody else waits for, when all of `done` are."""
        return sum(not self.readers[k] & ~done for k in self.read[n])


def _bits(mask: int) -> Iterator[int]:
    while mask:
        bit = mask & -mask
        yield bit
        mask ^= bit


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

    def numbers(self) -> list[int]:
        """The steps in this order."""
        found, order = [], self
        while order.before is not None:
            found.append(order.last)
            order = order.before
        return found[::-1]


_EMPTY: Final = _Order(0, 0, 0, 0, 0, 0, -1, None)


def _then(order: _Order, n: int, steps: _Steps) -> _Order:
    """The order with step n after it."""
    step, done, readers = steps.all[n], order.done | 1 << n, steps.readers
    pending, released, hosted = ~done, 0, False
    for k in steps.read[n]:
        if not readers[k] & pending:  # step n is the last to read it
            released += steps.all[k].kept
            hosted = hosted or bool(step.hosts >> k & 1)
    alive = order.alive - released + step.kept
    copied = step.joins and not hosted
    at_once = order.alive + step.kept + step.work if step.apart or copied else alive
    most = at_once if at_once > order.most else order.most
    copies = order.copies + copied
    cost = _BUFFER_COST * most + _COPY_COST * copies
    return _Order(cost, alive, order.alive_sum + alive, done, most, copies, n, order)


def _as_defined(steps: _Steps) -> _Order:
    order = _EMPTY
    for n in range(len(steps.all)):
        order = _then(order, n, steps)
    return order


def _beam(steps: _Steps) -> _Order:
    beam, ready = [_EMPTY], {0: steps.first}
    width = max(1, min(_BEAM, _EFFORT // max(len(steps.all), 1) ** 2))
    for _ in steps.all:
        found: dict[int, _Order] = {}
        for order in beam:
            for n in ready[order.done]:
                longer = _then(order, n, steps)
                known = found.get(longer.done)
                if known is None or longer < known:
                    found[longer.done] = longer
        beam = heapq.nsmallest(width, found.values())
        ready = {
            order.done: [n for n in ready[order.before.done] if n != order.last]
            + steps.now_ready(order.done, order.last)
            for order in beam
            if order.before is not None
        }
    return beam[0]


def _greedy(steps: _Steps, rng: random.Random) -> _Order:
    order, met = _EMPTY, dict.fromkeys(range(len(steps.all)), -1)
    ready = {n: rng.random() for n in steps.first}

    def urgency(n: int) -> tuple[int, int, float]:
        freed = steps.freed(n, order.done | 1 << n) - steps.all[n].kept
        return freed, max((met[k] for k in steps.read[n]), default=-1), ready[n]

    for position in range(len(steps.all)):
        n = max(ready, key=urgency)
        del ready[n]
        met[n], order = position, _then(order, n, steps)
        ready.update((k, rng.random()) for k in steps.now_ready(order.done, n))
    return order
