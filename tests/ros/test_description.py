"""The markers that the twin publishes: the needle's path and the backing, where the paper puts them."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("rclpy")

from visualization_msgs.msg import Marker

import textile_twin_core as ttc
from textile_twin_ros.description import markers_of

# Xu et al. 2016: C stands at (X1, H1), the guide X2 further, the backing 557.84 mm below C; the stroke is 32.79 mm.
X1_M, X2_M, H1_M, BACKING_M, STROKE_M = 0.070, 0.100, 0.155, 0.55784, 0.03279


def test_the_needle_and_its_backing() -> None:
    path, backing = markers_of(ttc.machines.tufting())
    assert {marker.header.frame_id for marker in (path, backing)} == {"base"}
    assert len({(marker.ns, marker.id) for marker in (path, backing)}) == 2
    x, y = np.array([(point.x, point.y) for point in path.points]).T
    np.testing.assert_allclose(x, X1_M + X2_M, rtol=0.0, atol=1e-12)
    assert np.ptp(y) == pytest.approx(STROKE_M, abs=1e-4)
    assert (path.points[0].y, path.type) == (pytest.approx(path.points[-1].y), Marker.LINE_STRIP)
    place = backing.pose.position
    assert (place.x, place.y) == pytest.approx((X1_M + X2_M, H1_M - BACKING_M))
    assert y.min() < place.y < y.max()
    assert backing.scale.y < min(backing.scale.x, backing.scale.z)


@pytest.mark.parametrize("name", ["handloom_beatup", "elliptic_gear_beatup"])
def test_a_beater_goes_along_an_arc(name: str) -> None:
    machine = ttc.machines.create(name)
    assert isinstance(machine, ttc.Machine)
    (path,) = markers_of(machine)
    points = np.array([complex(point.x, point.y) for point in path.points])
    # Three of its points have a circle, on which all others lie.
    a, b, c = points[[0, 60, 150]]
    w = (c - a) / (b - a)
    centre = (b - a) * (w - abs(w) ** 2) / (2j * w.imag) + a
    np.testing.assert_allclose(abs(points - centre), abs(a - centre), rtol=1e-9)
    assert abs(a - centre) == pytest.approx(machine.measures[0].radius_m)  # type: ignore[union-attr]
