"""Where filters stand: side by side in lanes, family after family; and the rows that a lane's clock has."""

from __future__ import annotations

from typing import Final, cast

import numpy as np

WAVES: Final = (0, 2, 6, 12)
"""Orders of ripple of the families."""
FAMILIES: Final = len(WAVES)
WIDEST: Final = 2 * WAVES[-1]
_ALIKE = (1.0, 2.0, 4.0, 8.0, 16.0, 34.0, 82.0, 210.0, 580.0, 1800.0)
_MORE = (0.5, 0.7, 3200.0, 5600.0, 10000.0, 17400.0)
_OF_FAMILIES = (tuple(sorted((*_ALIKE, *_MORE))), _ALIKE, _ALIKE, (4.0, 34.0, 210.0, 1800.0))
"""Memories of the filters, in samples, up to longer than any record is steady. Those of the ripple's families are among
the plain one's: else that would lead whose memories happen to be near the motion's. Readings tell less of long ones (of
the logarithm of N a Fisher information of 5 / N each, after Whittle 1953), and so the ratio from one to the next grows;
only the plain family, whose filters cost least, has those for motions that change within a sample, and beyond 1800 is
as fine as an even shaft's speed can use."""
VECTOR = 4
"""Lanes that go through the processor at once: each family begins with a whole vector."""


def _places() -> tuple[int, ...]:
    """First lane of each family, and of none."""
    first = [0]
    for memories in _OF_FAMILIES:
        first.append(-(-(first[-1] + len(memories)) // VECTOR) * VECTOR)
    return tuple(first)


FIRST: Final = _places()[:-1]
END: Final = tuple(first + len(memories) for first, memories in zip(FIRST, _OF_FAMILIES, strict=True))
COUNT: Final = _places()[-1] + VECTOR
"""With those for the chain."""
MEMORIES: Final = np.ones(COUNT)
for _first, _memories in zip(FIRST, _OF_FAMILIES, strict=True):
    MEMORIES[_first : _first + len(_memories)] = _memories


def numbers(count: int) -> list[int]:
    """That compiled loops take for variables: functions are not compiled anew for each."""
    return [cast(int, np.int64(number)) for number in range(count)]


PLAIN: Final = numbers(1)[0]
"""The family without ripple."""
CHAIN: Final = numbers(COUNT)[-1]
"""The lane of the one filter that smooths, whatever its family."""
ACCELERATION, RATE, ANGLE, L00, L10, L20, L11, L21, L22 = numbers(9)
"""Rows of a lane's clock: its state, and the lower triangular factor of the state's covariance, `L10` that of rate and
acceleration."""
