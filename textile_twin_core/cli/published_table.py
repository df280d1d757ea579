"""Table of the four papers' numbers beside ours, as text, Markdown or data."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable
from functools import cache
from itertools import groupby
from typing import Any, NamedTuple

from textile_twin_core.papers.beatup import ELLIPTIC_GEAR, HANDLOOM, elliptic_gear_rows, handloom_rows
from textile_twin_core.papers.crank_rocker import table_1_rows
from textile_twin_core.papers.needle_transfer import NEEDLE_TRANSFER, needle_transfer_rows
from textile_twin_core.papers.rows import PublishedRow, decimals, printed_numbers
from textile_twin_core.papers.tufting import TUFTING, tufting_rows

_WIDTH = 98
_COLUMNS = (47, 6, 16, 18, 10)
_LISTED_COLUMNS = (19, 0, 34, 35, 10)
_LAST_DIGITS = "the deviation is the largest, in units of the last printed digit"


class Paper(NamedTuple):
    """Paper with its short name, machine and title."""

    name: str
    machine: str
    title: str


@cache
def papers() -> tuple[tuple[Paper, tuple[PublishedRow, ...]], ...]:
    """Return the four papers with their rows."""
    return (
        (
            Paper(
                TUFTING,
                "carpet tufting machine",
                "Dynamic Characteristic Analysis of the Needle Multi-linkage Mechanism in a Carpet Tufting Machine's"
                " Driving System, doi 10.5604/12303666.1196619",
            ),
            tufting_rows(),
        ),
        (
            Paper(
                HANDLOOM,
                "beat-up of a handmade carpet loom",
                "Kinematic analysis of beat-up mechanism used for handmade carpet looms",
            ),
            (*handloom_rows(), *table_1_rows()),
        ),
        (
            Paper(
                NEEDLE_TRANSFER,
                "needle transfer of a sewing machine",
                "The Dynamic Analysis of the Needle Bar Mechanism of Sewing Machines",
            ),
            needle_transfer_rows(),
        ),
        (
            Paper(
                ELLIPTIC_GEAR,
                "elliptic-gear beat-up of a power loom",
                "Kinematic Analysis and Test Study of Elliptic-Gear and Crank-Rocker Beating-Up Mechanism,"
                " Journal of Donghua University (Eng. Ed.) 28, no. 2, 222-225",
            ),
            elliptic_gear_rows(),
        ),
    )


def published_rows() -> tuple[PublishedRow, ...]:
    """Return every row of the four papers."""
    return tuple(row for _, rows in papers() for row in rows)


def as_text() -> str:
    """Format all rows for a terminal of 100 columns."""
    return "\n\n".join(["\n".join(_paper_lines(paper, rows)) for paper, rows in papers()] + [_count(published_rows())])


def as_markdown() -> str:
    """Format all rows for docs/papers.md: counts, differences from print, and every row, folded by paper."""
    lines = ["| paper | machine | rows | agree with print | differ, reason given | words or nothing in print |"]
    lines.append("|---|---|--:|--:|--:|--:|")
    for paper, rows in papers():
        agree, differ, rest = _counts(rows)
        lines.append(f"| {paper.name} | {paper.machine} | {len(rows)} | {agree} | {differ} | {rest} |")
    lines += ["", "Where print and machine differ by a unit of the last printed digit or more, or in words:", ""]
    lines += ["| paper | quantity | unit | printed | computed | why |", "|---|---|---|--:|--:|---|"]
    for row in published_rows():
        if row.agrees is False or (row.agrees is None and row.printed is not None and row.reason):
            what = f"{row.quantity} ({_short(row.section)})"
            lines.append(_markdown(row.paper, what, row.unit, printed_text(row), computed_text(row), row.reason))
    for paper, rows in papers():
        lines += ["", "<details>", f"<summary>{paper.name}: all {len(rows)} rows</summary>", ""]
        lines += [f"{paper.title}.", ""]
        for section, group in _sections(rows):
            lines += [f"**{section}**", "", "| quantity | unit | printed | computed | deviation | why |"]
            lines += ["|---|---|--:|--:|--:|---|"]
            for row in group:
                cells = (row.quantity, row.unit, printed_text(row), computed_text(row), deviation_text(row), row.reason)
                lines.append(_markdown(*cells))
            lines.append("")
        lines.append("</details>")
    return "\n".join(lines)


def as_json() -> dict[str, Any]:
    """Return all rows as data."""
    return {
        "rows": [
            {
                "paper": row.paper,
                "section": row.section,
                "quantity": row.quantity,
                "unit": row.unit,
                "printed": row.printed,
                "computed": row.computed,
                "deviation": row.deviation,
                "agrees": row.agrees,
                "reason": row.reason,
            }
            for row in published_rows()
        ]
    }


def printed_text(row: PublishedRow) -> str:
    """Format the printed value as printed; a dash if the paper has none."""
    if row.printed is None:
        return "-"
    return row.printed if isinstance(row.printed, str) else _plain(f"{row.printed:.10g}")


def computed_text(row: PublishedRow) -> str:
    """Format the computed value, with one or two digits more than the printed one."""
    if isinstance(row.computed, str):
        return row.computed
    if isinstance(row.computed, tuple):
        places = map(decimals, printed_numbers(row.printed))
        return " ".join(f"{value:.{place}f}" for value, place in zip(row.computed, places, strict=True))
    return _number(row.computed, row)


def deviation_text(row: PublishedRow) -> str:
    """Format the deviation in the unit of the row; for several numbers the largest, in units of the last printed
    digit.
    """
    if isinstance(row.computed, tuple) and row.last_places is not None:
        return f"{row.last_places:.1f}"
    if row.deviation is None:
        return ""
    text = _number(row.deviation, row)
    return "0" if float(text) == 0.0 else f"{'' if text[0] == '-' else '+'}{text}"


def _number(value: float, row: PublishedRow) -> str:
    printed = printed_numbers(row.printed)
    if len(printed) != 1:
        return f"{value:.6g}"
    if 0.0 < abs(printed[0]) < 1e-3:
        return _plain(f"{value:.3e}" if value == row.computed else f"{value:.1e}")
    places = max(decimals(printed[0]), 0)
    if not row.unit and places == 0 and value == round(value):
        return f"{value:.0f}"
    return f"{value:.{places + (2 if places < 2 else 1)}f}"


def _plain(text: str) -> str:
    return text.replace("e-0", "e-")


def _sections(rows: Iterable[PublishedRow]) -> Iterable[tuple[str, list[PublishedRow]]]:
    for section, members in groupby(rows, key=lambda row: row.section):
        group = list(members)
        yield f"{section}; {_LAST_DIGITS}" if isinstance(group[0].computed, tuple) else section, group


def _short(section: str) -> str:
    """Shorten the title of a section to the part before its first comma, semicolon or bracket."""
    return re.split(r"[,;]| \(| as ", section)[0].lower()


def _paper_lines(paper: Paper, rows: tuple[PublishedRow, ...]) -> list[str]:
    headline = f"{paper.name}: {paper.machine}"
    lines = [headline, "=" * len(headline), *textwrap.wrap(paper.title, _WIDTH, break_on_hyphens=False)]
    for section, group in _sections(rows):
        widths = _LISTED_COLUMNS if isinstance(group[0].computed, tuple) else _COLUMNS
        *above, last = textwrap.wrap(section, _WIDTH)
        if len(last) > widths[0]:
            above, last = [*above, last], ""
        lines += ["", *above, _line(widths, last, "", "printed", "computed", "deviation")]
        for row in group:
            texts = printed_text(row), computed_text(row), deviation_text(row)
            lines.append(_line(widths, f"  {row.quantity}", row.unit, *texts))
            lines += textwrap.wrap(row.reason, _WIDTH, initial_indent=" " * 6, subsequent_indent=" " * 6)
    return lines


def _line(widths: tuple[int, ...], quantity: str, unit: str, *values: str) -> str:
    numbers = "".join(f"{text:>{width}}" for text, width in zip(values, widths[2:], strict=True))
    return f"{quantity:{widths[0]}} {unit:{widths[1]}}{numbers}".rstrip()


def _markdown(*cells: str) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _counts(rows: Iterable[PublishedRow]) -> tuple[int, int, int]:
    """Count the rows that agree with print, that differ, and without a plain printed number."""
    found = [row.agrees for row in rows]
    return found.count(True), found.count(False), found.count(None)


def _count(rows: tuple[PublishedRow, ...]) -> str:
    agree, differ, rest = _counts(rows)
    return (
        f"{len(rows)} rows: {agree} agree with print, {differ} differ for the reason given,"
        f" {rest} have words or nothing in print."
    )
