"""Tests of the recording read back: its values are the inputs, and the linkage follows independent equations."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rerun.chunk

from tests.views.conftest import START_NS, Run, rows_of, scalars_of
from textile_twin_core.comparison import compare_torque
from textile_twin_core.dynamics.loads import ForceCurve
from textile_twin_core.errors import OutputError
from textile_twin_core.inference.learned_curve import LearnedCurve
from textile_twin_core.machines import tufting
from textile_twin_core.views import write_comparison_recording
from textile_twin_core.views.force_law_plot import ForceLawPlot
from textile_twin_core.views.recording import limit_of


@pytest.fixture(scope="module")
def recording(run: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recording") / "run.rrd"
    return write_comparison_recording(path, run.comparison, run.machine, title="run-up to 160 rpm")


def test_measured_torque_is_the_measured_torque(recording: Path, run: Run) -> None:
    times, values = scalars_of(recording, "/torque/measured")
    np.testing.assert_allclose(times, (run.measured_ns - START_NS) * 1e-9, atol=1e-9)
    np.testing.assert_array_equal(values, run.measured_Nm)


def test_predicted_torque_is_what_the_sensor_should_show_with_its_sigma(recording: Path, run: Run) -> None:
    times, values = scalars_of(recording, "/torque/predicted", "Measurements:values")
    _, variances = scalars_of(recording, "/torque/predicted", "Measurements:variances")
    delay = run.comparison.delay.value
    np.testing.assert_allclose(times, (run.stamps_ns - START_NS) * 1e-9 + delay, atol=1.1e-9)
    np.testing.assert_allclose(values, 1.01 * run.predicted_Nm, rtol=1e-14)
    np.testing.assert_allclose(variances, (1.01 * run.sigma_Nm) ** 2, rtol=1e-12)


def test_residual_has_gaps_where_nothing_was_compared(recording: Path, run: Run) -> None:
    times, values = scalars_of(recording, "/residual/residual")
    np.testing.assert_array_equal(np.isfinite(values), run.comparison.used)
    np.testing.assert_array_equal(values, run.comparison.residual_Nm)
    limit = limit_of(run.comparison)
    over_times, over = scalars_of(recording, "/residual/over_limit")
    expected = np.abs(np.nan_to_num(run.comparison.residual_Nm)) > limit
    np.testing.assert_allclose(over_times, times[expected], atol=1e-9)
    np.testing.assert_array_equal(over, values[expected])
    _, upper = scalars_of(recording, "/residual/limit_upper")
    np.testing.assert_allclose(upper, limit)


def test_links_stand_where_the_loop_closes(recording: Path, run: Run) -> None:
    """Solve crank, coupler and needle bar from the loop closure of Xu et al. 2016, Eq. 1 and 14."""
    times, places = rows_of(recording, "/world/base/links/l2", "Transform3D:translation")
    theta = np.interp(times, (run.stamps_ns - START_NS) * 1e-9, run.theta_rad)
    start = np.array([place[0] for place in places])[:, :2]
    crank = 0.015 * np.column_stack([np.cos(theta), np.sin(theta)])
    np.testing.assert_allclose(start, crank, atol=1e-7)  # 32 bits on the screen

    to_c = np.array([0.070, 0.155]) - crank
    distance = np.hypot(*to_c.T)
    corner = np.arccos((0.115**2 + distance**2 - 0.138**2) / (2 * 0.115 * distance))
    rocker = np.arctan2(-to_c[:, 1], -to_c[:, 0]) - corner  # of C -> B
    arm = rocker + np.deg2rad(168.0) - 2 * np.pi
    joint = np.array([0.070, 0.155]) + 0.125 * np.column_stack([np.cos(arm), np.sin(arm)])
    slider = joint[:, 1] - np.sqrt(0.120**2 - (0.170 - joint[:, 0]) ** 2)
    _, places = rows_of(recording, "/world/base/links/l6", "Transform3D:translation")
    bar = np.array([place[0] for place in places])[:, :2]
    np.testing.assert_allclose(bar[:, 0], 0.170, atol=1e-7)
    np.testing.assert_allclose(bar[:, 1], slider, atol=1e-6)
    stroke = bar[:, 1].max() - bar[:, 1].min()
    assert stroke == pytest.approx(0.0327884, abs=2e-5)


def test_the_crank_turns_with_the_shaft(recording: Path, run: Run) -> None:
    times, turns = rows_of(recording, "/world/base/links/l1", "Transform3D:quaternion")
    theta = np.interp(times, (run.stamps_ns - START_NS) * 1e-9, run.theta_rad)
    x, y, z, w = np.array([turn[0] for turn in turns]).T
    np.testing.assert_allclose([x, y], 0.0, atol=1e-7)
    np.testing.assert_allclose(np.cos(2 * np.arctan2(z, w)), np.cos(theta), atol=1e-6)
    np.testing.assert_allclose(np.sin(2 * np.arctan2(z, w)), np.sin(theta), atol=1e-6)


def test_phases_change_at_the_events(recording: Path, run: Run) -> None:
    times, states = rows_of(recording, "/phase/needle_backing", "StateChange:state")
    theta = np.interp(times[1:], (run.stamps_ns - START_NS) * 1e-9, run.theta_rad)
    entry, leave = 0.38312100023839724, 3.3846508836082833
    for angle, (state,) in zip(np.mod(theta, 2 * np.pi), states[1:], strict=True):
        assert angle == pytest.approx(entry if state == "in backing" else leave, abs=1e-4)
    assert len(states) == 2 * np.count_nonzero(np.diff(np.floor((run.theta_rad - entry) / (2 * np.pi)))) + 1


def test_the_bad_turn_is_in_the_list_of_events(recording: Path) -> None:
    _, texts = rows_of(recording, "/events", "TextLog:text")
    assert any("turn 9: residual +2." in text[0] for text in texts), texts


def test_the_summary_has_the_numbers(recording: Path, run: Run) -> None:
    _, texts = rows_of(recording, "/summary", "TextDocument:text")
    text = str(texts[0][0])
    assert "run-up to 160 rpm" in text
    assert f"{run.comparison.errors.rms_error_Nm:.4f} N m" in text
    assert "load jump" in text


def test_file_has_its_footer_and_layout(recording: Path) -> None:
    reader = rerun.chunk.RrdReader(str(recording))
    assert reader.store().schema() is not None  # needs the footer
    assert len(reader.recordings()) == 1
    assert len(reader.blueprints()) >= 1
    assert recording.stat().st_size < 2_000_000


def test_a_place_that_cannot_be_written_is_named_and_left_clean(run: Run, tmp_path: Path) -> None:
    with pytest.raises(OutputError):
        write_comparison_recording(tmp_path / "no" / "no" / "run.rrd", run.comparison, run.machine, title="a test")
    with pytest.raises(OutputError):
        write_comparison_recording(tmp_path, run.comparison, run.machine, title="a test")
    assert list(tmp_path.iterdir()) == []


def test_an_old_file_is_replaced_as_a_whole(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "run.rrd"
    path.write_bytes(b"old")
    write_comparison_recording(path, run.comparison, run.machine, title="a test")
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.rrd"]
    assert scalars_of(path, "/torque/measured")[1].size == run.measured_Nm.size


def test_no_prediction_is_drawn_over_a_gap(run: Run, tmp_path: Path) -> None:
    kept = (np.arange(run.stamps_ns.size) < 1200) | (np.arange(run.stamps_ns.size) >= 1400)
    comparison = compare_torque(
        run.measured_ns,
        run.measured_Nm,
        run.stamps_ns[kept],
        run.predicted_Nm[kept],
        run.theta_rad[kept],
        torque_sensor=run.machine.sensors.torque,
        events=run.machine.events(),
    )
    path = write_comparison_recording(tmp_path / "gap.rrd", comparison, run.machine, title="a test")
    times, predicted = scalars_of(path, "/torque/predicted", "Measurements:values")
    np.testing.assert_allclose(
        times[np.isnan(predicted)] - comparison.delay.value, [1199.5 * 2e-3, 1399.5 * 2e-3], atol=1e-6
    )


def test_the_force_law_is_drawn_with_its_bands_and_the_machine_moves_along_it(run: Run, tmp_path: Path) -> None:
    """The point is at the depth of the needle by the loop closure's range, and on the curve of its way."""
    knots = np.linspace(0.5578, 0.5742, 15)
    down, up = 600.0 + 400.0 * np.exp(-(((knots - knots[3]) / 0.002) ** 2)), np.full(knots.size, 270.0)
    law = LearnedCurve("backing", "needle_position_m", knots, down, up, 400.0 * np.eye(2 * knots.size), 0, 16.755)
    comparison = replace(run.comparison, curves={"backing": law})
    path = write_comparison_recording(tmp_path / "law.rrd", comparison, run.machine, title="law")
    plot = ForceLawPlot.of(run.machine, comparison.curves)
    assert plot is not None
    _, points = rows_of(path, "/force_law/now", "Points2D:positions")
    x, y = np.array([point[0] for point in points]).T
    zero = float(plot.canvas.y(np.zeros(1))[0])
    reached = plot.canvas.y(np.array([down.max(), 270.0]))
    assert np.isclose(y, reached[1], atol=0.01).sum() > 100  # on the way out
    assert y.min() == pytest.approx(reached[0], abs=0.02 * plot.canvas.height)  # the peak of the way in
    assert np.isclose(y, zero, atol=0.01).sum() > 100 and x.min() >= 0.0 and x.max() <= plot.canvas.width


def test_a_force_curve_of_the_file_is_drawn_without_a_band() -> None:
    knots = (0.558, 0.562, 0.574)
    curve = ForceCurve("needles", "needle_position_m", knots, (300.0, 900.0, 500.0), (200.0, 200.0, 200.0))
    machine = replace(tufting(), loads=(curve,))
    plot = ForceLawPlot.of(machine, {})
    assert plot is not None and plot.title == "Force of needles [N over mm]"
    assert plot.canvas.high > 900.0
    assert ForceLawPlot.of(replace(machine, loads=()), {}) is None
