"""Command textile-twin: runs a sub-command, and turns errors into one line and an exit code."""

from __future__ import annotations

import os
import re
import signal
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from importlib.metadata import version
from typing import TextIO

from textile_twin_core.cli.mistakes import BeyondLimitError, nearest, tell
from textile_twin_core.errors import TwinError, how_to_install

# Matrices of some sixty rows gain nothing from threads, which wait for each other on a busy computer.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

COMMANDS = {
    "machines": "the machines, their outputs and parameters",
    "published": "the papers' numbers beside ours, and their figures redrawn",
    "simulate": "outputs of a machine over a shaft motion, as a table or a recording",
    "replay": "a recording in, the same recording with the twin's predictions out",
    "compare": "measured against predicted torque: table, report, recording, plot",
    "calibrate": "encoder and torque sensor calibrated from a recording, as a machine file",
    "identify": "forces, friction, event angles and inertia from a recording, with intervals",
    "drive": "the motion of a machine under a drive torque: run-up, coast-down, speed ripple",
    "orders": "order spectrum and order-speed map of a recording's signals",
    "resonances": "natural frequencies and critical speeds of an elastic main shaft, Campbell diagram",
    "fmu": "a machine as an FMU in C, for other simulation programs",
    "import": "a recording from any logger's table: CSV, Parquet, MATLAB, HDF5, TDMS, MDF4",
    "monitor": "recordings watched for faults, turn by turn: needle side, drive side, sensors",
    "recover": "a complete recording from one that was cut off or is damaged",
    "faults": "the fault book of a suite: list, acknowledge, open in the viewer",
    "opcua": "certificates and users that secure OPC UA connections",
    "status": "a running suite in the terminal: rates, estimator, residual, alarms",
    "view": "show a recording in the viewer",
    "bench": "speed against error on this computer",
    "synthesize": "linkages from what they must do, and machines balanced",
    "explore": "the design page in the browser: parameters in, moving machine and curves out",
}
"""Sub-commands and their descriptions; each is a module of this package, imported on use."""

_MODULES = {"import": "import_log"}
"""Modules of commands whose names are keywords of Python."""

_ALSO = {"explore": ("files", "design")}
"""Further extras that a command needs beside that of the first missing package."""
_GLYPH = re.compile(r"Glyph (\d+) .*missing from")
_TRACE = "TEXTILE_TWIN_TRACEBACK"


def module_of(command: str) -> str:
    """Name of the module that holds a command's `parser` and `run`."""
    return f"textile_twin_core.cli.{_MODULES.get(command, command)}"


def _help() -> str:
    width = max(map(len, COMMANDS))
    lines = [f"  {name:{width}}  {text}" for name, text in COMMANDS.items()]
    return "\n".join(
        [
            "usage: textile-twin COMMAND ...",
            "",
            "Digital twins of textile machines: from the angle of the main shaft to torque, needle and reactions.",
            "",
            *lines,
            "",
            "textile-twin COMMAND --help explains a command. For example:",
            "  textile-twin simulate tufting --rpm 160 --samples 360 --out turn.csv",
            "Exit code: 0 done, 2 a mistake in what was asked or given, 3 beyond a limit that was given,",
            "1 a fault of textile-twin itself.",
        ]
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command with its arguments.

    Returns:
        Exit code: 0, 2 for a mistake of the user, 3 beyond a limit, 1 for an internal error.
    """
    given = list(sys.argv[1:] if argv is None else argv)
    if argv is None:
        # Partial files are then removed when the process is terminated.
        signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    try:
        return _run(given)
    except BeyondLimitError as error:
        return _say(str(error), 3)
    except TwinError as error:
        return _say(str(error), 2)
    except ModuleNotFoundError as error:
        if error.name is None or error.name.startswith("textile_twin_core"):
            raise
        more = _ALSO.get(given[0], ())
        return _say(f"this needs the package {error.name.partition('.')[0]}; {how_to_install(error.name, *more)}", 2)
    except KeyboardInterrupt:
        return _say("interrupted", 130)
    except BrokenPipeError:
        # The reader has closed the pipe, as `head` does; Python would report this again when closing stdout.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except MemoryError:
        return _say("this does not fit into memory; ask for fewer samples, or for a part of the recording", 2)
    except OSError as error:
        # Missing permission, a full or a removed disk are for the user to fix.
        where = f"{error.filename}: " if error.filename else ""
        return _say(f"{where}{(error.strerror or str(error)).lower()}", 2)
    except Exception as error:
        if os.environ.get(_TRACE):
            raise
        return _say(
            f"a fault of textile-twin, please report it ({type(error).__name__}: {error}); {_TRACE}=1 shows where", 1
        )


def _run(given: list[str]) -> int:
    if not given or given[0] in ("-h", "--help"):
        print(_help())
        return 0 if given else 2
    if given[0] == "--version":
        print(version("textile-twin-core"))
        return 0
    name = given[0]
    if name not in COMMANDS:
        raise TwinError(f"no command '{name}'; {nearest(name, COMMANDS)}")
    command = import_module(module_of(name))
    with _missing_glyphs_reported():
        command.run(command.parser().parse_args(given[1:]))
    return 0


@contextmanager
def _missing_glyphs_reported() -> Iterator[None]:
    """Report the characters that the font of a picture lacks in one line, instead of matplotlib's warnings."""
    missing: dict[str, None] = {}
    with warnings.catch_warnings():
        show = warnings.showwarning

        def collect(
            message: Warning | str,
            category: type[Warning],
            filename: str,
            lineno: int,
            file: TextIO | None = None,
            line: str | None = None,
        ) -> None:
            found = _GLYPH.match(str(message))
            if found is None:
                show(message, category, filename, lineno, file, line)
            else:
                missing[chr(int(found[1]))] = None

        warnings.filterwarnings("always", _GLYPH.pattern)
        warnings.showwarning = collect
        yield
    if missing:
        tell(f"the font of pictures has no {' '.join(missing)}: drawn as boxes")


def _say(text: str, code: int) -> int:
    tell(text)
    return code


if __name__ == "__main__":
    sys.exit(main())
