"""Views of a contact machine: every sample of every element is in the recording, live and written."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.views.conftest import START_NS, rows_of, scalars_of
from textile_twin_core.contact import ContactEvent
from textile_twin_core.machines import needle_transfer
from textile_twin_core.twin.predictor import StampedEvent
from textile_twin_core.views import LiveElements, write_element_recording

MACHINE = needle_transfer()
STAMPS = START_NS + np.arange(2000) * 1_000_000
POSITIONS = np.column_stack([0.03 * np.sin(0.02 * np.arange(2000) + k) for k in range(3)])
VELOCITIES = np.column_stack([0.6 * np.cos(0.02 * np.arange(2000) + k) for k in range(3)])


def event(sample: float, kind: str, name: str, speed: float) -> StampedEvent:
    ends = {part.name: (part.lower, part.upper) for part in (*MACHINE.stops, *MACHINE.pads)}
    time_s = 1e-3 * sample
    return StampedEvent(START_NS + round(time_s * 1e9), ContactEvent(time_s, kind, name, ends[name], time_s, speed))


EVENTS = [
    event(100.5, "impact", "collet_contact", 0.8),
    event(101.0, "impact", "collet_contact", 0.4),  # a bounce
    event(102.0, "rest", "collet_contact", 0.0),
    event(300.0, "touch", "rubber_pad", 2.5),
    event(304.0, "leave", "rubber_pad", 0.0),
    event(900.0, "impact", "cone", 1.2),
]


def check_contacts(path: Path) -> None:
    """Check that each impact is at its time and place, marked once with its bounces, and that the pad is pressed
    in between.
    """
    for name, when, speeds, element in (
        ("collet_contact", [0.1005, 0.101], [0.8, 0.4], 2),
        ("rubber_pad", [0.3], [2.5], 1),
        ("cone", [0.9], [1.2], 2),
    ):
        times, shown = scalars_of(path, f"/contacts/{name}/top")
        np.testing.assert_allclose(times, when, atol=1e-9)
        np.testing.assert_array_equal(shown, speeds)
        times, shown = scalars_of(path, f"/position/at_{name}")
        places = np.interp(when, 1e-3 * np.arange(2000), 1e3 * POSITIONS[:, element])
        np.testing.assert_allclose(shown, places, rtol=1e-9)
        times, _ = rows_of(path, f"/elements/contacts/{name}", "LineStrips2D:strips")
        np.testing.assert_allclose(times, when[:1], atol=1e-9)
    times, states = rows_of(path, "/pads/rubber_pad", "StateChange:state")
    np.testing.assert_allclose(times, [0.3, 0.304], atol=1e-9)
    assert [str(state) for state in np.ravel(states)] == ["pressed", "free"]
    times, summaries = rows_of(path, "/summary", "TextDocument:text")
    assert "| rubber pad: element 2 on frame | 2.50 m/s |  | 1 |" in str(summaries[np.flatnonzero(times <= 0.5)[-1]])
    assert "| collet contact: element 3 on element 2 | 0.80 m/s | 0.00 mN s | 1, 1 bounces |" in str(summaries[-1])


def check(path: Path, frames: tuple[int, int]) -> None:
    """Check the recording against the simulated motion."""
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
            # Events arrive before or after their motion.
            stamps = [each for each in EVENTS if first <= (each.stamp - START_NS) / 1e6 < first + 70]
            if first % 140:
                view.add_events(stamps)
            view.add_motion(STAMPS[part], POSITIONS[part], VELOCITIES[part])
            if not first % 140:
                view.add_events(stamps)
    assert view.error is None and view.dropped == 0
    check(tmp_path / "live.rrd", (110, 121))
    check_contacts(tmp_path / "live.rrd")


def test_of_a_recording(tmp_path: Path) -> None:
    write_element_recording(tmp_path / "e.rrd", MACHINE, STAMPS, POSITIONS, VELOCITIES, EVENTS, title="a test")
    check(tmp_path / "e.rrd", (950, 1001))
    check_contacts(tmp_path / "e.rrd")
