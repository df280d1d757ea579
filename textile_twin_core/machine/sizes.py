"""Checks that reject numbers beyond the size of any machine."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from textile_twin_core.errors import MachineError

LARGEST = 1e12
"""Largest length, mass, stiffness, speed or torque in the units used here."""


def check_size(value: float, what: str) -> None:
    """Raise MachineError for NaN, infinity and numbers beyond `LARGEST`."""
    if not abs(value) <= LARGEST:
        raise MachineError(f"{what}: must be a finite number of at most {LARGEST:g} in size, not {value!r}")


@contextmanager
def computable(what: str) -> Iterator[None]:
    """Turn an arithmetic failure on a declaration's numbers into MachineError."""
    try:
        yield
    except (ArithmeticError, ValueError) as error:
        raise MachineError(
            f"{what}: computation fails on its numbers ({error}); look for a zero or a wrong unit"
        ) from error
