"""Description of a compiled twin: evaluated and dropped parts, and cost."""

from __future__ import annotations

from collections.abc import Mapping

from textile_twin_core.expression import Expr, topological_order
from textile_twin_core.expression.graph import scaled
from textile_twin_core.expression.traversal import operation_counts
from textile_twin_core.machine.drive import load_names
from textile_twin_core.machine.machine import Machine
from textile_twin_core.machine.model import MachineModel
from textile_twin_core.twin.exact import ExactEvaluator
from textile_twin_core.twin.table import TableEvaluator


def describe(
    machine: Machine,
    outputs: Mapping[str, Expr],
    method: str,
    exact: ExactEvaluator,
    table: TableEvaluator | None,
) -> str:
    """Describe the plan, one fact per line."""
    lines = [f"{machine.name}: {', '.join(outputs)}"]
    if method == "auto":
        longer = "tables" if table is not None else "closed forms"
        lines.append(f"method auto: closed forms for single samples and short blocks, {longer} for long blocks")
    lines += _closed_forms(exact)
    lines += _links(machine, outputs)
    lines += _loads(machine, outputs)
    if table is not None:
        lines += _tables(table)
    return "\n".join(lines)


def _closed_forms(exact: ExactEvaluator) -> list[str]:
    counts = operation_counts(exact.expressions.values())
    return [f"closed forms: {sum(counts.values())} operations per sample ({_kinds(counts)})"]


def _kinds(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {op}" for op, count in sorted(counts.items(), key=lambda item: -item[1]))


def _links(machine: Machine, outputs: Mapping[str, Expr]) -> list[str]:
    needed = {id(node) for node in topological_order(outputs.values())}
    evaluated, dropped = [], []
    bodies = {body.on for body in machine.bodies}
    for name, link in machine.model.first.motion.links.items():
        parts = {
            "direction": (link.direction.x, link.direction.y),
            "speed": (link.first,),
            "acceleration": (link.second,),
        }
        used = [part for part, terms in parts.items() if any(_is_met(t, needed) for t in terms)]
        label = f"{name} with its body" if name in bodies else name
        if used:
            evaluated.append(f"{name} ({', '.join(used)})")
        else:
            dropped.append(label)
    lines = [f"links evaluated: {', '.join(evaluated) or 'none'}"]
    if dropped:
        lines.append(f"links dropped: {', '.join(dropped)}")
    return lines


def _is_met(term: Expr, needed: set[int]) -> bool:
    """Return true if a term, up to a constant factor, is among the needed nodes."""
    _, unscaled = scaled(term)
    return bool(unscaled.args) and id(unscaled) in needed


def _loads(machine: Machine, outputs: Mapping[str, Expr]) -> list[str]:
    if not machine.loads:
        return []
    model = MachineModel(machine, loads_as_variables=True)
    needed = set(topological_order(model.output(name) for name in outputs))
    lines = []
    for i, name in enumerate(load_names(machine.loads)):
        met = any(linkage.intensity_variable(i) in needed for linkage in model.linkages)
        lines.append(f"load {name}: {'evaluated' if met else 'dropped'}")
    return lines


def _tables(table: TableEvaluator) -> list[str]:
    lines = []
    if table.table is not None:
        size = table.table.coefficients.nbytes / 1024
        lines.append(
            f"tables: {len(table.functions)} functions of the shaft angle, {table.table.grid.nodes} nodes, "
            f"degree {table.table.degree}, {size:.0f} KiB, "
            f"error at most {table.table.error:.1e} of the peak at 0.1 to 10 times nominal speed"
        )
    counts = operation_counts(table.combined.values())
    lines.append(f"beside the tables: {sum(counts.values())} operations per sample ({_kinds(counts)})")
    if table.exact_outputs:
        lines.append(f"kept in closed form: {', '.join(table.exact_outputs)}")
    return lines
