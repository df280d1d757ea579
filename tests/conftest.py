"""Scheduling of the tests over processes."""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command, before numpy is imported

import pytest
from hypothesis import settings
from xdist.scheduler import LoadScopeScheduling

START_NODES = ("tests/ros/", "tests/launch_scripts/", "tests/docs/")
"""Folders whose tests start real-time processes: these run one after the other, so that each has a processor."""

settings.register_profile("suite", deadline=None)
settings.load_profile("suite")


class Rows(LoadScopeScheduling):
    """Scheduler that gives whole files to the workers, and the folders above as one."""

    def _split_scope(self, nodeid: str) -> str:
        return "nodes" if nodeid.startswith(START_NODES) else nodeid.split("::", 1)[0]


def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> Rows:
    return Rows(config, log)
