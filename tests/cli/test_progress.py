"""Long work shows on a terminal how far it is, and nowhere else."""

from __future__ import annotations

import os
import pty
import re
import subprocess
import sys
import termios
from pathlib import Path

import numpy as np
import pytest

import textile_twin_core as ttc
from textile_twin_core.recordings import BagWriter

CODE = "import sys; from textile_twin_core.cli.main import main; sys.exit(main(sys.argv[1:]))"


@pytest.fixture(scope="module")
def long_recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Just long enough for a bar, at one speed."""
    stamps = 10**18 + 2_000_000 * np.arange(52_000)
    theta = 16.755 * 0.002 * np.arange(stamps.size)
    torque = ttc.compile(ttc.machines.tufting(), ["balancing_torque_Nm"]).evaluate(theta, 16.755)["balancing_torque_Nm"]
    path = tmp_path_factory.mktemp("long") / "bag"
    with BagWriter(path) as out:
        out.write_joint_states("main_shaft/angle", stamps, ["main_shaft"], theta)
        out.write_wrenches("balancing_torque/measured", stamps, torque)
    return path


@pytest.mark.slow
def test_compare_tells_each_stage_on_a_terminal(long_recording: Path) -> None:
    terminal, theirs = pty.openpty()
    termios.tcsetwinsize(theirs, (24, 80))
    command = [sys.executable, "-c", CODE, "compare", str(long_recording), "--machine", "tufting"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=theirs) as running:
        os.close(theirs)
        said = running.communicate()[0].decode()
    bar = os.read(terminal, 65536).decode()
    os.close(terminal)
    assert running.returncode == 0, bar
    stages = list(dict.fromkeys(re.findall("predicting|judging|comparing", bar)))
    assert stages == ["predicting", "judging", "comparing"]
    shares = [int(share) for share in re.findall(r"(\d+)%\|", bar)]
    assert shares == sorted(shares) and shares[-1] >= 70
    assert "%|" not in said and "verdict" in said


@pytest.mark.slow
def test_nothing_is_shown_elsewhere(long_recording: Path) -> None:
    command = [sys.executable, "-c", CODE, "compare", str(long_recording), "--machine", "tufting"]
    done = subprocess.run(command, capture_output=True, check=False, text=True, timeout=300)
    assert (done.returncode, done.stderr) == (0, "")
