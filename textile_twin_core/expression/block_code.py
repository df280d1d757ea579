"""Source code of array programs: one line per operation, and which buffer each result goes to.

A sum with a multiple, y + c x, is one operation (BLAS's axpy) where this sum alone needs c x and y lies in a buffer and
is not needed any more. What else is asked for may so change the last digit.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

from textile_twin_core.expression.graph import Expr, topological_order
from textile_twin_core.expression.schedule import schedule

_SINCOS_WORK = 4
_APART = frozenset({"select", "sign"})
"""Operations of several steps, which must not write onto their own arguments."""


@dataclass(frozen=True)
class BlockCode:
    """A function `run(inputs, outputs, buffers, constants)` as text, with what it needs."""

    source: str
    constants: tuple[float, ...]
    buffers: int
    operations: int


def write_block_code(
    outputs: Sequence[Expr], inputs: Sequence[str], arranged: bool, join_multiples: bool = True
) -> BlockCode:
    """One line per operation of what the outputs need, `arranged` so that few buffers serve.

    With `join_multiples` the function takes at most `blas.SERIAL` samples.
    """
    order = schedule(outputs) if arranged else topological_order(outputs)
    return _Writer(list(outputs), tuple(inputs), join_multiples).write(order)


@dataclass
class _Writer:
    outputs: list[Expr]
    inputs: tuple[str, ...]
    join_multiples: bool
    place: dict[Expr, str] = field(default_factory=dict)
    constants: dict[Expr, str] = field(default_factory=dict)
    lines: list[str] = field(default_factory=list)
    free: list[int] = field(default_factory=list)
    held: dict[Expr, int] = field(default_factory=dict)
    multiples: set[Expr] = field(default_factory=set)
    buffers: int = 0
    operations: int = 0

    def write(self, order: Sequence[Expr]) -> BlockCode:
        self.target = {e: f"o{k}" for k, e in reversed(list(enumerate(self.outputs)))}
        self.partner = _partners(order)
        self.multiples = _multiples(order, self.target) if self.join_multiples else set()
        self.last_use = {a: i for i, node in enumerate(order) for a in self._read_by(node)}
        for i, node in enumerate(order):
            if node not in self.place and node not in self.multiples:
                self._write_node(i, node)
        for k, e in enumerate(self.outputs):
            if self.place[e] != f"o{k}":
                self.lines.append(f"    np_copy(o{k}, {self.place[e]})")
        header = [
            "def run(inputs, outputs, buffers, constants):",
            f"    {', '.join(self.inputs)}, = inputs",
            f"    n = {self.inputs[0]}.size",
            f"    {', '.join(f'o{k}' for k in range(len(self.outputs)))}, = outputs",
        ]
        if self.buffers:
            header.append(f"    {', '.join(f'b{k}' for k in range(self.buffers))}, = buffers")
        if self.constants:
            header.append(f"    {', '.join(self.constants.values())}, = constants")
        source = "\n".join([*header, *self.lines, "    return None"])
        return BlockCode(source, tuple(e.value for e in self.constants), self.buffers, self.operations)

    def _write_node(self, number: int, node: Expr) -> None:
        if node.op == "const":
            self.constants[node] = self.place[node] = f"c{len(self.constants)}"
        elif node.op == "variable":
            self.place[node] = str(node.payload)
        elif node.op in ("sin", "cos"):
            self._write_sincos(node)
        elif not self._add_multiple(number, node):
            for a in node.args:
                if a in self.multiples and a not in self.place:
                    self._write_operation(number, a)
            self._write_operation(number, node)

    def _write_operation(self, number: int, node: Expr) -> None:
        arguments = [self.place[a] for a in node.args]
        released = [self.held.pop(a) for a in dict.fromkeys(node.args) if self.last_use[a] == number and a in self.held]
        if node.op not in _APART:  # every ufunc may write onto its own argument
            self.free.extend(released)
        self._settle(node)
        if node.op in _APART:
            self.free.extend(released)
        self._line(f"np_{node.op}", [*arguments, self.place[node]])

    def _add_multiple(self, number: int, node: Expr) -> bool:
        """Write y + c x onto y, if the node is such a sum and y goes; whether it was."""
        for multiple, y, sense in _sums(node):
            if multiple not in self.multiples or node in self.target:
                continue
            factor, x = multiple.args
            if y in self.held and self.last_use[y] == number and y is not x:
                self.held[node] = self.held.pop(y)
                self.place[node] = self.place[y]
                self._line("add_multiple", [self.place[x], self.place[y], "n", repr(sense * factor.value)])
                if self.last_use[x] == number and x in self.held:
                    self.free.append(self.held.pop(x))
                return True
        return False

    def _read_by(self, node: Expr) -> list[Expr]:
        """What must be at hand for a node: multiples are not written before their sum."""
        if node in self.multiples:
            return []
        return [b for a in node.args for b in ((a, *a.args) if a in self.multiples else (a,))]

    def _write_sincos(self, node: Expr) -> None:
        """Sine and cosine of one angle together; the partner is at hand when its turn comes."""
        argument = self.place[node.args[0]]
        pair = self.partner[node.args[0]]
        for e in pair.values():
            self._settle(e)
        work = [self._take_buffer() for _ in range(_SINCOS_WORK + 2 - len(pair))]
        spare = [f"b{k}" for k in work]
        results = [self.place[pair[op]] if op in pair else spare.pop() for op in ("sin", "cos")]
        self._line("np_sincos", [argument, *results, f"[{', '.join(spare)}]"])
        self.free.extend(work)

    def _settle(self, node: Expr) -> None:
        """Give a result its place: an output's array or a buffer."""
        if node in self.target:
            self.place[node] = self.target[node]
        else:
            self.held[node] = self._take_buffer()
            self.place[node] = f"b{self.held[node]}"

    def _take_buffer(self) -> int:
        if not self.free:
            self.free.append(self.buffers)
            self.buffers += 1
        return self.free.pop()

    def _line(self, function: str, arguments: Sequence[str]) -> None:
        self.operations += 1
        self.lines.append(f"    {function}({', '.join(arguments)})")


def _sums(node: Expr) -> list[tuple[Expr, Expr, float]]:
    """The ways to see a node as y + sense * multiple: (multiple, y, sense)."""
    if node.op not in ("add", "sub"):
        return []
    a, b = node.args
    ways = [(b, a, 1.0 if node.op == "add" else -1.0)]
    return [*ways, (a, b, 1.0)] if node.op == "add" else ways


def _multiples(order: Sequence[Expr], targets: Collection[Expr]) -> set[Expr]:
    """Products with a constant that one sum alone needs."""
    users: dict[Expr, list[Expr]] = {}
    for node in order:
        for a in node.args:
            users.setdefault(a, []).append(node)
    return {
        node
        for node in order
        if node.op == "mul"
        and node.args[0].is_constant
        and node not in targets
        and len(users[node]) == 1
        and any(multiple is node for multiple, _, _ in _sums(users[node][0]))
    }


def _partners(order: Sequence[Expr]) -> dict[Expr, dict[str, Expr]]:
    """By angle, its sine and cosine as far as they are needed."""
    found: dict[Expr, dict[str, Expr]] = {}
    for node in order:
        if node.op in ("sin", "cos"):
            found.setdefault(node.args[0], {})[node.op] = node
    return found
