"""A log in rounded degrees: import names the counts a turn of its encoder, and restores the encoder's readings."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from textile_twin_core.cli.main import main
from textile_twin_core.recordings import open_bag


@pytest.mark.parametrize(("counts", "said"), [(8192, "an encoder of 8192 counts a turn"), (0, "")])
def test_import_names_the_counts(counts: int, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    time = np.arange(3000) / 500.0
    turns = 1.343 * time + 0.003 * np.sin(8.44 * time)
    if counts:
        turns = np.rint(turns * counts) / counts
    rows = [
        f"{t:.4f};{360.0 * (a % 1.0):.3f};{np.sin(t):.3f}".replace(".", ",") for t, a in zip(time, turns, strict=True)
    ]
    log = tmp_path / "log.csv"
    log.write_text("\n".join(["Zeit [s];Winkel [deg];Drehmoment [Nm]", *rows]) + "\n")
    assert main(["import", str(log), "--out", str(tmp_path / "bag")]) == 0
    told = capsys.readouterr().out
    assert (said in told) if said else ("an encoder of" not in told)
    angle = open_bag(tmp_path / "bag").read_angles().angles_rad
    logged = np.deg2rad(np.round(360.0 * (turns % 1.0), 3))
    assert np.abs(angle - logged).max() <= np.deg2rad(0.53e-3)
    if counts:
        steps = np.diff(np.unwrap(angle)) * counts / (2.0 * np.pi)
        assert np.abs(steps - np.rint(steps)).max() < 1e-6
