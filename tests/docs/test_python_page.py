"""docs/reference/python.md: every public name, with arguments, result, errors and an example."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import re
from typing import Any

import pytest

import textile_twin_core as ttc
from tests.docs.pages import ROOT

LISTED = re.findall(r"^::: (\S+)$", (ROOT / "docs" / "reference" / "python.md").read_text(), re.M)
UNIT = re.compile(r"\[(?:kg|m|N|rad|s|J|ns|Hz|deg)\b[^\]]*\]|\b(?:rad|ns)\b")
QUANTITY = re.compile(r"_(?:m|rad|s|Nm|N|kg|kgm2|J|ns|rad_s2?)$")


def named(path: str) -> Any:
    module, _, name = path.rpartition(".")
    return getattr(importlib.import_module(module), name)


def sections(thing: Any) -> dict[str, str]:
    """Sections of a docstring, by their heading; the text before them by `` ``."""
    parts = re.split(r"^(\w+):\n", inspect.getdoc(thing) or "", flags=re.M)
    return {"": parts[0]} | dict(zip(parts[1::2], parts[2::2], strict=True))


def test_every_public_name_and_every_name_that_extending_imports_is_on_the_page() -> None:
    listed = {id(named(path)) for path in LISTED}
    for name in set(ttc.__all__) - {"machines"}:
        assert id(getattr(ttc, name)) in listed, name
    for name in set(ttc.machines.__all__) & {"tufting", "handloom_beatup", "elliptic_gear_beatup", "needle_transfer"}:
        assert id(getattr(ttc.machines, name)) in listed, name
    page = (ROOT / "docs" / "extending.md").read_text()
    for module, names in re.findall(r"^from (textile_twin_core[\w.]*) import (.+)$", page, re.M):
        for name in names.split(", "):
            assert id(getattr(importlib.import_module(module), name)) in listed, f"{module}.{name}"


LESS = ("Error", "Batch")
"""Ends of names that need less: errors beside the one that they derive from, and results of many designs."""


@pytest.mark.parametrize("path", [path for path in LISTED if not path.endswith(LESS) or path.endswith("TwinError")])
def test_an_entry_is_complete(path: str) -> None:
    thing = named(path)
    found = sections(thing)
    assert re.match(r"[A-Z].*\.$", found[""].strip().splitlines()[0]), "the first line is a sentence"
    assert ">>> " in found.get("Examples", ""), "an example"
    if inspect.isfunction(thing):
        parameters = [name for name, each in inspect.signature(thing).parameters.items()]
        described = re.findall(r"\w+", found.get("Args", ""))
        assert not set(parameters) - set(described), "arguments"
        assert found.get("Returns"), "what it returns"
    elif dataclasses.is_dataclass(thing):
        public = {field.name for field in dataclasses.fields(thing) if not field.name.startswith("_") and field.init}
        described = set(re.findall(r"\w+", found.get("Attributes", "") + found.get("Args", "") + found[""]))
        assert not public - described, "attributes"


@pytest.mark.parametrize("path", [path for path in LISTED if inspect.isfunction(named(path))])
def test_a_quantity_has_its_unit(path: str) -> None:
    """An argument whose name ends with a unit is one line of `Args`, where the unit stands too."""
    found = sections(named(path))
    for line in re.findall(r"^    (\S.*(?:\n {8}.*)*)", found.get("Args", ""), re.M):
        names, _, text = line.partition(": ")
        if any(QUANTITY.search(name) for name in names.split(", ")):
            assert UNIT.search(text) or "axis_ratio" in names, f"{path}: {line}"
