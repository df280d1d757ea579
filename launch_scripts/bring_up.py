"""Bring-up without a ROS installation: starts programs side by side, watches them, and ends them together."""

from __future__ import annotations

import argparse
import ctypes
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import FrameType

from this_computer import this_computer_alone

PATIENCE_S = 10.0
"""Time for a program to end before it is killed [s]."""
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that end all programs."""
REVIVAL_S, SHORT_LIFE_S = 1.0, 10.0
"""Pause before a restart, and least lifetime for one, since a program that dies at once would do so again [s]."""


class Program:
    """Running program: its name, its process, and the file for its output, if any.

    It runs in a session of its own, so that Ctrl-C reaches it only through this supervisor.
    """

    def __init__(self, command: Sequence[str], log_folder: Path | None, taken: set[str]) -> None:
        name = Path(command[0]).name
        self.name = next(n for n in (name, *(f"{name}_{i}" for i in range(2, 100))) if n not in taken)
        self.log = None if log_folder is None else log_folder / f"{self.name}.log"
        if self.log is not None:
            self.log.unlink(missing_ok=True)
        self._command = command
        self.start()

    def start(self) -> None:
        """Start or restart the program."""
        self._started_s = time.monotonic()
        with ExitStack() as opened:
            self.process = subprocess.Popen(
                self._command,
                stdin=subprocess.DEVNULL,
                stdout=None if self.log is None else opened.enter_context(self.log.open("ab")),
                stderr=None if self.log is None else subprocess.STDOUT,
                start_new_session=True,
                preexec_fn=follow_parent_to_the_end,
            )

    def was_killed(self) -> bool:
        """Return true if a signal killed it, other than at its start; our nodes handle the usual signals themselves."""
        return self.process.returncode < 0 and time.monotonic() - self._started_s > SHORT_LIFE_S

    def obituary(self, lines: int = 15) -> str:
        """Describe how the program ended, with the last lines of its output."""
        code = self.process.returncode
        how = f"on signal {signal.Signals(-code).name}" if code < 0 else f"with exit code {code}"
        if self.log is None:
            return f"{self.name} ended {how}"
        last_words = self.log.read_text(errors="replace").splitlines()[-lines:]
        return "\n".join([f"{self.name} ended {how}; its last words ({self.log}):", *last_words])


def follow_parent_to_the_end() -> None:
    """Ask Linux to end this process when its parent dies, even when the parent is killed."""
    signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING)
    pr_set_pdeathsig = 1
    ctypes.CDLL(None).prctl(pr_set_pdeathsig, signal.SIGTERM)


@contextmanager
def deferred_signals() -> Iterator[None]:
    """Defer the signals that end all, so that a program that is just starting is known and ended, too."""
    signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING)


def stop(programs: Sequence[Program]) -> None:
    """End the programs in the given order: ask first, kill after `PATIENCE_S`."""
    for program in programs:
        for signal_number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
            if program.process.poll() is not None:
                break
            program.process.send_signal(signal_number)
            try:
                program.process.wait(PATIENCE_S)
            except subprocess.TimeoutExpired:
                print(f"{program.name} did not end on {signal_number.name}", file=sys.stderr)


def split_commands(words: Sequence[str]) -> list[list[str]]:
    """Split `a -x --- b -y` into the commands `a -x` and `b -y`."""
    commands: list[list[str]] = [[]]
    for word in words:
        if word == "---":
            commands.append([])
        else:
            commands[-1].append(word)
    return [command for command in commands if command]


def watch(programs: Sequence[Program], until: str | None, essential: str | None) -> int:
    """Wait until the program `until` or `essential` ends; without either, until any ends. Return the exit code.

    Beside an essential program, others that are killed by a signal (out of memory, a crash of a library) restart.
    """
    running = list(programs)
    while running:
        os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOWAIT)
        for program in [program for program in running if program.process.poll() is not None]:
            running.remove(program)
            code = program.process.returncode
            if code == 0 and program.name == until:
                return 0
            if code == 0 and (until is not None or essential not in (None, program.name)):
                continue
            # A program that ends with exit code 2 has reported the mistake itself, in one line.
            if code != 2 or program.log is not None:
                print(program.obituary(), file=sys.stderr)
            if essential not in (None, program.name) and program.was_killed():
                print(f"{program.name} is started again", file=sys.stderr)
                time.sleep(REVIVAL_S)
                with deferred_signals():
                    program.start()
                running.append(program)
            if essential in (None, program.name):
                return code if code > 0 else 1
    return 0


def bring_up(
    commands: Sequence[Sequence[str]],
    *,
    logs: Path | None = None,
    until: str | None = None,
    essential: str | None = None,
) -> int:
    """Start commands side by side and end them together; return the exit code.

    Args:
        commands: Programs with their arguments.
        logs: Folder for their output; shown on the terminal by default.
        until: Program whose end ends all.
        essential: Only program whose end ends all; without it, any failure does.
    """

    def interrupt(signal_number: int, _frame: FrameType | None) -> None:
        sys.exit(128 + signal_number)

    for signal_number in ENDING:
        signal.signal(signal_number, interrupt)
    programs: list[Program] = []
    try:
        if logs is not None:
            logs.mkdir(parents=True, exist_ok=True)
        for command in commands:
            with deferred_signals():
                programs.append(Program(command, logs, {program.name for program in programs}))
        return watch(programs, until, essential)
    except OSError as error:
        print(f"{error.filename}: cannot be started: {error.strerror}", file=sys.stderr)
        return 2
    finally:
        for signal_number in ENDING:
            signal.signal(signal_number, signal.SIG_IGN)
        stop(programs[::-1])


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the programs named on the command line; see `--help`."""
    parser = argparse.ArgumentParser(
        description=__doc__,
        usage="bring_up.py [--alone] [--logs DIR] [--until NAME] [--essential NAME] -- COMMAND ARGS ... --- ...",
    )
    parser.add_argument("--alone", action="store_true", help="nodes hear those on this computer, and no others")
    parser.add_argument("--logs", type=Path, help="folder for what the programs print; otherwise it is shown")
    parser.add_argument("--until", help="end all when this program has ended; without it, run until Ctrl-C")
    parser.add_argument("--essential", help="only the end of this program is the end of all")
    parser.add_argument("words", nargs=argparse.REMAINDER, help="commands, separated by ---")
    options = parser.parse_args(arguments)
    commands = split_commands(options.words[1:] if options.words[:1] == ["--"] else options.words)
    if not commands:
        parser.error("name at least one command after --")
    if options.alone:
        os.environ.update(this_computer_alone())
    return bring_up(commands, logs=options.logs, until=options.until, essential=options.essential)


if __name__ == "__main__":
    sys.exit(main())
