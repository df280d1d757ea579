"""Growth of time and memory with the work: samples, machines of a mill, needle linkages on one shaft."""

from __future__ import annotations

import statistics
import tracemalloc
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.bench.scenes import Motion
from textile_twin_core.bench.timing import clock, one_core
from textile_twin_core.machine import Machine, ShaftPlace
from textile_twin_core.twin import Twin, compile_rigid

TORQUE = "balancing_torque_Nm"
SAMPLES = (100, 1_000, 10_000, 100_000, 1_000_000, 10_000_000)
MACHINES = (1, 10, 100)
LINKAGES = (1, 4, 16, 64)
_PER_MACHINE = 20_000


@dataclass(frozen=True)
class Growth:
    """Time per unit of work, and memory beyond input and output, at one size."""

    what: str
    size: int
    method: str
    ns_per_unit: float
    memory_MiB: float


@one_core()
def growth(machine: Machine, progress: Callable[[int, int], object] = lambda done, total: None) -> list[Growth]:
    """Measure growing numbers of samples, machines and linkages, with the torque as output."""
    total = 2 * (len(SAMPLES) + len(MACHINES) + len(LINKAGES))
    rows = []
    for done, row in enumerate(_rows(machine), start=1):
        rows.append(row)
        progress(done, total)
    return rows


def _rows(machine: Machine) -> Iterator[Growth]:
    for method in ("exact", "table"):
        twin = compile_rigid(machine, [TORQUE], method, 1e-13)
        for size in SAMPLES:
            motion, out = _motion(machine, size), {TORQUE: np.empty(size)}
            yield _measure("samples", size, method, size, partial(twin.evaluate, *motion, out=out))
        for size in MACHINES:
            twins = [compile_rigid(machine, [TORQUE], method, 1e-13) for _ in range(size)]
            motion, out = _motion(machine, _PER_MACHINE), {TORQUE: np.empty(_PER_MACHINE)}
            work = size * _PER_MACHINE
            yield _measure("machines", size, method, work, partial(_all, twins, motion, out))
        for size in LINKAGES:
            places = tuple(ShaftPlace(2.0 * np.pi * k / size) for k in range(size))
            mill = compile_rigid(replace(machine, linkages=places), [TORQUE], method, 1e-13)
            motion, out = _motion(machine, 100_000), {TORQUE: np.empty(100_000)}
            yield _measure("linkages", size, method, size * 100_000, partial(mill.evaluate, *motion, out=out))


def _all(twins: list[Twin], motion: Motion, out: dict[str, FloatArray]) -> None:
    for twin in twins:
        twin.evaluate(*motion, out=out)


def _motion(machine: Machine, size: int) -> Motion:
    rng = np.random.default_rng(7)
    speed = machine.nominal_speed_rad_s
    return rng.uniform(0.0, 2.0 * np.pi, size), np.full(size, speed), rng.uniform(-1.0, 1.0, size) * speed


def _measure(what: str, size: int, method: str, units: int, work: Callable[[], object]) -> Growth:
    work()
    times = []
    for _ in range(3 if units > 1_000_000 else 9):
        begin = clock()
        work()
        times.append(clock() - begin)
    tracemalloc.start()
    work()
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return Growth(what, size, method, statistics.median(times) / units * 1e9, peak / 2**20)
