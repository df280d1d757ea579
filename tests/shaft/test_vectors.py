"""The processor handles several filters at once: a loop that loses its vectors shows in no result."""

from __future__ import annotations

import platform
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from textile_twin_core.compiling import internals
from textile_twin_core.shaft import kalman, layout, ripple
from textile_twin_core.shaft.settings import ShaftSettings
from textile_twin_core.shaft.status import new_bank

numba = pytest.importorskip("numba")
pytestmark = pytest.mark.skipif(internals is None, reason="numba's public interface sets no width of vectors")
FILTERS = (np.int64(0), np.int64(16))


@pytest.mark.skipif(platform.machine() != "x86_64", reason="names the instructions of x86-64")
@pytest.mark.parametrize(("function", "numbers"), [(kalman.time_update, (1.0, 0.1)), (kalman.measurement_update, ())])
def test_roots_are_taken_of_several_filters_at_once(
    function: Any, numbers: tuple[float, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TEXTILE_TWIN_CACHE_DIR", str(tmp_path))  # what comes from the disk cannot be looked into
    renewed: Any = layout.vectorised(function.py_func)
    renewed.compile(tuple(numba.typeof(each) for each in (new_bank(ShaftSettings())[0]["filters"], *numbers, *FILTERS)))
    _assert_vectors(renewed)


@pytest.mark.skipif(platform.machine() != "x86_64", reason="names the instructions of x86-64")
def test_ripple_is_updated_in_several_filters_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TEXTILE_TWIN_CACHE_DIR", str(tmp_path))
    filters, width = new_bank(ShaftSettings())[0]["filters"], np.int64(4)
    renewed: Any = layout.of_arrays(ripple.update_ripple.py_func)  # type: ignore[attr-defined]
    names = ("sensitivity", "ripple", "factor", "regressor", "projected_ripple", "innovation", "clock_variance")
    more = ("gain", "clock", "parts", "ripple_change")
    renewed.compile(
        tuple(numba.typeof(each) for each in (*(filters[name] for name in (*names, *more)), width, *FILTERS))
    )
    _assert_vectors(renewed)


def _assert_vectors(compiled: Any) -> None:
    """Check the vector length: longer vectors would process the filters of a small model one by one."""
    (assembly,) = compiled.inspect_asm().values()
    roots = re.findall(r"sqrtpd.*", assembly)
    assert roots and not any("zmm" in root for root in roots)
