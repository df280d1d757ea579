"""Programs brought up together: they end together, for any order and reason."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

BRING_UP = Path(__file__).parents[2] / "launch_scripts" / "bring_up.py"


def sleeper(folder: Path, name: str) -> list[str]:
    """Return a command that writes its process id to a file and then idles."""
    return ["sh", "-c", f"echo $$ > {folder}/{name}.part; mv {folder}/{name}.part {folder}/{name}; exec sleep 600"]


def bring_up(folder: Path, *words: str) -> subprocess.Popen[str]:
    command = [sys.executable, str(BRING_UP), "--logs", str(folder / "logs"), *words]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def wait_until(condition: Callable[[], bool]) -> None:
    while not condition():
        time.sleep(0.01)


def is_running(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"


def pid_in(path: Path) -> int:
    wait_until(path.exists)
    return int(path.read_text())


def test_all_end_with_the_awaited_program(tmp_path: Path) -> None:
    waiter = ["bash", "-c", f"until [ -e {tmp_path}/a ]; do read -t 0.01 <> <(:); done; true"]
    running = bring_up(tmp_path, "--until", "bash", "--", *sleeper(tmp_path, "a"), "---", *waiter)
    _, complaints = running.communicate()
    assert (running.returncode, complaints) == (0, "")
    assert not is_running(pid_in(tmp_path / "a"))


def test_a_program_may_end_well_before_the_awaited_one(tmp_path: Path) -> None:
    running = bring_up(tmp_path, "--until", "sleep", "--", "true", "---", "sleep", "0.3")
    assert running.wait() == 0


def test_failure_of_one_ends_all_and_is_reported_with_its_last_lines(tmp_path: Path) -> None:
    failing = ["bash", "-c", f"until [ -e {tmp_path}/a ]; do read -t 0.01 <> <(:); done; echo no bag; exit 2"]
    running = bring_up(tmp_path, "--until", "sh", "--", *sleeper(tmp_path, "a"), "---", *failing)
    _, complaints = running.communicate()
    assert running.returncode == 2
    assert "bash ended with exit code 2" in complaints
    assert "no bag" in complaints
    assert not is_running(pid_in(tmp_path / "a"))


def test_only_the_essential_one_takes_the_others_with_it(tmp_path: Path) -> None:
    failing = ["bash", "-c", f"echo 'view: no port'  >&2; touch {tmp_path}/told; exit 2"]
    essential = ["sh", "-c", f"until [ -e {tmp_path}/told ]; do sleep 0.01; done; sleep 0.5; exit 3"]
    command = [sys.executable, str(BRING_UP), "--essential", "sh", "--", *essential, "---", *failing]
    started = time.monotonic()
    done = subprocess.run(command, capture_output=True, text=True)
    assert time.monotonic() - started > 0.5
    assert done.returncode == 3
    # A program that has reported its mistake in a line is not reported again.
    assert done.stderr.splitlines() == ["view: no port", "sh ended with exit code 3"]


@pytest.mark.parametrize(("short_life_s", "lives"), [(0.0, 2), (1e9, 1)])
def test_a_program_killed_by_a_signal_restarts_after_a_pause(tmp_path: Path, short_life_s: float, lives: int) -> None:
    settings = f"bring_up.REVIVAL_S, bring_up.SHORT_LIFE_S = 0.0, {short_life_s}"
    words = ["--essential", "cat", "--", "cat", f"{tmp_path}/end", "---", *sleeper(tmp_path, "a")]
    command = [sys.executable, "-c", f"import bring_up; {settings}; bring_up.sys.exit(bring_up.main({words}))"]
    os.mkfifo(tmp_path / "end")
    running = subprocess.Popen(command, cwd=BRING_UP.parent, stderr=subprocess.PIPE, text=True)
    first = pid_in(tmp_path / "a")
    (tmp_path / "a").unlink()
    os.kill(first, signal.SIGKILL)
    assert running.stderr is not None
    told = [running.stderr.readline().strip() for _ in range(lives)]
    assert told == ["sh ended on signal SIGKILL", "sh is started again"][:lives]
    if lives > 1:
        assert pid_in(tmp_path / "a") != first
    (tmp_path / "end").write_bytes(b"")  # the essential program has read everything, and ends
    assert running.communicate()[1].strip() == "cat ended with exit code 0"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_all(tmp_path: Path, number: signal.Signals) -> None:
    running = bring_up(tmp_path, "--", *sleeper(tmp_path, "a"), "---", *sleeper(tmp_path, "b"))
    pids = [pid_in(tmp_path / name) for name in "ab"]
    running.send_signal(number)
    assert running.wait() == 128 + number
    assert not any(map(is_running, pids))


def test_a_signal_asks_the_program_that_is_just_being_started_to_end_too(tmp_path: Path) -> None:
    asked = [
        "bash",
        "-c",
        f"trap 'touch {tmp_path}/asked; exit' INT; echo $$ > {tmp_path}/a; while :; do sleep 0.01; done",
    ]
    slowly = (
        "start = bring_up.Program.start; bring_up.Program.start = lambda program: start(program) or time.sleep(1.0)"
    )
    command = [
        sys.executable,
        "-c",
        f"import bring_up, time; {slowly}; bring_up.sys.exit(bring_up.main({['--', *asked]}))",
    ]
    running = subprocess.Popen(command, cwd=BRING_UP.parent)
    wait_until((tmp_path / "a").exists)
    running.send_signal(signal.SIGTERM)
    assert running.wait() == 128 + signal.SIGTERM
    assert (tmp_path / "asked").exists()


def test_nothing_is_left_when_the_supervisor_is_killed(tmp_path: Path) -> None:
    running = bring_up(tmp_path, "--", *sleeper(tmp_path, "a"))
    pid = pid_in(tmp_path / "a")
    os.kill(running.pid, signal.SIGKILL)
    running.wait()
    wait_until(lambda: not is_running(pid))


def test_a_program_that_is_not_there(tmp_path: Path) -> None:
    running = bring_up(tmp_path, "--", "no_such_node")
    _, complaints = running.communicate()
    assert running.returncode == 2
    assert complaints == "no_such_node: cannot be started: No such file or directory\n"
