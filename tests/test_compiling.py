"""Compiled loops: cached by content in whole files, with numba's internals, by its public interface, and without it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import weakref
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from textile_twin_core.arrays import FloatArray
from textile_twin_core.compiling import by_reference, compiled, compiled_in_place, internals

_PROGRAM = """
import sys
from concurrent.futures import ThreadPoolExecutor
sys.path.insert(0, sys.argv[1])
import logging
logging.basicConfig(format="%(message)s")
import numpy as np
from caller import doubled
total = doubled(np.arange(5.0))
hits = sum(doubled.stats.cache_hits.values()) if hasattr(doubled, "stats") else -1
print(total, hits)
"""
_PLAIN_NUMBA = "import os\nos.environ['TEXTILE_TWIN_PLAIN_NUMBA'] = '1'\n" + _PROGRAM
_WITHOUT_NUMBA = "import sys\nsys.modules['numba'] = None\n" + _PROGRAM
_CALLEE = """
from textile_twin_core.compiling import compiled
FACTOR = {factor}
@compiled
def times(x):
    return FACTOR * x
"""
_CALLER = """
from textile_twin_core.compiling import compiled
import callee
from callee import times
@compiled
def doubled(values):
    total = 0.0
    for i in range(values.shape[0]):
        total += times(values[i])
    return total
@compiled
def unrelated(x):
    return x
"""


@pytest.fixture
def modules(tmp_path: Path) -> Path:
    folder = tmp_path / "modules"
    folder.mkdir()
    (folder / "caller.py").write_text(_CALLER)
    _write_callee(folder, 2.0)
    return folder


def _write_callee(folder: Path, factor: float) -> None:
    (folder / "callee.py").write_text(_CALLEE.format(factor=factor))


def _start(modules: Path, cache: Path, program: str = _PROGRAM) -> subprocess.Popen[str]:
    environment = os.environ | {"TEXTILE_TWIN_CACHE_DIR": str(cache), "PYTHONDONTWRITEBYTECODE": "1"}
    return subprocess.Popen(
        [sys.executable, "-c", program, str(modules)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
    )


def _run(modules: Path, cache: Path, program: str = _PROGRAM) -> tuple[float, int, str]:
    """Run a program; return the sum, the number of cache hits and the warnings."""
    process = _start(modules, cache, program)
    out, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    total, hits = out.split()
    return float(total), int(hits), err


@pytest.mark.slow
@pytest.mark.parametrize(
    "program",
    [
        pytest.param(_PROGRAM, id="internals"),
        pytest.param(_PLAIN_NUMBA, id="public interface", marks=pytest.mark.campaign),
    ],
)
def test_a_cached_loop_is_used_until_a_function_that_it_calls_changes(
    modules: Path, tmp_path: Path, program: str
) -> None:
    cache = tmp_path / "cache"
    assert _run(modules, cache, program) == (20.0, 0, "")
    assert _run(modules, cache, program) == (20.0, 1, "")
    _write_callee(modules, 3.0)
    assert _run(modules, cache, program) == (30.0, 0, "")


@pytest.mark.slow
def test_a_function_that_moved_to_another_module_is_compiled_again_without_a_warning(
    modules: Path, tmp_path: Path
) -> None:
    cache = tmp_path / "cache"
    _run(modules, cache)
    (modules / "callee.py").rename(modules / "moved.py")
    (modules / "caller.py").write_text(_CALLER.replace("callee", "moved"))
    assert _run(modules, cache) == (20.0, 0, "")


@pytest.mark.campaign
@pytest.mark.slow
def test_damaged_entries_are_compiled_again_and_reported_once(modules: Path, tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    _run(modules, cache)
    for entry in cache.iterdir():
        entry.write_bytes(entry.read_bytes()[:100])
    total, hits, said = _run(modules, cache)
    assert (total, hits) == (20.0, 0)
    assert said.count("\n") == 1 and "cannot be read" in said and str(cache) in said
    assert _run(modules, cache) == (20.0, 1, "")


def test_a_directory_that_cannot_be_written_is_reported_once(modules: Path, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    total, hits, said = _run(modules, tmp_path / "file" / "cache")
    assert (total, hits) == (20.0, 0)
    assert "TEXTILE_TWIN_CACHE_DIR" in said


@pytest.mark.campaign
@pytest.mark.slow
def test_processes_that_start_together_do_not_disturb_each_other(modules: Path, tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    together = [_start(modules, cache) for _ in range(3)]
    for process in together:
        out, err = process.communicate(timeout=120)
        assert (process.returncode, out.split()[0], err) == (0, "20.0", "")
    assert len([entry for entry in cache.iterdir() if entry.name.startswith("doubled-")]) == 1
    assert _run(modules, cache) == (20.0, 1, "")


def test_without_numba_loops_run_as_plain_python_and_one_warning(modules: Path, tmp_path: Path) -> None:
    total, _, said = _run(modules, tmp_path / "cache", _WITHOUT_NUMBA)
    assert total == 20.0
    assert said.count("\n") == 1 and "install numba" in said


_TWIN = """
import json
import numpy as np
import textile_twin_core as ttc
from textile_twin_core import compiling
twin = ttc.compile(ttc.machines.tufting(), outputs=["balancing_torque_Nm"])
batch = twin.evaluate(np.linspace(0.0, 6.0, 70_000), 30.0, 5.0)["balancing_torque_Nm"]
single = twin.evaluate(6.0, 30.0, 5.0)["balancing_torque_Nm"]
print(json.dumps([compiling.internals is None, single, batch[::700].tolist(), float(batch[-1])]))
"""


@pytest.mark.campaign
@pytest.mark.slow
def test_the_twin_computes_the_same_torque_by_the_public_interface_of_numba(tmp_path: Path) -> None:
    def torque(**environment: str) -> tuple[bool, list[float]]:
        environment |= {"TEXTILE_TWIN_CACHE_DIR": str(tmp_path)}
        output = subprocess.check_output([sys.executable, "-c", _TWIN], env=os.environ | environment, timeout=300)
        plain, single, values, last = json.loads(output)
        assert last == pytest.approx(single, rel=1e-12)  # the plain formula in Python
        return plain, values

    (plain, expected), (_, other) = torque(TEXTILE_TWIN_PLAIN_NUMBA="1"), torque()
    assert plain
    assert any(entry.name.startswith("run-") for entry in tmp_path.iterdir())  # a loop was compiled
    np.testing.assert_allclose(other, expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())


@pytest.mark.skipif(internals is None, reason="numba's public interface counts the users of every array")
def test_in_place_no_array_can_be_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TEXTILE_TWIN_CACHE_DIR", str(tmp_path))

    @compiled_in_place
    def made(count: int) -> float:
        return float(np.empty(count)[0])

    with pytest.raises(Exception, match=r"empty|NRT"):
        made(3)


def _program_and_part() -> tuple[Callable[[float], float], Callable[[float], float]]:
    """Two functions of which the first calls the second."""

    @compiled
    def twice(x: float) -> float:
        return 2.0 * x

    @compiled
    def four_times(x: float) -> float:
        return twice(twice(x))

    return four_times, twice


def test_a_part_of_a_program_can_be_called_as_well(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TEXTILE_TWIN_CACHE_DIR", str(tmp_path))
    four_times, twice = _program_and_part()

    assert four_times(1.5) == 6.0
    assert twice(1.5) == 3.0
    assert twice(2) == 4  # of another type
    assert four_times(2) == 8


def test_threads_may_compile_a_part_and_its_program_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TEXTILE_TWIN_CACHE_DIR", str(tmp_path))
    four_times, twice = _program_and_part()

    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda function: function(1.5), [four_times, twice] * 4))
    assert found == [6.0, 3.0] * 4


def test_functions_of_numba_that_call_each_other_are_parts_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A product of matrices compiles np.empty, which the program has compiled before."""
    monkeypatch.setenv("TEXTILE_TWIN_CACHE_DIR", str(tmp_path))

    @compiled
    def gram(rows: int) -> FloatArray:
        matrix = np.zeros((rows, rows))
        for k in range(rows):
            matrix[k, k] = max(k + 1.0, 2.0)
        return matrix @ matrix

    assert np.array_equal(gram(3), np.diag([4.0, 4.0, 9.0]))


@by_reference
class _Scale(NamedTuple):
    factors: FloatArray
    steps: FloatArray
    upwards: bool
    offset: float


def test_named_tuples_are_passed_by_reference(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TEXTILE_TWIN_CACHE_DIR", str(tmp_path))

    @compiled
    def entry(scale: _Scale, row: int, column: int) -> float:
        product = scale.factors[row] * scale.steps[row, column]
        return scale.offset + (product if scale.upwards else -product)

    @compiled
    def fill(scale: _Scale, scale_of_others: _Scale, result: FloatArray) -> None:
        for row in range(scale.factors.size):
            for column in range(scale.steps.shape[1]):
                result[row, column] = entry(scale, row, column) + entry(scale_of_others, 0, 0)
            scale.factors[row] = -1.0

    up = _Scale(np.array([2.0, 3.0]), np.arange(6.0).reshape(2, 3), True, 0.5)
    down = _Scale(np.array([7.0, 0.0]), np.ones((1, 9))[:, ::3], False, 0.25)
    expected = 0.5 + np.array([[2.0], [3.0]]) * up.steps - 6.75
    held = [weakref.ref(field) for field in (*up, *down) if isinstance(field, np.ndarray)]
    result = np.empty((2, 3))
    fill(up, down, result)

    np.testing.assert_array_equal(result, expected)
    np.testing.assert_array_equal(up.factors, -1.0)  # its own array, not a copy
    del up, down
    assert [each() for each in held] == [None] * 4  # the loop holds none of them
    assert any(path.name.startswith("fill-") for path in tmp_path.iterdir())
