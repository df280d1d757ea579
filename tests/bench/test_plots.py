"""Pictures of the benchmark: rendered, with our methods, and without overlapping names."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from tests.benchmarks.impact_table import EVENT_DRIVEN, PENALTY, WITH_EVENTS, ImpactRow
from tests.benchmarks.plots import plot_impacts, plot_shaft, plot_work_precision, style
from tests.benchmarks.plots.labels import Annotation, place_labels
from tests.benchmarks.shaft_signal import LOADS
from tests.benchmarks.shaft_table import DRAWN_BITS, LAGS_S, NO_ALPHA, ShaftRow
from textile_twin_core.bench.run import Row

CROWD = {
    "C, vectorised": (15.4, 8.2e-16), "C, libm loop": (122.0, 8.7e-16), "exact": (117.0, 9.4e-16),
    "table 1e-04": (64.0, 1.1e-5), "table 1e-13": (87.0, 1.2e-15), "numba, njit": (129.0, 8.7e-16),
    "numba, njit, fast": (106.0, 8.9e-16), "casadi, generated C": (156.0, 8.2e-16), "jax, jit, vmap": (66.0, 8.2e-16),
    "pinocchio, projection": (3.0e5, 4.7e-15), "mujoco, projection": (3.7e5, 5.1e-15),
    "mujoco, soft loop": (3.5e5, 2.3e-3), "drake, projection": (5.1e5, 5.1e-15), "exudyn, steps": (1.6e5, 9.5e-7),
}  # fmt: skip
"""Methods of a run with all peers: eight of them within a quarter of a decade."""


def _share(path: Path, colour: str) -> float:
    """Return the share of the picture's pixels in about this colour."""
    pixels = matplotlib.image.imread(path)
    assert pixels.shape[0] > 400 and pixels.shape[1] > 800
    return float(np.mean(np.abs(pixels[..., :3] - to_rgb(colour)).max(axis=-1) < 0.1))


NAMELESS = [(90.0, 1e-12), (200.0, 1e-6), (2e5, 1e-3)]


def _labels(points: dict[str, tuple[float, float]]) -> list[Annotation]:
    return [Annotation(x, y, name, "black") for name, (x, y) in points.items()]


@pytest.mark.parametrize("size", [(10.0, 6.0), (6.0, 4.0)])
def test_no_name_covers_another(size: tuple[float, float]) -> None:
    figure = Figure(figsize=size, dpi=100)
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    axes.set(xscale="log", yscale="log", xlim=(4.0, 3e6), ylim=(1e-17, 1e-1))
    boxes = place_labels(axes, _labels(CROWD), [[(64.0, 1.1e-5), (87.0, 1.2e-15), (117.0, 9.4e-16)]], NAMELESS)
    assert len(boxes) == len(CROWD)
    assert not any(a.overlaps(b) for a, b in combinations(boxes, 2))
    points = axes.transData.transform([*CROWD.values(), *NAMELESS])
    for box in boxes:
        assert axes.bbox.x0 <= box.left and box.right <= axes.bbox.x1
        assert axes.bbox.y0 <= box.bottom and box.top <= axes.bbox.y1
        assert not any(box.left < x < box.right and box.bottom < y < box.top for x, y in points)
    drawn = {text.get_text(): text.get_window_extent() for text in axes.texts}
    for name, box in zip(CROWD, boxes, strict=True):
        assert drawn[name].extents == pytest.approx((box.left, box.bottom, box.right, box.top), abs=0.5)


def test_a_lonely_point_has_its_name_at_its_right() -> None:
    figure = Figure(figsize=(4.0, 3.0), dpi=100)
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    (box,) = place_labels(axes, [Annotation(0.3, 0.5, "here", "black")])
    x, y = axes.transData.transform((0.3, 0.5))
    assert box.left - x == pytest.approx(11.0) and (box.bottom + box.top) / 2.0 == pytest.approx(y)
    assert len(axes.lines) == 0


@pytest.mark.campaign
def test_work_precision(tmp_path: Path) -> None:
    rows = []
    for name, (time, error) in CROWD.items():
        peer, _, method = name.partition(", ")
        mine = not method
        rows.append(Row(peer if mine else method, None if mine else peer, "torque", "m", 100, error, time, 1.0))
    rows.append(replace(rows[0], outputs="position", method="elsewhere"))
    rows.append(replace(rows[0], method="no batch", ns_per_sample=None))
    few, all_of_them = tmp_path / "few", tmp_path / "all.png"
    plot_work_precision([row for row in rows if row.peer is None], few)
    plot_work_precision(rows, all_of_them)
    assert _share(few, style.OURS) > 1e-3 and _share(all_of_them, style.OURS) > 1e-3
    for colour in (style.LIMIT, style.COMPILED, style.ENGINES):
        assert _share(all_of_them, colour) > 1e-4
    assert _share(few, style.LIMIT) == 0.0


@pytest.mark.campaign
@pytest.mark.slow
def test_shaft(tmp_path: Path) -> None:
    def row(estimator: str, load: str, bits: int, rpm: float) -> ShaftRow:
        latency, cost = (None, None) if estimator == NO_ALPHA else (min(LAGS_S[estimator], 6.0), 200.0 / bits)
        error = 1e-2 / bits * (1 + LOADS.index(load))
        return ShaftRow(estimator, "m", bits, rpm, load, error, 2.0 * error, None, latency, cost)

    names = (NO_ALPHA, *LAGS_S)
    rows = [row(name, load, bits, 160.0) for load in LOADS for bits in DRAWN_BITS for name in names]
    rows += [row(name, LOADS[0], 16, 20.0) for name in names]
    plot_shaft(rows, tmp_path / "shaft.png")
    for colour in (style.OURS, style.LIMIT, style.OTHERS):
        assert _share(tmp_path / "shaft.png", colour) > 1e-3


def test_impacts(tmp_path: Path) -> None:
    solvers = [WITH_EVENTS.format(name) for name in ("RK45", "DOP853", "Radau")]
    rows = [
        ImpactRow(method, f"rtol {tolerance:.0e}", tolerance * 1e-3, 10.0 * (k + 1) - np.log(tolerance), ())
        for k, method in enumerate([EVENT_DRIVEN, *solvers, PENALTY])
        for tolerance in (1e-4, 1e-8)
    ]
    plot_impacts([*rows, replace(rows[1], error_s=0.0)], tmp_path / "impacts.png")
    assert _share(tmp_path / "impacts.png", style.OURS) > 1e-3
