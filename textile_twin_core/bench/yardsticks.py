"""Yardsticks beside the methods: a loop of as many plain operations, and numpy's sine."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from textile_twin_core.bench.scenes import Workload
from textile_twin_core.bench.timing import Candidate
from textile_twin_core.dynamics import INPUTS
from textile_twin_core.expression import Expr, const, variable
from textile_twin_core.expression.graph import node
from textile_twin_core.expression.loop import Loop
from textile_twin_core.expression.traversal import operation_counts

YARDSTICK = "yardstick"
_PLAIN = ("add", "sub", "mul", "square")


def yardsticks(scene: Workload) -> Iterator[Candidate]:
    """Build the yardsticks for scenes of one output, since they write one."""
    if len(scene.outputs) > 1:
        return
    loop, out = (
        Loop([plain_operations([scene.machine.model.output(scene.outputs[0])])], INPUTS),
        np.empty(scene.samples),
    )
    yield Candidate("plain operations", YARDSTICK, batch=lambda: loop(scene.motion, [out]), samples=scene.samples)
    yield Candidate(
        "a pass of np.sin", YARDSTICK, batch=lambda: np.sin(scene.motion[0], out=out), samples=scene.samples
    )


def plain_operations(outputs: Sequence[Expr]) -> Expr:
    """Build an expression with as many sums and products, divisions and roots as the outputs, mostly independent.

    Sums and products are equal in number, and there are no sines.
    """
    counts = operation_counts(outputs)
    slow = ["div"] * counts["div"] + ["sqrt"] * counts["sqrt"]
    chains = [variable(name) for name in INPUTS]
    pairs = (sum(counts[op] for op in _PLAIN) - len(chains) + 1) // 2
    every = max(1, pairs // (len(slow) + 1))
    for k in range(pairs):
        e = node("add", (const(0.4), node("mul", (const(0.9), chains[k % len(chains)]))))
        if slow and k % every == every - 1:
            e = node("sqrt", (e,)) if slow.pop() == "sqrt" else node("div", (const(1.0), e))
        chains[k % len(chains)] = e
    first, *others = chains
    for e in others:
        first = node("add", (first, e))
    return first
