"""A bounded buffer of sample blocks between the thread that has them and the one that draws them."""

from __future__ import annotations

import threading
from collections import deque
from typing import TypeAlias

import numpy as np

from textile_twin_core.arrays import FloatArray

Block: TypeAlias = tuple[FloatArray, ...]


class Buffer:
    """Blocks of columns between two threads; holds the newest samples and counts what it drops."""

    def __init__(self, most: int) -> None:
        self._most, self._held = most, 0
        self._blocks: deque[Block] = deque()
        self._lock = threading.Lock()
        self.dropped = 0

    def put(self, block: Block) -> None:
        """Add columns of equal length; the oldest blocks go when there are too many samples."""
        with self._lock:
            self._blocks.append(block)
            self._held += block[0].size
            while self._held > self._most and len(self._blocks) > 1:
                gone = self._blocks.popleft()[0].size
                self._held -= gone
                self.dropped += gone

    def take(self) -> Block:
        """Everything held, joined by column; empty without any."""
        with self._lock:
            blocks = list(self._blocks)
            self._blocks.clear()
            self._held = 0
        if not blocks:
            return ()
        return tuple(np.concatenate(columns) for columns in zip(*blocks, strict=True))
