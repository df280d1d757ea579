"""The example that reads an engine's pickup and pressure: edges of its wheel, and the torque of a known force."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

import textile_twin_core as ttc
from textile_twin_core.recordings import open_bag

SCRIPT = Path(__file__).parents[2] / "examples/engine_log.py"
ENGINE = """
name: engine
points: {O: [0, 0]}
groups:
  - {type: crank, name: crank, at: O, end: A, length_m: 0.0275}
  - {type: rrp_dyad, rod: rod, slider: piston, from: A, end: B, tip: T, lengths_m: [0.0842, 0.03],
     guide_point_m: [0, 0], guide_direction: [1, 0]}
bodies:
  {main_shaft: {mass_kg: 0, inertia_kgm2: 0.022}, rod: {mass_kg: 0.12, centroid: [0.3333, 0]}, piston: {mass_kg: 0.2}}
measures: [{type: travel, name: piston, point: B, origin: O, direction: [1, 0]}]
sensors: {encoder: {teeth: 60, missing_teeth: 3, cycle_turns: 2}}
"""


def test_edges_and_torque(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    spec = importlib.util.spec_from_file_location("engine_log", SCRIPT)
    assert spec is not None and spec.loader is not None
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    (tmp_path / "engine.yaml").write_text(ENGINE)
    time = np.arange(25_000) / script.RATE_HZ
    theta = 100.0 * np.pi * time + 0.3  # 3000 rpm
    turn = np.mod(theta, 2.0 * np.pi)
    pickup = np.where(turn < 57.0 / 60.0 * 2.0 * np.pi, np.sin(60.0 * theta), -1.0)
    force = np.where(np.mod(theta, 4.0 * np.pi) < np.pi, 1000.0, 0.0)  # the stroke after tooth 0, every second turn
    np.savetxt(tmp_path / "log.txt", np.stack([time, pickup, force / -4674.6 + 0.05], axis=1), fmt="%.7f")
    monkeypatch.setattr(
        "sys.argv", ["engine_log.py", *(str(tmp_path / name) for name in ("log.txt", "engine.yaml", "run"))]
    )
    script.main()
    bag = open_bag(tmp_path / "run")
    edges = (bag.read_events("main_shaft/angle") - 1_000_000_000) * 1e-9
    place = np.mod(100.0 * np.pi * edges + 0.3, 2.0 * np.pi) * 60.0 / (2.0 * np.pi)
    usual = np.abs(place - np.rint(place))[2:-2]  # the low-pass shifts the teeth beside the gap
    assert np.median(usual) < 2e-3 and edges.size == pytest.approx(57 * 12.5, abs=3)
    torques = bag.read_torques()
    at = 100.0 * np.pi * (torques.stamps - 1_000_000_000) * 1e-9 + 0.3
    r, rod = 0.0275, 0.0842
    lever = -r * np.sin(at) - r**2 * np.sin(at) * np.cos(at) / np.sqrt(rod**2 - (r * np.sin(at)) ** 2)
    expected = np.where(np.mod(at, 4.0 * np.pi) < np.pi, 1000.0, 0.0) * lever
    assert np.sqrt(np.mean((torques.torque_Nm - expected) ** 2)) < 0.02 * np.abs(expected).max()
    assert ttc.load_machine(tmp_path / "engine.yaml").sensors.encoder.teeth == 60
