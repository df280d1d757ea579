"""Further values of a parametrised test, which run with `launch_scripts/test.sh --all` only."""

from __future__ import annotations

from typing import Any

import pytest
from _pytest.mark import ParameterSet


def more(*values: Any) -> list[ParameterSet]:
    """Mark values (a tuple: several arguments) as a part of the campaign."""
    mark = pytest.mark.campaign
    return [pytest.param(*(each if isinstance(each, tuple) else (each,)), marks=mark) for each in values]
