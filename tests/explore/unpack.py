"""Reader of the messages of the design page, equivalent to its JavaScript."""

from __future__ import annotations

import json
from typing import Any

import numpy as np


def unpack(message: bytes) -> tuple[dict[str, Any], np.ndarray]:
    """Return head and floats of a message."""
    size = int.from_bytes(message[:4], "little")
    return json.loads(message[4 : 4 + size]), np.frombuffer(message[4 + size :], dtype="<f4")


def numbers(head: dict[str, Any]) -> dict[str, float]:
    """Return the numbers of an analysis by name, in display units."""
    return {number["name"]: number["value"] for number in head["analysis"]["numbers"]}
