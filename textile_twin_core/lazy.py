"""Package names that are imported on first use (PEP 562), for a quick start."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from importlib import import_module


def names_of(package: str, places: Mapping[str, str]) -> Callable[[str], object]:
    """Return a package's `__getattr__` for names by the module that holds each.

    A place is `module`, `module:name` if the name differs there, or the name itself for a module. The returned function
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
    """Return a package's `__dir__`: the exported names, for `dir` and tab completion."""
    shown = sorted(names)
    return lambda: list(shown)
