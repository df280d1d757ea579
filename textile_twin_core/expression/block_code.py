"""Source code of array programs: one line per operation, and which buffer each result goes to.

A sum with a multiple, y + c x, is one operation (BLAS's axpy) where sums alone need c x; what else is asked for may so
change the last digit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from textile_twin_core.expression.graph import Expr
from textile_twin_core.expression.in_place import APART, SINCOS_WORK, hosts, joinable, read_by
from textile_twin_core.expression.schedule import schedule
from textile_twin_core.expression.traversal import topological_order


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
    order = topological_order(outputs)
    joined = {e for e in joinable(order, set(outputs)) if join_multiples or e.op != "mul"}
    if arranged:
        order = schedule(outputs, joined)
    return _Writer(list(outputs), tuple(inputs), joined).write(order)


@dataclass
class _Writer:
    outputs: list[Expr]
    inputs: tuple[str, ...]
    joined: set[Expr]
    place: dict[Expr, str] = field(default_factory=dict)
    constants: dict[Expr, str] = field(default_factory=dict)
    lines: list[str] = field(default_factory=list)
    free: list[int] = field(default_factory=list)
    held: dict[Expr, int] = field(default_factory=dict)
    buffers: int = 0
    operations: int = 0

    def write(self, order: Sequence[Expr]) -> BlockCode:
        self.target = {e: f"o{k}" for k, e in reversed(list(enumerate(self.outputs)))}
        self.partner = _partners(order)
        self.last_use = {
            a: i for i, node in enumerate(order) if node not in self.joined for a in read_by(node, self.joined)
        }
        for i, node in enumerate(order):
            if node not in self.joined:
                if node not in self.place:
                    self._write_node(i, node)
                self._release(i, node)
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
        elif not self._join(number, node):
            if node.op not in APART:
                self._release(number, node)
            self._write_operation(node)

    def _write_operation(self, node: Expr) -> None:
        arguments = [self.place[a] for a in node.args]
        self._settle(node)
        self._line(f"np_{node.op}", [*arguments, self.place[node]])

    def _join(self, number: int, node: Expr) -> bool:
        """Write y + c x or y times a switch, if the node is such a one: onto y if it goes, else onto a copy."""
        ways = [(part, y) for part, y in hosts(node) if part in self.joined]
        if not ways:
            return False
        part, y = min(ways, key=lambda way: not self._goes(number, *way))
        if y in self.joined:
            self._write_operation(y)
        if self._goes(number, part, y) and node not in self.target:
            self.held[node] = self.held.pop(y)
            self.place[node] = self.place[y]
        else:
            self._settle(node)
            self._line("np_copy", [self.place[node], self.place[y]])
        arguments = [self.place[x] for x in part.args]
        if node.op == "mul":
            work = self._take_buffer()
            self._line(f"times_{part.op}", [self.place[node], *arguments, f"b{work}"])
            self.free.append(work)
        else:
            factor = part.args[0].value if node.op == "add" else -part.args[0].value
            self._line("add_multiple", [arguments[1], self.place[node], "n", repr(factor)])
        return True

    def _goes(self, number: int, part: Expr, y: Expr) -> bool:
        """Whether y's buffer is free for y joined with a part."""
        return y in self.held and self.last_use[y] == number and y not in part.args

    def _release(self, number: int, node: Expr) -> None:
        """Give back the buffers of what this node was the last to read."""
        for e in read_by(node, self.joined):
            if e in self.held and self.last_use[e] == number:
                self.free.append(self.held.pop(e))

    def _write_sincos(self, node: Expr) -> None:
        """Sine and cosine of one angle together; the partner is at hand when its turn comes."""
        angle = node.args[0]
        pair = self.partner[angle]
        for e in pair.values():
            self._settle(e)
        work = [self._take_buffer() for _ in range(SINCOS_WORK + 2 - len(pair))]
        spare = [f"b{k}" for k in work]
        results = [self.place[pair[op]] if op in pair else spare.pop() for op in ("sin", "cos")]
        factor, x = (angle.args[0].value, angle.args[1]) if angle in self.joined else (1.0, angle)
        self._line("np_sincos", [self.place[x], *results, f"[{', '.join(spare)}]", repr(factor)])
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


def _partners(order: Sequence[Expr]) -> dict[Expr, dict[str, Expr]]:
    """By angle, its sine and cosine as far as they are needed."""
    found: dict[Expr, dict[str, Expr]] = {}
    for node in order:
        if node.op in ("sin", "cos"):
            found.setdefault(node.args[0], {})[node.op] = node
    return found
