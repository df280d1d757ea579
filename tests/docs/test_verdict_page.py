"""docs/how_to/verdict.md has advice for every cause and alarm that the product can print."""

from __future__ import annotations

import ast
import re
from pathlib import Path

from tests.docs.pages import ROOT
from textile_twin_core.comparison.fault_naming import SIDE

PAGE = Path("docs/how_to/verdict.md")


def advised() -> set[str]:
    """Codes in the first two columns of tables whose last column gives the action."""
    rows = re.findall(r"^\| (.+) \|$", (ROOT / PAGE).read_text(), re.M)
    cells = [row.split(" | ") for row in rows]
    assert all(each[-1].strip() for each in cells)
    return {code for each in cells for code in re.findall(r"`(\w+)`", " ".join(each[:2]))}


def printed_causes() -> set[str]:
    """Causes that the package constructs, by literal or by the kind of a parameter (the table `_CAUSES`)."""
    found = set[str]()
    for file in (ROOT / "textile_twin_core").rglob("*.py"):
        text = file.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)) if "Cause(" in text else ():
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "Cause" and node.args:
                cause = node.args[0]
                found |= {cause.value} if isinstance(cause, ast.Constant) else set()
            elif isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "_CAUSES":
                found |= set(ast.literal_eval(node.value).values())
    return found


def test_every_cause_has_its_advice() -> None:
    assert {"delay", "elastic_shaft", "length"} <= printed_causes()
    assert advised() >= printed_causes()


def test_every_alarm_has_its_advice() -> None:
    assert advised() >= set(SIDE)
