"""Progress of long work: shown on a terminal, and nowhere else."""

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
from tests.campaign import more
from textile_twin_core.recordings import BagWriter

CODE = "import sys; from textile_twin_core.cli.main import main; sys.exit(main(sys.argv[1:]))"


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a recording of twelve seconds."""
    return write(tmp_path_factory.mktemp("long") / "bag", 6000)


def write(path: Path, samples: int) -> Path:
    """Write a recording at 500 Hz and one speed, with the position of the needle."""
    stamps = 10**18 + 2_000_000 * np.arange(samples)
    theta = 16.755 * 0.002 * np.arange(stamps.size)
    twin = ttc.compile(ttc.machines.tufting(), ["balancing_torque_Nm", "needle_position_m"])
    found = twin.evaluate(theta, 16.755)
    with BagWriter(path) as out:
        out.write_joint_states("main_shaft/angle", stamps, ["main_shaft"], theta)
        out.write_wrenches("balancing_torque/measured", stamps, found["balancing_torque_Nm"])
        out.write_joint_states("measured/needle_position_m", stamps, ["needle_position_m"], found["needle_position_m"])
    return path


def shown(*arguments: str, answer: str | None = None, codes: tuple[int, ...] = (0,)) -> tuple[str, str]:
    """Return the output of a command and of its terminal; `answer` is typed on that terminal."""
    terminal, theirs = pty.openpty()
    termios.tcsetwinsize(theirs, (24, 80))
    command = [sys.executable, "-c", CODE, *arguments]
    own = subprocess.PIPE if answer is None else theirs
    stdin = subprocess.DEVNULL if answer is None else theirs
    with subprocess.Popen(command, stdin=stdin, stdout=own, stderr=theirs) as running:
        os.close(theirs)
        if answer is not None:
            os.write(terminal, answer.encode())
        said = running.communicate()[0]
    bar = os.read(terminal, 65536).decode()
    os.close(terminal)
    assert running.returncode in codes, bar
    return (said or b"").decode(), bar


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "expected", "least"),
    [
        ("compare --machine tufting", ["predicting", "judging", "comparing"], 70),
        *more(
            ("compare --machine tufting --html {out}.html", ["predicting", "judging", "comparing", "writing"], 100),
            ("compare --machine tufting --quantity needle_position_m", ["comparing"], 0),
            ("calibrate --machine tufting --out {out}.yaml", ["judging", "settling"], 80),
            ("monitor --machine tufting --learn 20", ["watching"], 100),
            ("identify --machine tufting", ["judging", "fitting", "weighing"], 90),
        ),
    ],
)
def test_a_recording_of_seconds_is_shown_stage_by_stage(
    command: str, expected: list[str], least: int, recording: Path, tmp_path: Path
) -> None:
    name, *options = command.format(out=tmp_path / "out").split()
    said, bar = shown(name, str(recording), *options)
    stages = list(dict.fromkeys(re.findall(r"([a-z ]+): +\d+%\|", bar)))
    assert stages == expected
    assert ": :" not in bar
    shares = [int(share) for share in re.findall(r"(\d+)%\|", bar.partition("writing")[0])]
    assert shares == sorted(shares)
    assert int(re.findall(r"(\d+)%\|", bar)[-1]) >= least
    assert "%|" not in said and said


@pytest.mark.campaign
@pytest.mark.slow
def test_monitor_counts_the_samples_of_each_recording(recording: Path, tmp_path: Path) -> None:
    """Monitor recordings of 10 and 32 turns in one process and in two: the bar weights them by length."""
    short = write(tmp_path / "a_short", 2000)
    for workers in ("1", "2"):
        options = ["--machine", "tufting", "--learn", "2", "--workers", workers]
        _, bar = shown("monitor", str(short), str(recording), *options, codes=(0, 3))
        shares = [int(share) for share in re.findall(r"(\d+)%\|", bar)]
        assert shares == sorted(shares) and shares[-1] == 100
        assert {25, 75} & set(shares), shares


@pytest.mark.campaign
@pytest.mark.slow
def test_import_shows_progress_and_asks_beside_its_bar(tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    time = 0.002 * np.arange(200_000)
    table = np.stack([time, 16.755 * time % 6.2831853, np.sin(16.755 * time)], axis=1)
    np.savetxt(log, table, delimiter=",", header="time [s],a,b [Nm]", comments="", fmt="%.9f")
    options = ["--angle", "a", "--torque", "b [Nm]"]
    said, bar = shown("import", str(log), "--out", str(tmp_path / "told"), *options)
    assert list(dict.fromkeys(re.findall(r"([a-z]+): +\d+%\|", bar))) == ["reading", "writing"]
    assert re.findall(r"(\d+)%\|", bar)[-1] == "100"
    assert "%|" not in said and "200000 messages" in said
    _, seen = shown("import", str(log), "--out", str(tmp_path / "asked"), *options[2:], answer="2\n")
    question = seen.index("Which column is the angle?")
    assert seen[:question].endswith("\r"), "the bar is gone before the question"
    assert "200000 messages" in seen


@pytest.mark.slow
def test_nothing_is_shown_elsewhere(recording: Path) -> None:
    command = ["compare", str(recording), "--machine", "tufting", "--quantity", "needle_position_m"]
    done = subprocess.run([sys.executable, "-c", CODE, *command], capture_output=True, text=True, timeout=300)
    assert (done.returncode, done.stderr) == (0, "")
