"""The order of operations: one in which few results are alive at a time, so that they stay in the cache."""

from __future__ import annotations

import random
from collections.abc import Sequence

from textile_twin_core.expression.graph import Expr, topological_order

_TRIES = 40
_LARGEST_SEARCH = 1500
_LEAVES = frozenset({"const", "variable"})


def schedule(outputs: Sequence[Expr]) -> list[Expr]:
    """Every node that the outputs need, each after its arguments.

    Greedy list scheduling (what frees most comes first, then what was met last), the best of some
    tries that break ties by chance, always the same; very large graphs keep the order of their definition.
    """
    order = topological_order(outputs)
    inner = [node for node in order if node.op not in _LEAVES]
    if len(inner) > _LARGEST_SEARCH:
        return order
    rng = random.Random(1)
    tries = [_greedy(inner, set(outputs), rng) for _ in range(_TRIES)]
    best = min([inner, *tries], key=lambda found: _most_alive(found, set(outputs)))
    return [node for node in order if node.op in _LEAVES] + best


def _greedy(nodes: Sequence[Expr], outputs: set[Expr], rng: random.Random) -> list[Expr]:
    inner = set(nodes)
    arguments = {node: [a for a in dict.fromkeys(node.args) if a in inner] for node in nodes}
    users: dict[Expr, list[Expr]] = {node: [] for node in nodes}
    for node in nodes:
        for a in arguments[node]:
            users[a].append(node)
    uses_left = {node: len(users[node]) for node in nodes}
    waits_for = {node: len(arguments[node]) for node in nodes}
    ready = {node: rng.random() for node in nodes if waits_for[node] == 0}
    met: dict[Expr, int] = {}
    order: list[Expr] = []

    def urgency(node: Expr) -> tuple[int, int, float]:
        freed = sum(uses_left[a] == 1 for a in arguments[node])
        latest = max((met[a] for a in arguments[node]), default=-1)
        return freed + (node in outputs), latest, ready[node]

    while ready:
        node = max(ready, key=urgency)
        del ready[node]
        met[node] = len(order)
        order.append(node)
        for a in arguments[node]:
            uses_left[a] -= 1
        for user in users[node]:
            waits_for[user] -= 1
            if waits_for[user] == 0:
                ready[user] = rng.random()
    return order


def _most_alive(order: Sequence[Expr], outputs: set[Expr]) -> int:
    last_use = {a: i for i, node in enumerate(order) for a in node.args}
    alive: set[Expr] = set()
    most = 0
    for i, node in enumerate(order):
        alive.difference_update(a for a in node.args if last_use[a] == i)
        if node not in outputs:
            alive.add(node)
        most = max(most, len(alive))
    return most
