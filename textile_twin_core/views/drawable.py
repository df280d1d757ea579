"""Text that the viewer can draw: its font has Latin, Greek and Cyrillic letters, and ends the viewer at any other."""

from __future__ import annotations

import re
import tempfile
from pathlib import Path
from typing import TypeVar

import yaml

from textile_twin_core.files.machine_file import load_machine_file, machine_document
from textile_twin_core.machine import AnyMachine

_UNDRAWABLE = re.compile(
    "[^\n\t\u0020-\u024f\u0370-\u03ff\u0400-\u045f"  # letters
    "\u2010-\u2027\u2030-\u203a\u20ac\u2212\u221e\u2248\u2260-\u2265]"  # punctuation and signs
)
_Machine = TypeVar("_Machine", bound=AnyMachine)


def undrawable(text: str) -> str:
    """Return the characters of a text that the viewer cannot draw, each once."""
    return "".join(dict.fromkeys(_UNDRAWABLE.findall(text)))


def drawable(text: str) -> str:
    """Replace each character that the viewer cannot draw by its number in Unicode.

    Example:
        >>> drawable("簇 1")
        'U7C07 1'
    """
    return _UNDRAWABLE.sub(lambda found: f"U{ord(found[0]):04X}", text)


def drawable_machine(machine: _Machine) -> tuple[_Machine, str]:
    """Return the machine with names that the viewer can draw, and the characters replaced in them."""
    text = yaml.safe_dump(machine_document(machine), allow_unicode=True, sort_keys=False)
    replaced = undrawable(text)
    if not replaced:
        return machine, ""
    with tempfile.TemporaryDirectory(prefix="textile-twin-") as folder:
        path = Path(folder) / "machine.yaml"
        path.write_text(drawable(text), encoding="utf-8")
        drawn = load_machine_file(path)
    assert isinstance(drawn, type(machine))
    return drawn, replaced
