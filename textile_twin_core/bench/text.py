"""The bench as tables for people."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import groupby

from textile_twin_core.bench.growth import Growth
from textile_twin_core.bench.ratios import Ratio, quartiles
from textile_twin_core.bench.run import Row


def heading(core: int | None, rounds: int) -> str:
    """How the times below were taken."""
    if core is None:
        where = "wall time on any core, since this system holds no process to one"
    else:
        where = f"processor time on one core (number {core}) for all, threads of other libraries included"
    return (
        f"{where}; {rounds} round{'s' if rounds > 1 else ''} of turns\n"
        "times are medians of the rounds, spread is the range of their middle half over the median"
    )


def speed_table(rows: Iterable[Row]) -> str:
    """One block a scene: error over peak, ns per sample of a batch, us for one call, and how far the rounds spread."""
    lines = []
    for scene, block in groupby(rows, key=lambda row: (row.machine, row.outputs)):
        title = f"  {'':34}{'error/peak':>11}{'ns/sample':>12}{'spread':>8}{'us/call':>11}{'spread':>8}"
        lines += ["", f"{scene[0]}: {scene[1]}", title]
        lines += [_line(row) for row in block]
    return "\n".join(lines[1:])


def _line(row: Row) -> str:
    batch = f"{_number(row.ns_per_sample, ',.1f'):>12}{_spread(row.ns_per_round):>8}"
    call = f"{_number(row.us_per_call, ',.2f'):>11}{_spread(row.us_per_round):>8}"
    note = f"  {row.note}" if row.note else ""
    return f"  {row.name:34}{_number(row.error_over_peak, '.1e'):>11}{batch}{call}{note}"


def _spread(rounds: Sequence[float]) -> str:
    if not rounds:
        return ""
    first, median, third = quartiles(rounds)
    return f"{(third - first) / median:.0%}"


def _number(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


def ratio_lines(found: Iterable[Ratio], title: str = "time per sample, batch, torque") -> str:
    """One line a ratio: its median, and the middle half of the rounds."""
    lines = [
        f"  {f'{r.above} / {r.below}':48}{r.median:>12,.2f}   {r.quartile_1:,.2f} .. {r.quartile_3:,.2f}" for r in found
    ]
    return "\n".join([f"ratios, {title}: median of the rounds, and the middle half", *lines]) if lines else ""


def growth_table(rows: Iterable[Growth]) -> str:
    """One block for samples, machines and linkages."""
    lines = []
    for what, block in groupby(rows, key=lambda row: (row.method, row.what)):
        lines += ["", f"{what[1]}, {what[0]}", f"  {'':>12}{'ns per sample':>16}{'MiB beyond in and out':>24}"]
        lines += [f"  {row.size:>12,}{row.ns_per_unit:>16.1f}{row.memory_MiB:>24.2f}" for row in block]
    return "\n".join(lines[1:])
