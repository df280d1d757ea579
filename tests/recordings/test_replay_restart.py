"""A recording whose clock was set back: a replay gives what the live twin gives, sample by sample."""

from __future__ import annotations

import heapq
from pathlib import Path

import numpy as np
import pytest

import textile_twin_core as ttc
from tests.generators.mill_recordings import healthy, record
from textile_twin_core.comparison.residual import ResidualStream, load_steps
from textile_twin_core.recordings import BagWriter, open_bag
from textile_twin_core.recordings.replay import replay_bag

TORQUE = "balancing_torque_Nm"
MACHINE = ttc.machines.tufting()


@pytest.mark.parametrize("by_s", [3, 3600])
def test_a_replay_equals_the_live_twin_where_both_clocks_are_set_back(by_s: int, tmp_path: Path) -> None:
    made = record(healthy("tufting", 931, duration_s=8.0))

    def set_back(stamps: np.ndarray) -> np.ndarray:
        late = (stamps - made.angle_stamps_ns[0]) * 1e-9 > 4.0
        return stamps - late * by_s * 1_000_000_000

    angle_ns, torque_ns = set_back(made.angle_stamps_ns), set_back(made.torque_stamps_ns)
    twin = ttc.compile(MACHINE, [TORQUE])
    session, stream = twin.session(), ResidualStream(MACHINE.sensors.torque, load_steps(twin))
    predicted: list[tuple[int, float]] = []
    residuals: list[tuple[int, float]] = []
    angles = ((true, 0, k) for k, true in enumerate(made.angle_stamps_ns))
    torques = ((true, 1, k) for k, true in enumerate(made.torque_stamps_ns))
    for _, kind, k in heapq.merge(angles, torques):  # as they arrive
        if kind:
            found = stream.measured(int(torque_ns[k]), float(made.torque[k]))
        else:
            samples = session.step_one(int(angle_ns[k]), float(made.angle[k]))
            predicted += [(sample.stamp, sample.outputs[TORQUE]) for sample in samples]
            found = [
                each
                for sample in samples
                for each in stream.predicted((sample.stamp,), (sample.outputs[TORQUE],), (sample.theta_rad,))
            ]
        residuals += [(each.stamp_ns, each.residual_Nm) for each in found]
    with BagWriter(tmp_path / "bag") as out:
        out.write_joint_states("main_shaft/angle", angle_ns, ["main_shaft"], made.angle)
        out.write_wrenches("balancing_torque/measured", torque_ns, made.torque)
    with BagWriter(tmp_path / "replayed") as out:
        done = replay_bag(open_bag(tmp_path / "bag"), out, MACHINE)
    assert len(predicted) == len(angle_ns) - 2 - 9 - 2 and len(residuals) > 0.95 * len(torque_ns)
    assert any("the prediction restarts there" in note for note in done.notes)
    bag = open_bag(tmp_path / "replayed")
    for name, live in (("predicted", predicted), ("residual", residuals)):
        offline = bag.read_torques(f"balancing_torque/{name}")
        assert sorted(offline.stamps.tolist()) == sorted(stamp for stamp, _ in live), name
        order = np.argsort(offline.stamps, kind="stable")
        expected = [value for _, value in sorted(live, key=lambda pair: pair[0])]
        np.testing.assert_allclose(offline.torque_Nm[order], expected, rtol=0.0, atol=1e-9, err_msg=name)
    # All but those of the first tenths of a second of each record.
    sizes = np.abs([value for _, value in residuals])
    assert np.quantile(sizes, 0.97) < 0.05 * np.max(np.abs(made.torque))
