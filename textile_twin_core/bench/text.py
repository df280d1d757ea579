"""Tables of the benchmark as text."""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Sequence
from itertools import groupby

from textile_twin_core.bench.growth import Growth
from textile_twin_core.bench.impact_table import ImpactRow
from textile_twin_core.bench.ratios import Ratio, quartiles
from textile_twin_core.bench.run import Row
from textile_twin_core.bench.shaft_signal import DROPPED, JITTER_S, RATE_HZ
from textile_twin_core.bench.shaft_table import ShaftRow


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
    """Format one line per ratio: its median, and the quartiles of the rounds."""
    named = [(f"{r.above} / {r.below}", r) for r in found]
    width = max((len(name) for name, _ in named), default=0)
    lines = [f"  {name:{width}}{r.median:>12,.2f}   {r.quartile_1:,.2f} .. {r.quartile_3:,.2f}" for name, r in named]
    return "\n".join([f"ratios, {title}: median of the rounds, and the middle half", *lines]) if lines else ""


def growth_table(rows: Iterable[Growth]) -> str:
    """Format one block each for samples, machines and linkages."""
    lines = []
    for what, block in groupby(rows, key=lambda row: (row.method, row.what)):
        lines += ["", f"{what[1]}, {what[0]}", f"  {'':>12}{'ns per sample':>16}{'MiB beyond in and out':>24}"]
        lines += [f"  {row.size:>12,}{row.ns_per_unit:>16.1f}{row.memory_MiB:>24.2f}" for row in block]
    return "\n".join(lines[1:])


def shaft_lines(rows: Sequence[ShaftRow]) -> str:
    """Format a matrix per load: estimators against encoder bits, and against shaft speed."""
    lines = [
        f"{rows[0].machine}: RMS error of the torque of inertia and weight over its peak, from an encoder's angles"
        f" ({RATE_HZ:g} Hz,",
        f"stamps wrong by {JITTER_S * 1e6:g} us, {DROPPED:.0%} of the samples lost); sigma: share of samples within"
        " the sigma that is told (68 % would be right)",
    ]
    for (load, rpm), block in _matrices(rows).items():
        columns = list(dict.fromkeys((row.bits, row.rpm) for row in block))
        heads = [f"{bits} bit" if rpm is not None else f"{speed:g} rpm" for bits, speed in columns]
        where = f"{rpm:g} rpm" if rpm is not None else f"{columns[0][0]} bit"
        title = "".join(f"{head:>10}" for head in heads)
        lines += ["", f"{load}, {where}", f"  {'':24}{title}{'latency':>10}{'us/sample':>11}{'sigma':>7}"]
        lines += [
            _shaft_line([row for row in block if row.estimator == name], columns)
            for name in dict.fromkeys(row.estimator for row in block)
        ]
    return "\n".join(lines)


def _matrices(rows: Sequence[ShaftRow]) -> dict[tuple[str, float | None], list[ShaftRow]]:
    """Group rows by load, with the speed that has several bits separate from the other speeds (None)."""
    bits: dict[float, set[int]] = {}
    for row in rows:
        bits.setdefault(row.rpm, set()).add(row.bits)
    found: dict[tuple[str, float | None], list[ShaftRow]] = {}
    for row in rows:
        found.setdefault((row.load, row.rpm if len(bits[row.rpm]) > 1 else None), []).append(row)
    return found


def _shaft_line(rows: Sequence[ShaftRow], columns: Sequence[tuple[int, float]]) -> str:
    at = {(row.bits, row.rpm): row for row in rows}
    errors = "".join(f"{_number(at[c].torque_rms_over_peak if c in at else None, '.1e'):>10}" for c in columns)
    latency = f"{_number(rows[0].latency_s, 'g')} s" if rows[0].latency_s is not None else "-"
    costs = [row.us_per_sample for row in rows if row.us_per_sample is not None]
    inside = [row.inside_sigma for row in rows if row.inside_sigma is not None]
    cost = statistics.median(costs) if costs else None
    share = statistics.mean(inside) if inside else None
    return f"  {rows[0].estimator:24}{errors}{latency:>10}{_number(cost, '.0f'):>11}{_number(share, '.0%'):>7}"


def impact_lines(rows: Sequence[ImpactRow]) -> str:
    """Format one line per method and setting."""
    title = "needle transfer, from rest to the first contact of the collets: error of the event times"
    head = f"  {'':30}{'':18}{'error [s]':>11}{'ms per run':>12}{'spread':>8}"
    lines = [
        f"  {row.method:30}{row.setting:18}{row.error_s:>11.1e}{row.ms_per_run:>12.1f}{_spread(row.ms_per_round):>8}"
        for row in rows
    ]
    return "\n".join([title, head, *lines])
