"""Tests of the comparison plot: written whole, small enough for a page, with both curves in it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.views.conftest import Run
from textile_twin_core.errors import RecordingError
from textile_twin_core.views import plot_comparison


def share_of(path: Path, colour: tuple[int, int, int], box: tuple[float, float, float, float]) -> float:
    """Return the share of columns in a region of the picture (fractions of its size) that contain the colour."""
    image = np.asarray(Image.open(path).convert("RGB"), dtype=np.int64)
    height, width = image.shape[:2]
    view = image[int(box[1] * height) : int(box[3] * height), int(box[0] * width) : int(box[2] * width)]
    return float((np.abs(view - np.array(colour)).max(axis=2) < 40).any(axis=0).mean())


def test_draws_measured_predicted_residual_and_linkage(run: Run, tmp_path: Path) -> None:
    path = plot_comparison(tmp_path / "run.png", run.comparison, run.machine, title="Run-up")
    assert Image.open(path).size == (1600, 1000)
    assert path.stat().st_size < 300_000
    over_time, over_angle, residual = (0.25, 0.1, 0.61, 0.47), (0.67, 0.1, 0.97, 0.47), (0.25, 0.57, 0.61, 0.93)
    measured, predicted = (224, 123, 0), (0, 114, 178)
    for box in (over_time, over_angle):
        assert share_of(path, measured, box) > 0.3
        assert share_of(path, predicted, box) > 0.8
    assert share_of(path, (194, 55, 122), residual) > 0.8
    assert share_of(path, (42, 157, 99), (0.02, 0.6, 0.2, 0.85)) > 0.3  # the backing in the sketch


def test_a_place_that_cannot_be_written_is_named(run: Run, tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="cannot write"):
        plot_comparison(tmp_path / "no" / "run.png", run.comparison, run.machine)
