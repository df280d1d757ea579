"""A recording that restarts: waiting samples are given, whatever blocks the samples come in."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import textile_twin_core as ttc
from textile_twin_core.twin.restart import RestartWatch
from textile_twin_ros.twin_stream import TwinStream


class _Quiet:
    def __getattr__(self, name: str) -> Any:
        return lambda *_, **__: self


@pytest.mark.parametrize("shaft", ["causal", "lag"])
@pytest.mark.parametrize("block", [1, 7, 64])
def test_the_second_pass_is_predicted_like_the_first(shaft: str, block: int) -> None:
    given: list[int] = []
    stream = TwinStream.__new__(TwinStream)
    stream._node, stream._residuals, stream._restarts = _Quiet(), _Quiet(), RestartWatch()
    stream._session = ttc.compile(ttc.machines.tufting(), ["needle_position_m"]).session(shaft)
    stream._wants_sigma = stream._has_history = False
    stream._at_once = shaft == "causal"
    stream._publish = lambda samples: given.extend(sample.stamp for sample in samples)
    stamps = (np.arange(1, 801) * 2_000_000).tolist()
    samples = [(stamp, stamp * 1.5e-8, float("nan")) for stamp in stamps * 2]
    for start in range(0, len(samples), block):
        stream.take_angles(samples[start : start + block])
    stream.flush()
    # Nine samples pass until time is known to have been set back, and two begin each estimate.
    assert given == stamps[2:] + stamps[11:]
