"""Repetitions for the fixed-lag view need --all: it runs the passes of `causal` and `smooth`."""

from __future__ import annotations

import pytest


def pytest_itemcollected(item: pytest.Item) -> None:
    values = {mark.args[0]: mark.args[1] for mark in item.iter_markers("parametrize")}
    for name in ("view", "name"):
        three = isinstance(item, pytest.Function) and len(values.get(name, ())) == 3
        if three and item.callspec.params[name] == "lag":
            item.add_marker(pytest.mark.campaign)
