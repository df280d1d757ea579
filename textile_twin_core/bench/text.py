"""The bench as tables for people."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import groupby

from textile_twin_core.bench.growth import Growth
from textile_twin_core.bench.run import Row


def speed_table(rows: Iterable[Row]) -> str:
    """One block a scene: error over peak, ns per sample of a batch, us for one call."""
    lines = []
    for scene, block in groupby(rows, key=lambda row: (row.machine, row.outputs)):
        lines += ["", f"{scene[0]}: {scene[1]}", f"  {'':34}{'error/peak':>11}{'ns/sample':>12}{'us/call':>11}"]
        lines += [_line(row) for row in block]
    return "\n".join(lines[1:])


def _line(row: Row) -> str:
    name = row.method if row.peer is None else f"{row.peer}, {row.method}"
    return f"  {name:34}{_number(row.error_over_peak, '.1e'):>11}{_number(row.ns_per_sample, ',.1f'):>12}" + (
        f"{_number(row.us_per_call, ',.2f'):>11}" + (f"  {row.note}" if row.note else "")
    )


def _number(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


def ratios(rows: Sequence[Row]) -> str:
    """The torque's ratios that hold on any computer."""
    by_name = {(r.peer, r.method): r for r in rows if r.outputs == "torque"}
    exact, table = by_name.get((None, "exact")), by_name.get((None, "table 1e-13"))
    lines = []
    for row in by_name.values():
        if row.peer is None or row.ns_per_sample is None:
            continue
        for ours in (exact, table):
            if ours is not None and ours.ns_per_sample:
                ratio = row.ns_per_sample / ours.ns_per_sample
                lines.append(f"  {row.peer}, {row.method} / {ours.method}: {ratio:,.2f}")
    return "\n".join(["time of others over ours, torque, batch:", *lines]) if lines else ""


def growth_table(rows: Iterable[Growth]) -> str:
    """One block for samples, machines and linkages."""
    lines = []
    for what, block in groupby(rows, key=lambda row: (row.method, row.what)):
        lines += ["", f"{what[1]}, {what[0]}", f"  {'':>12}{'ns per sample':>16}{'MiB beyond in and out':>24}"]
        lines += [f"  {row.size:>12,}{row.ns_per_unit:>16.1f}{row.memory_MiB:>24.2f}" for row in block]
    return "\n".join(lines[1:])
