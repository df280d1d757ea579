"""Table of the needle transfer: error of the event times against run time, for three methods of impact treatment."""

from __future__ import annotations

import statistics
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from tests.benchmarks.impact_methods import Times, TransferEquations, event_driven
from textile_twin_core.bench.timing import Candidate, one_core, take_turns
from textile_twin_core.machines.needle_transfer import needle_transfer

REFERENCE: Times = (0.015713108187298414, 0.019243773487700185)
"""Event times [s] of the original design, computed with 30 digits by Taylor series of order 24."""
EVENT_DRIVEN = "event-driven"
WITH_EVENTS = "solve_ivp {} with events"
PENALTY = "penalty contact, LSODA"
TOLERANCES = {"RK45": (1e-4, 1e-7, 1e-10), "DOP853": (1e-4, 1e-7, 1e-10, 1e-13), "Radau": (1e-4, 1e-7)}


@dataclass(frozen=True)
class ImpactRow:
    """One method at one setting on the forward stroke of the original design, up to the contact of the collets.

    Attributes:
        error_s: Larger error of the times of the pad contact and of the contact of elements 2 and 3 [s].
        ms_per_run: Median of `ms_per_round` [ms].
    """

    method: str
    setting: str
    error_s: float
    ms_per_run: float
    ms_per_round: tuple[float, ...]


@one_core()
def impact_table(rounds: int = 5, progress: Callable[[int, int], object] = lambda done, total: None) -> list[ImpactRow]:
    """Measure all methods and settings; `progress` is called with the numbers of finished and total rounds."""
    found: dict[tuple[str, str], Times] = {}

    def keep(method: str, setting: str, work: Callable[[], Times]) -> None:
        found[method, setting] = work()

    candidates = [
        Candidate(setting, method, partial(keep, method, setting, work), samples=1) for method, setting, work in ways()
    ]
    done = 0

    def tick(count: int) -> None:
        nonlocal done
        done += count
        progress(done, rounds)

    take_turns(candidates, rounds, tick)
    return [_row(key, times, candidate) for (key, times), candidate in zip(found.items(), candidates, strict=True)]


def _row(key: tuple[str, str], found: Times, candidate: Candidate) -> ImpactRow:
    error = max(abs(a - b) for a, b in zip(found, REFERENCE, strict=True))
    times = tuple(1e3 * seconds for seconds in candidate.batch_times)
    return ImpactRow(*key, error, statistics.median(times), times)


def ways() -> list[tuple[str, str, Callable[[], Times]]]:
    """Return method, setting and run of each way to the event times."""
    machine = needle_transfer()
    stroke = TransferEquations(machine)
    found: list[tuple[str, str, Callable[[], Times]]] = [
        (EVENT_DRIVEN, f"tolerance {tolerance:.0e}", partial(event_driven, machine, tolerance))
        for tolerance in (1e-4, 1e-6, 1e-8, 1e-10, 1e-13)
    ]
    for solver, tolerances in TOLERANCES.items():
        name = WITH_EVENTS.format(solver)
        found += [(name, f"rtol {rtol:.0e}", partial(stroke.with_events, solver, rtol)) for rtol in tolerances]
    for stiffness in (1e5, 1e6, 1e7, 1e8):
        found.append((PENALTY, f"{stiffness:.0e} N/m", partial(stroke.with_penalty, stiffness)))
    return found
