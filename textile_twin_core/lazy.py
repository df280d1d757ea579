"""Names of a package that are imported when they are first used: what does not need them starts at once (PEP 562)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from importlib import import_module


def names_of(package: str, places: Mapping[str, str]) -> Callable[[str], object]:
    """A package's `__getattr__`, for names by the module below it that holds each.

    A place is `module`, `module:name` where the name differs there, or the name itself for a module. What is returned
    raises AttributeError for other names. Type checkers learn the names from an import under TYPE_CHECKING.
    """

    def find(name: str) -> object:
        if name not in places:
            raise AttributeError(f"module '{package}' has no attribute '{name}'")
        place, _, there = places[name].partition(":")
        module = import_module(f"{package}.{place}")
        return module if place == name else getattr(module, there or name)

    return find


def listing_of(names: Iterable[str]) -> Callable[[], list[str]]:
    """A package's `__dir__`: the names that it offers, which `dir` and tab completion then show, and no others."""
    shown = sorted(names)
    return lambda: list(shown)
