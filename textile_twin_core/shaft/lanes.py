"""Where filters stand: side by side in lanes, family after family; and the rows that a lane's clock has."""

from __future__ import annotations

from typing import Final, cast

import numpy as np

WAVES: Final = (0, 2, 6, 12)
"""Orders of ripple of the families."""
FAMILIES: Final = len(WAVES)
WIDEST: Final = 2 * WAVES[-1]
FIRST: Final = (0, 16, 26, 36)
END: Final = (16, 26, 36, 40)
FILTERS: Final = END[-1]
COUNT: Final = FILTERS + 4
"""One more is needed, for the chain; rows of whole vectors are walked several lanes at once."""
MEMORIES: Final = np.concatenate(
    [
        0.5 * 2.0 ** np.arange(16.0),
        0.5 * 2.8 ** np.arange(10.0),
        2.4 ** np.arange(10.0),
        4.0 * 8.0 ** np.arange(4.0),
        np.ones(COUNT - FILTERS),
    ]
)
"""In samples, up to longer than any record is steady. Twice too long or too short costs little: the error of the speed
goes with the root of the memory; where there are many coefficients, fewer filters must do."""


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
