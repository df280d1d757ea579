"""Numbers with thousands separators, accepted only if the cells are unambiguous."""

from __future__ import annotations

import re
from typing import Any

_NO_DECIMALS = ("'", "\u2019", " ", "\u00a0", "\u202f")
"""Separators of groups of three that are a decimal sign in no country: apostrophes and spaces."""

DOUBT = "its sign may be one of thousands or the decimal one"


def _pattern(sign: str, decimal: str, sure: bool) -> str:
    """Pattern of digits in groups of three; `sure`: with a decimal sign or a second group, so unambiguous."""
    number, group = "^[+-]?[1-9][0-9]{0,2}", f"({re.escape(sign)}[0-9]{{3}})"
    if not sure:
        return f"{number}{group}+([{decimal}][0-9]*)?$"
    return f"{number}({group}+[{decimal}][0-9]*|{group}{{2,}})$"


def has_thousands(cell: str, decimal: str) -> bool:
    """Return true for an unambiguous number with thousands separators, such as '1,234.5' with a decimal point."""
    other = "," if decimal == "." else "."
    return bool(re.match(_pattern(other, decimal, sure=True), cell)) or any(
        re.match(_pattern(sign, decimal, sure=False), cell) for sign in _NO_DECIMALS if sign in cell
    )


def may_have_thousands(cell: str) -> bool:
    """Return true if a sign in a cell may separate thousands or decimals: '1,234'."""
    return bool(re.match(r"[+-]?[1-9][0-9]{0,2}([.][0-9]{3})+$|[+-]?[1-9][0-9]{0,2}(,[0-9]{3})+$", cell))


def without_thousands(cells: Any, decimal: str) -> Any:
    """Remove the thousands separators of an Arrow column of text; unchanged if they are ambiguous.

    The sign must stand before groups of three in each cell that has it, and at least one of them must exclude it as
    the decimal sign.
    """
    from pyarrow import compute

    def count(pattern: str) -> int:
        return int(compute.sum(compute.match_substring_regex(cells, pattern)).as_py() or 0)

    for sign in ("," if decimal == "." else ".", *_NO_DECIMALS):
        grouped = count(_pattern(sign, decimal, sure=False))
        if not grouped or grouped != count(re.escape(sign)):
            continue
        if sign in _NO_DECIMALS or count(_pattern(sign, decimal, sure=True)):
            return compute.replace_substring(cells, sign, "")
    return cells
