"""Numbers with thousands separators, taken for such only where the cells leave no doubt."""

from __future__ import annotations

import re
from typing import Any

_NO_DECIMALS = ("'", "\u2019", " ", "\u00a0", "\u202f")
"""Signs between groups of three that no country writes as a decimal sign: apostrophes and spaces."""

DOUBT = "its sign may be one of thousands or the decimal one"


def _pattern(sign: str, decimal: str, sure: bool) -> str:
    """Digits in groups of three; `sure`: with a decimal sign or a second group, which tell what the sign is for."""
    number, group = "^[+-]?[1-9][0-9]{0,2}", f"({re.escape(sign)}[0-9]{{3}})"
    if not sure:
        return f"{number}{group}+([{decimal}][0-9]*)?$"
    return f"{number}({group}+[{decimal}][0-9]*|{group}{{2,}})$"


def has_thousands(cell: str, decimal: str) -> bool:
    """Whether a cell is without doubt a number with thousands separators, as '1,234.5' with a decimal point."""
    other = "," if decimal == "." else "."
    return bool(re.match(_pattern(other, decimal, sure=True), cell)) or any(
        re.match(_pattern(sign, decimal, sure=False), cell) for sign in _NO_DECIMALS if sign in cell
    )


def may_have_thousands(cell: str) -> bool:
    """Whether a sign in a cell may stand for thousands, or for decimals: '1,234'."""
    return bool(re.match(r"[+-]?[1-9][0-9]{0,2}([.][0-9]{3})+$|[+-]?[1-9][0-9]{0,2}(,[0-9]{3})+$", cell))


def without_thousands(cells: Any, decimal: str) -> Any:
    """An Arrow column of text without its thousands separators; as it is where they may be something else.

    They are such where the sign stands before groups of three in each cell that has it, and in one of them at least
    cannot be the decimal sign, which is another.
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
