"""A log in rounded degrees says at import how many counts a turn its encoder has."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from textile_twin_core.cli.main import main


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
