"""The filters' lanes go side by side through the processor: what keeps a loop from vectors is seen in no result."""

from __future__ import annotations

import platform
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from textile_twin_core.shaft import kalman, lanes, ripple
from textile_twin_core.shaft.settings import ShaftSettings
from textile_twin_core.shaft.status import new_status

numba = pytest.importorskip("numba")
LANES = (np.int64(0), np.int64(16))


@pytest.mark.skipif(platform.machine() != "x86_64", reason="names the instructions of x86-64")
@pytest.mark.parametrize(("function", "numbers"), [(kalman.time_update, (1.0, 0.1)), (kalman.measurement_update, ())])
def test_roots_are_taken_of_several_lanes_at_once(
    function: Any, numbers: tuple[float, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TEXTILE_TWIN_CACHE_DIR", str(tmp_path))  # what comes from the disk cannot be looked into
    anew: Any = lanes.vectorised(function.py_func)
    anew.compile(tuple(numba.typeof(each) for each in (new_status(ShaftSettings())[0], *numbers, *LANES)))
    _assert_vectors(anew)


@pytest.mark.skipif(platform.machine() != "x86_64", reason="names the instructions of x86-64")
def test_ripple_is_updated_in_several_lanes_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TEXTILE_TWIN_CACHE_DIR", str(tmp_path))
    status, width = new_status(ShaftSettings())[0], np.int64(4)
    anew: Any = lanes.of_arrays(ripple.update_ripple.py_func)  # type: ignore[attr-defined]
    names = ("sensitivity", "ripple", "factor", "regressor", "projected_ripple", "innovation", "clock_variance")
    more = ("gain", "clock", "parts", "ripple_change")
    anew.compile(tuple(numba.typeof(each) for each in (*(status[name] for name in (*names, *more)), width, *LANES)))
    _assert_vectors(anew)


def _assert_vectors(compiled: Any) -> None:
    """Of as many lanes as a family has at least: longer ones would leave the lanes of a small family one by one."""
    (assembly,) = compiled.inspect_asm().values()
    roots = re.findall(r"sqrtpd.*", assembly)
    assert roots and not any("zmm" in root for root in roots)
