"""The verdict on a machine whose file declares its elastic shaft."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.generators.elastic_shaft import WideMachine, simulate
from tests.twin.test_elastic_session import declared
from textile_twin_core.cli.main import main
from textile_twin_core.dynamics.loads import Backing
from textile_twin_core.files import save_machine_file
from textile_twin_core.recordings import BagWriter


@pytest.mark.slow
@pytest.mark.campaign
@pytest.mark.parametrize("diameter_m", [0.04, 0.06])
def test_a_force_that_is_wrong_in_the_file_is_found_on_a_shaft_that_twists(diameter_m: float, tmp_path: Path) -> None:
    """4 m of steel of 40 mm, 5000 N m/rad: with a rigid model the torque is wrong by a third of its peak."""
    wide = WideMachine(diameter_m)
    made, machine = simulate(wide, 300.0, 6.0, settle_s=1.0, seed=11), declared(wide, True)
    (backing,) = machine.loads
    assert isinstance(backing, Backing)
    wrong = replace(machine, loads=(replace(backing, force_N=0.9 * wide.backing_force_N),))
    with BagWriter(tmp_path / "bag") as bag:
        bag.write_joint_states(
            "main_shaft/angle", made.stamps_ns, ["main_shaft"], np.mod(made.encoder_rad, 2.0 * np.pi)
        )
        bag.write_wrenches("balancing_torque/measured", made.stamps_ns, made.measured_Nm)
    save_machine_file(wrong, tmp_path / "wide.yaml")
    path, out = "loads.backing.force_N", tmp_path / "found.json"
    words = ["identify", str(tmp_path / "bag"), "--machine", str(tmp_path / "wide.yaml"), "--free", path]
    assert main([*words, "--json", str(out)]) == 0
    found = json.loads(out.read_text())["parameters"][path]
    assert found["value"] == pytest.approx(wide.backing_force_N, abs=2.0 * found["sigma"])
    assert found["sigma"] < 0.02 * wide.backing_force_N
