"""Memory layout of the bank: the index of each filter, model after model, and the rows of a filter's state."""

from __future__ import annotations

from functools import partial
from itertools import accumulate
from typing import Final, cast

import numpy as np

from textile_twin_core.compiling import compiled_in_place

MOST_WAVES: Final = (0, 2, 6, 12, 24)  # orders of ripple of each model, fewer where a turn has too few samples
LEAST_WAVES: Final = (0, 1, 3, 7, 13)  # orders below which a model is inactive: the model before it has as many
MODELS: Final = len(MOST_WAVES)
WIDEST: Final = 2 * MOST_WAVES[-1]  # coefficients of the most orders
VECTOR = 4  # filters that the processor handles at once: each model begins with a whole vector
_COMMON = (1.0, 2.0, 4.0, 8.0, 16.0, 34.0, 82.0, 210.0, 580.0, 1800.0)
_PLAIN_ONLY = (0.5, 0.7, 3200.0, 5600.0, 10000.0, 17400.0)
_MEMORIES_BY_MODEL = (tuple(sorted((*_COMMON, *_PLAIN_ONLY))), _COMMON, _COMMON, *2 * ((4.0, 34.0, 210.0, 1800.0),))
"""Memories N of the filters, in samples. Models share memories: otherwise the model with the memory nearest the
motion's would win. The Fisher information of a reading on log N is 5 / N (after Whittle 1953), so the ratio between
neighbours grows. The plain model, the cheapest, adds memories for changes within a sample and for even speeds."""
_VECTORS = accumulate((-(-len(memories) // VECTOR) for memories in _MEMORIES_BY_MODEL), initial=0)
_STARTS = tuple(VECTOR * count for count in _VECTORS)
FIRST: Final = _STARTS[:-1]  # index of each model's first filter
END: Final = tuple(first + len(memories) for first, memories in zip(FIRST, _MEMORIES_BY_MODEL, strict=True))
# end of the model's last vector, in which some filters may be unused: computed, of probability 0
STOP: Final = _STARTS[1:]
COUNT: Final = _STARTS[-1] + VECTOR  # with one vector for the smoother's filter
MEMORIES: Final = np.ones(COUNT)
for _first, _memories in zip(FIRST, _MEMORIES_BY_MODEL, strict=True):
    MEMORIES[_first : _first + len(_memories)] = _memories

vectorised = partial(compiled_in_place, width=VECTOR)  # loops over filters, in whole vectors ..
of_arrays = partial(vectorised, noalias=True, interleave=1)  # .. over few filters, one vector at a time


def numbers(count: int) -> list[int]:
    """Return 0 .. count - 1 as numpy integers, for which compiled functions are not specialised one by one."""
    return [cast(int, np.int64(number)) for number in range(count)]


PLAIN: Final = numbers(1)[0]  # the model without ripple
# the model of high orders, which costs most: active only where such orders are detected
HIGH: Final = numbers(MODELS)[-1]
USUAL_WAVES: Final = MOST_WAVES[-2]  # orders of the largest of the other models
SMOOTHER: Final = numbers(COUNT)[-1]  # index of the smoother's filter, whatever its model
ACCELERATION, RATE, ANGLE, L00, L10, L20, L11, L21, L22 = numbers(9)
"""Rows of a filter's clock: state and lower triangular covariance factor; L10 couples rate and acceleration."""
