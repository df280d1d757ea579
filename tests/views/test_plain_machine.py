"""Views of a machine other than a loom: names of events, warnings, a picture without overlaps."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text
from PIL import Image

import textile_twin_core as ttc
from tests.views.conftest import Run, rows_of
from textile_twin_core.comparison import compare_torque
from textile_twin_core.views import paper, plot_machine, write_comparison_recording
from textile_twin_core.views.measure_curves import marks_for, phase_rows_for
from textile_twin_core.views.plot_linkage import clearest_angle, draw_linkage
from textile_twin_core.views.recording import limit_of
from textile_twin_core.views.scene import build_scene

PUMP = ttc.load_machine("examples/beam_pump.yaml")


def test_an_arc_is_named_as_its_measure_and_a_sleys_beats_up() -> None:
    ((name, angle),) = marks_for(PUMP)
    assert name == "horse head front"
    theta = np.linspace(0.0, 2.0 * np.pi, 100_001)
    still = np.zeros_like(theta)
    position = ttc.compile(PUMP, outputs=["horse_head_position_m"]).evaluate(theta, still, still)
    assert abs(theta[np.argmax(position["horse_head_position_m"])] - angle) < 1e-3
    (row,) = phase_rows_for(PUMP)
    assert {state for _, state in row.begins} == {"forward", "back"}
    for loom in (ttc.machines.handloom_beatup(), ttc.machines.elliptic_gear_beatup()):
        assert "beat-up" in {name for name, _ in marks_for(loom)}
        assert any("beat-up" in {state for _, state in row.begins} for row in phase_rows_for(loom))


@pytest.mark.parametrize("noise_Nm", [0.02, 0.3])
def test_a_machine_in_order_raises_no_warning_and_a_knock_does(run: Run, tmp_path: Path, noise_Nm: float) -> None:
    rng = np.random.default_rng(3)
    # A periodic residual, such as unmodelled friction, and noise.
    healthy = 1.01 * run.predicted_Nm + noise_Nm * (np.sin(run.theta_rad) + rng.normal(0.0, 1.0, len(run.theta_rad)))
    knocked = healthy + 20.0 * noise_Nm * (np.floor(run.theta_rad / (2.0 * np.pi)) == 11)
    for measured, turns in ((healthy, 0), (knocked, 1)):
        comparison = compare_torque(
            run.stamps_ns,
            measured,
            run.stamps_ns,
            run.predicted_Nm,
            run.theta_rad,
            torque_sensor=run.machine.sensors.torque,
            settled=np.arange(len(measured)) > 250,
        )
        assert np.count_nonzero(np.abs(comparison.by_revolution.worst_Nm) > limit_of(comparison)) == turns
        path = write_comparison_recording(tmp_path / f"{turns}.rrd", comparison, run.machine, title="in order")
        _, lines = rows_of(path, "/events", "TextLog:text")
        assert sum("turn " in str(line) and "residual" in str(line) for line in lines) == turns


@pytest.mark.parametrize("machine", [PUMP, ttc.machines.tufting(), ttc.load_machine("examples/six_bar_loom.yaml")])
def test_links_and_labels_of_a_picture_do_not_cover_each_other(machine: ttc.Machine) -> None:
    scene = build_scene(machine)
    figure, axes = plt.subplots(figsize=(5.0, 8.0))
    draw_linkage(axes, scene, machine)
    figure.draw_without_rendering()
    boxes = {text.get_text(): text.get_window_extent() for text in axes.texts if text.get_text() != "backing"}
    assert {part.name for part in scene.moving if part.length_m > 0.05 * scene.size_m} <= boxes.keys()
    names = sorted(boxes)
    for k, name in enumerate(names):
        assert not any(boxes[name].overlaps(boxes[other]) for other in names[k + 1 :]), name
    plt.close(figure)


def test_the_picture_is_drawn_at_the_angle_asked_for(tmp_path: Path) -> None:
    """Draw at the ends of the stroke, where crank and pitman lie in one line; the default angle is elsewhere."""
    scene = build_scene(PUMP)
    theta = clearest_angle(PUMP, scene)
    crank, pitman = (
        ttc.compile(PUMP, outputs=[f"theta_{link}_rad"]).evaluate(theta)[f"theta_{link}_rad"]
        for link in ("crank", "pitman")
    )
    assert abs(np.sin(pitman - crank)) > 0.2
    pictures = []
    for at in (None, 0.0, 90.0):
        plot_machine(tmp_path / "picture.png", PUMP, at_deg=at)
        with Image.open(tmp_path / "picture.png") as picture:
            pictures.append(np.asarray(picture.convert("RGB")))
    assert all(np.any(pictures[k] != pictures[k - 1]) for k in range(3))


@pytest.mark.parametrize("needle_bar_m", [0.44, 2.0])
def test_the_caption_of_a_linkage_does_not_overprint_the_description(
    needle_bar_m: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A machine much taller than wide fills the height of the picture."""
    figures = list[Figure]()
    monkeypatch.setattr(paper, "save_png", lambda figure, path: figures.append(figure) or path)
    machine = replace(ttc.machines.tufting(l6_m=needle_bar_m), description="needle bar and its drive " * 4)
    plot_machine(tmp_path / "picture.png", machine)
    (figure,) = figures
    figure.draw_without_rendering()
    drawn = [each for each in figure.axes[0].get_children() if isinstance(each, Text) and each.get_text()]
    caption = next(each for each in drawn if each.get_text().startswith("Linkage at"))
    for other in (*figure.texts, *(each for each in drawn if each is not caption)):
        assert not caption.get_window_extent().overlaps(other.get_window_extent()), other.get_text()
