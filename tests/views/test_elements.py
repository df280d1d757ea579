"""Views of a contact machine: every sample of every element is in the recording, live and written."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.views.conftest import START_NS, rows_of, scalars_of
from textile_twin_core.machines import needle_transfer
from textile_twin_core.views import LiveElements, write_element_recording

MACHINE = needle_transfer()
STAMPS = START_NS + np.arange(2000) * 1_000_000
POSITIONS = np.column_stack([0.03 * np.sin(0.02 * np.arange(2000) + k) for k in range(3)])
VELOCITIES = np.column_stack([0.6 * np.cos(0.02 * np.arange(2000) + k) for k in range(3)])


def check(path: Path, frames: tuple[int, int]) -> None:
    """What a reader of the recording finds."""
    for number, element in enumerate(MACHINE.elements):
        times, shown = scalars_of(path, f"/position/{element}")
        np.testing.assert_allclose(times, (STAMPS - START_NS) * 1e-9, atol=1e-9)
        np.testing.assert_allclose(shown, 1e3 * POSITIONS[:, number], rtol=1e-14)
        _, shown = scalars_of(path, f"/velocity/{element}")
        np.testing.assert_array_equal(shown, VELOCITIES[:, number])
        times, moved = rows_of(path, f"/elements/{element}", "Transform3D:translation")
        assert frames[0] <= times.size <= frames[1]
        place = POSITIONS[np.rint(times * 1e3).astype(int), number]
        np.testing.assert_allclose(np.array([row[0] for row in np.reshape(moved, (-1, 3))]), place, atol=1e-7)


def test_live(tmp_path: Path) -> None:
    with LiveElements(MACHINE, port=None, path=tmp_path / "live.rrd", flush_s=0.02) as view:
        for first in range(0, 2000, 70):
            part = slice(first, first + 70)
            view.add_motion(STAMPS[part], POSITIONS[part], VELOCITIES[part])
    assert view.error is None and view.dropped == 0
    check(tmp_path / "live.rrd", (110, 121))


def test_of_a_recording(tmp_path: Path) -> None:
    write_element_recording(tmp_path / "e.rrd", MACHINE, STAMPS, POSITIONS, VELOCITIES, title="a test")
    check(tmp_path / "e.rrd", (950, 1001))
