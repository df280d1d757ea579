"""Logs in long form (a row for each value, with the name of its signal), converted to a column for each signal."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from textile_twin_core.errors import RecordingError
from textile_twin_core.recordings.log_mapping import LongForm

_VALUE = re.compile(r"(^|[^a-z])(values?|val|wert|messwert|valeur|valore?|valor|deger|data|y)([^a-z]|$)")
_SIGNALS, _ROWS = 64, 8
"""The most signals of a log in long form, and the fewest rows of each in the mean."""


def find_long_form(columns: Mapping[str, Any]) -> LongForm | None:
    """Find the two columns of a log in long form (Arrow columns by name); None for a column for each signal.

    One column repeats a few words, and one column of numbers is named as a value.
    """
    from pyarrow import types

    numbers = [
        name
        for name, cells in columns.items()
        if _VALUE.search(name.lower()) and (types.is_integer(cells.type) or types.is_floating(cells.type))
    ]
    if len(numbers) != 1:
        return None
    words = [name for name, cells in columns.items() if _is_text(cells) and _names_signals(cells, columns[numbers[0]])]
    return LongForm(words[0], numbers[0]) if len(words) == 1 else None


def by_signal(columns: Mapping[str, Any], form: LongForm) -> tuple[dict[str, Any], set[str]]:
    """Return Arrow columns with one for each signal, null in the rows of others, and the names of those columns.

    Raises RecordingError if a column of the form is missing.
    """
    from pyarrow import compute

    for name in (form.signal, form.value):
        if name not in columns:
            raise RecordingError(f"no column '{name}' of a log in long form; there are: {', '.join(columns)}")
    signal, value = (columns[name] for name in (form.signal, form.value))
    names = [name for name in compute.unique(signal).to_pylist() if name]
    if len(names) > _SIGNALS:
        raise RecordingError(f"column '{form.signal}' names {len(names)} signals; export at most {_SIGNALS} of them")
    kept = {name: cells for name, cells in columns.items() if name not in (form.signal, form.value)}
    signals = {name: compute.if_else(compute.equal(signal, name), value, None) for name in names}
    return {**kept, **signals}, set(signals)


def _is_text(cells: Any) -> bool:
    from pyarrow import types

    return bool(types.is_string(cells.type) or types.is_large_string(cells.type))


def _names_signals(cells: Any, values: Any) -> bool:
    """Return true if a column of words names signals: few words, each with many rows, and very different values.

    A state beside the values (ON, OFF) is no signal: neighbouring rows of different states have similar values.
    """
    from pyarrow import compute

    words = [word for word in compute.unique(cells).to_pylist() if word]
    if not 2 <= len(words) <= _SIGNALS or len(cells) < _ROWS * len(words):
        return False
    if all(re.search(r"[/.\[_]|[a-z][A-Z]", word) for word in words):
        return True  # paths of topics and tags
    at = np.asarray(cells.to_pylist(), dtype=object)
    number = np.asarray(values.cast("float64", safe=False).to_numpy(zero_copy_only=False), dtype=np.float64)
    changes = at[1:] != at[:-1]
    if np.count_nonzero(changes) < 0.5 * (len(words) - 1):
        return False
    within = np.concatenate([np.abs(np.diff(number[at == word])) for word in words])
    across = np.abs(np.diff(number))[changes]
    return bool(np.nanmedian(across) > 2.0 * np.nanmedian(within))
