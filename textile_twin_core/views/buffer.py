"""Bounded buffer of sample blocks between the thread that receives them and the thread that draws them."""

from __future__ import annotations

import threading
from collections import deque
from typing import TypeAlias

import numpy as np

from textile_twin_core.arrays import FloatArray

Block: TypeAlias = tuple[FloatArray, ...]


class Buffer:
    """Thread-safe queue of blocks of columns; drops the oldest samples above `most` and counts them in `dropped`."""

    def __init__(self, most: int) -> None:
        self._most, self._held = most, 0
        self._blocks: deque[Block] = deque()
        self._lock = threading.Lock()
        self.dropped = 0

    def put(self, block: Block) -> None:
        """Append columns of equal length; drop the oldest blocks above the limit."""
        with self._lock:
            self._blocks.append(block)
            self._held += block[0].size
            while self._held > self._most and len(self._blocks) > 1:
                gone = self._blocks.popleft()[0].size
                self._held -= gone
                self.dropped += gone

    def take(self) -> Block:
        """Remove all blocks and return them joined by column; an empty tuple when there are none."""
        with self._lock:
            blocks = list(self._blocks)
            self._blocks.clear()
            self._held = 0
        if not blocks:
            return ()
        return tuple(np.concatenate(columns) for columns in zip(*blocks, strict=True))
