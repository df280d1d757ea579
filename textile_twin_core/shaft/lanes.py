"""Where each filter is stored: side by side in lanes, family after family; and the rows of a lane's state."""

from __future__ import annotations

from functools import partial
from itertools import accumulate
from typing import Final, cast

import numpy as np

from textile_twin_core.compiling import compiled_in_place

MOST_WAVES: Final = (0, 2, 6, 12, 24)  # orders of ripple of each family, fewer where a turn has too few samples
LEAST_WAVES: Final = (0, 1, 3, 7, 13)  # below which a family is at rest: the one before has as many
FAMILIES: Final = len(MOST_WAVES)
WIDEST: Final = 2 * MOST_WAVES[-1]  # coefficients of the most orders
VECTOR = 4  # lanes that the processor handles at once: each family begins with a whole vector
_COMMON = (1.0, 2.0, 4.0, 8.0, 16.0, 34.0, 82.0, 210.0, 580.0, 1800.0)
_PLAIN_ONLY = (0.5, 0.7, 3200.0, 5600.0, 10000.0, 17400.0)
_OF_FAMILIES = (tuple(sorted((*_COMMON, *_PLAIN_ONLY))), _COMMON, _COMMON, *2 * ((4.0, 34.0, 210.0, 1800.0),))
"""Memories N of the filters, in samples. Families share memories, or the one with that nearest the motion's would lead.
The Fisher information of a reading on log N is 5 / N (after Whittle 1953), and so the ratio between neighbours grows.
The plain family, the cheapest, adds those for motions that change within a sample and for very even speeds."""
_VECTORS = accumulate((-(-len(memories) // VECTOR) for memories in _OF_FAMILIES), initial=0)
_STARTS = tuple(VECTOR * count for count in _VECTORS)
FIRST: Final = _STARTS[:-1]  # lane of each family
END: Final = tuple(first + len(memories) for first, memories in zip(FIRST, _OF_FAMILIES, strict=True))
STOP: Final = _STARTS[1:]  # of its last vector, of which some lanes may be idle: computed, and of no probability
COUNT: Final = _STARTS[-1] + VECTOR  # with a vector for the smoother's filter
MEMORIES: Final = np.ones(COUNT)
for _first, _memories in zip(FIRST, _OF_FAMILIES, strict=True):
    MEMORIES[_first : _first + len(_memories)] = _memories

vectorised = partial(compiled_in_place, wide=VECTOR)  # loops over lanes, of whole vectors ..
of_arrays = partial(vectorised, apart=True, abreast=1)  # .. and few of them, one at a time


def numbers(count: int) -> list[int]:
    """0 .. count - 1 as numpy integers, for which compiled functions are not specialised one by one."""
    return [cast(int, np.int64(number)) for number in range(count)]


PLAIN: Final = numbers(1)[0]  # the family without ripple
HIGH: Final = numbers(FAMILIES)[-1]  # the family of high orders, at rest until such are heard: it costs most
USUAL_WAVES: Final = MOST_WAVES[-2]  # orders of the others
CHAIN: Final = numbers(COUNT)[-1]  # lane of the smoother's filter, whatever its family
ACCELERATION, RATE, ANGLE, L00, L10, L20, L11, L21, L22 = numbers(9)
"""Rows of a lane's clock: state and lower triangular covariance factor; L10 is that of rate and acceleration."""
FACTOR: Final = np.array([[L00, 0, 0], [L10, L11, 0], [L20, L21, L22]])  # the same by row and column
