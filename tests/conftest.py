"""Choice of the tests, their scheduling over processes and the limit of their processor time."""

from __future__ import annotations

import gc
import os
import time
from collections import Counter
from collections.abc import Generator
from typing import Any

import pytest
from hypothesis import settings
from xdist.scheduler import LoadScopeScheduling

from textile_twin_core.compiling import cache_directory

IN_SERIES = {"tests/ros/": "nodes", "tests/launch_scripts/": "nodes", "tests/docs/": "pages"}
"""Folders whose tests start processes, and the series of each: a series runs in one worker, beside the other one."""

LOWER = 10
"""Niceness of the workers that run no series: nodes are real-time processes."""

WANTED_S = 2.0
"""Processor time [s] of a test that is not marked slow."""

MARGIN = 4.0
"""A test fails above MARGIN * WANTED_S: a slow or shared processor takes several times as long."""

settings.register_profile("suite", deadline=None)
settings.load_profile("suite")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--all", action="store_true", help="run the tests marked 'campaign', too")


@pytest.hookimpl(wrapper=True)
def pytest_collection(session: pytest.Session) -> Generator[None, object, object]:
    """Collect without looking for garbage, and leave what was collected out of later looks: a quarter less time."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if not config.getoption("--all"):
        left_out = [item for item in items if item.get_closest_marker("campaign")]
        config.hook.pytest_deselected(items=left_out)
        items[:] = [item for item in items if not item.get_closest_marker("campaign")]
    if _is_worker():  # begin with the series, then the longest files: none of them ends alone
        slow = Counter(_scope(item.nodeid) for item in items if item.get_closest_marker("slow"))
        items.sort(key=lambda item: (_scope(item.nodeid) not in IN_SERIES.values(), -slow[_scope(item.nodeid)]))


def _is_worker() -> bool:
    return "PYTEST_XDIST_WORKER" in os.environ


def _scope(nodeid: str) -> str:
    """Name the series of a test, or else its file."""
    return next((series for folder, series in IN_SERIES.items() if nodeid.startswith(folder)), nodeid.split("::", 1)[0])


class Rows(LoadScopeScheduling):
    """Scheduler that gives a whole series or a whole file to a worker, in the order of collection."""

    def __init__(self, config: pytest.Config, log: Any) -> None:
        config.option.loadscopereorder = False
        super().__init__(config, log)

    def _split_scope(self, nodeid: str) -> str:
        return _scope(nodeid)


def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> Rows:
    return Rows(config, log)


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Leave the processors to real-time tests: a worker that begins with other tests runs at a lower priority."""
    if _scope(item.nodeid) not in IN_SERIES.values() and _is_worker() and os.nice(0) < LOWER:
        os.nice(LOWER)


class Meter:
    """Processor time of one test, its processes included and the fixtures that it shares with others left out."""

    def __init__(self) -> None:
        self._began, self._began_s, self._shared_s = time.time(), _processor_s(), 0.0

    def leave_out(self, seconds: float) -> None:
        self._shared_s += seconds

    def seconds(self) -> float:
        return _processor_s() - self._began_s - self._shared_s

    def saw_a_compilation(self) -> bool:
        """Whether a loop was compiled meanwhile, for this test or another one: the next run finds it cached."""
        folder = cache_directory()
        return folder.is_dir() and folder.stat().st_mtime >= self._began


def _processor_s() -> float:
    used = os.times()
    return used.user + used.system + used.children_user + used.children_system


_METER = pytest.StashKey[Meter]()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    item.config.stash[_METER] = Meter()
    return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(fixturedef: Any, request: pytest.FixtureRequest) -> Generator[None, object, object]:
    began_s = _processor_s()
    try:
        return (yield)
    finally:
        if fixturedef.scope != "function":
            request.config.stash[_METER].leave_out(_processor_s() - began_s)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None) -> Generator[None, object, object]:
    """Fail a test that takes too much processor time and is not marked; one that saw a compilation is not judged."""
    meter = item.config.stash[_METER]
    used_s = meter.seconds()
    result = yield
    if nextitem is not None and nextitem.parent is item.parent:  # else this ended what the file shares, too
        used_s = meter.seconds()
    marked = item.get_closest_marker("slow") or item.get_closest_marker("campaign")
    if used_s > MARGIN * WANTED_S and not marked and not meter.saw_a_compilation():
        pytest.fail(
            f"took {used_s:.1f} s of processor time; {WANTED_S:g} s are wanted: make it quicker, share what it"
            " records in a fixture of the module, or mark it slow",
            pytrace=False,
        )
    return result
