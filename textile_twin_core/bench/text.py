"""Tables of the benchmark as text."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import groupby

from textile_twin_core.bench.ratios import Ratio, quartiles
from textile_twin_core.bench.run import Row


def heading(core: int | None, rounds: int) -> str:
    """Describe the timing method."""
    if core is None:
        where = "wall time on any core, since this system holds no process to one"
    else:
        where = f"processor time on one core (number {core}) for all, threads of other libraries included"
    return (
        f"{where}; {rounds} round{'s' if rounds > 1 else ''} of turns\n"
        "times are medians of the rounds, spread is the range of their middle half over the median"
    )


def speed_table(rows: Iterable[Row]) -> str:
    """Format one block per scene: error over peak, ns per sample of a batch, us per call, and spread over the
    rounds.
    """
    lines = []
    for scene, block in groupby(rows, key=lambda row: (row.machine, row.outputs)):
        title = f"  {'':34}{'error/peak':>11}{'ns/sample':>12}{'spread':>8}{'us/call':>11}{'spread':>8}"
        lines += ["", f"{scene[0]}: {scene[1]}", title]
        lines += [_line(row) for row in block]
    return "\n".join(lines[1:])


def _line(row: Row) -> str:
    batch = f"{number(row.ns_per_sample, ',.1f'):>12}{spread(row.ns_per_round):>8}"
    call = f"{number(row.us_per_call, ',.2f'):>11}{spread(row.us_per_round):>8}"
    note = f"  {row.note}" if row.note else ""
    return f"  {row.name:34}{number(row.error_over_peak, '.1e'):>11}{batch}{call}{note}"


def spread(rounds: Sequence[float]) -> str:
    """Format the range of the middle half of the rounds over their median."""
    if not rounds:
        return ""
    first, median, third = quartiles(rounds)
    return f"{(third - first) / median:.0%}"


def number(value: float | None, form: str) -> str:
    """Format a number, or a dash where there is none."""
    return "-" if value is None else format(value, form)


def ratio_lines(found: Iterable[Ratio], title: str = "time per sample, batch, torque") -> str:
    """Format one line per ratio: its median, and the quartiles of the rounds."""
    named = [(f"{r.above} / {r.below}", r) for r in found]
    width = max((len(name) for name, _ in named), default=0)
    lines = [f"  {name:{width}}{r.median:>12,.2f}   {r.quartile_1:,.2f} .. {r.quartile_3:,.2f}" for name, r in named]
    return "\n".join([f"ratios, {title}: median of the rounds, and the middle half", *lines]) if lines else ""
