"""The loops as plain Python, as they run without a compiler and in a debugger."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from textile_twin_core.machines.needle_transfer import needle_transfer

END_S = 0.0197
WITHOUT_NUMBA = f"""
import json, sys
sys.modules["numba"] = None
from textile_twin_core.machines.needle_transfer import needle_transfer
run = needle_transfer().simulate(end_s={END_S})
events = [[event.kind, event.name, event.time_s, event.impulse_Ns] for event in run.events]
print(json.dumps([events, run.positions[:, -1].tolist()]))
"""


def test_uncompiled_loops_meet_the_same_events() -> None:
    ended = subprocess.run([sys.executable, "-c", WITHOUT_NUMBA], capture_output=True, text=True, check=True)
    events, positions = json.loads(ended.stdout)
    run = needle_transfer().simulate(end_s=END_S)
    assert [event[:2] for event in events] == [[event.kind, event.name] for event in run.events]
    for (_, _, time_s, impulse), event in zip(events, run.events, strict=True):
        assert time_s == pytest.approx(event.time_s, abs=1e-14)
        assert impulse == pytest.approx(event.impulse_Ns, rel=1e-9)
    assert positions == pytest.approx(run.positions[:, -1].tolist(), abs=1e-14)
    assert ended.stderr.count("\n") == 1
