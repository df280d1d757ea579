"""Choice of the tests and their scheduling over processes."""

from __future__ import annotations

import os

import pytest
from hypothesis import settings
from xdist.scheduler import LoadScopeScheduling

START_NODES = ("tests/ros/", "tests/launch_scripts/", "tests/docs/")
"""Folders whose tests start real-time processes: these run one after the other, so that each has a processor."""

LOWER = 10
"""Niceness of the workers that run no node."""

settings.register_profile("suite", deadline=None)
settings.load_profile("suite")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--all", action="store_true", help="run the tests marked 'campaign', too")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if config.getoption("--all"):
        return
    left_out = [item for item in items if item.get_closest_marker("campaign")]
    config.hook.pytest_deselected(items=left_out)
    items[:] = [item for item in items if not item.get_closest_marker("campaign")]


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Leave the processors to real-time tests: a worker that begins with other tests runs at a lower priority."""
    if not item.nodeid.startswith(START_NODES) and "PYTEST_XDIST_WORKER" in os.environ and os.nice(0) < LOWER:
        os.nice(LOWER)


class Rows(LoadScopeScheduling):
    """Scheduler that gives whole files to the workers, and the folders above as one."""

    def _split_scope(self, nodeid: str) -> str:
        return "nodes" if nodeid.startswith(START_NODES) else nodeid.split("::", 1)[0]


def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> Rows:
    return Rows(config, log)
