"""Repetitions for the fixed-lag view need --all: it runs the passes of `causal` and `smooth`."""

from __future__ import annotations

import pytest


def pytest_itemcollected(item: pytest.Item) -> None:
    views = {mark.args[0]: mark.args[1] for mark in item.iter_markers("parametrize")}.get("view", ())
    if isinstance(item, pytest.Function) and len(views) == 3 and item.callspec.params["view"] == "lag":
        item.add_marker(pytest.mark.campaign)
