"""Arguments shared by several commands, checked strictly: a mistake gives one line with the valid choices."""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import NoReturn

from textile_twin_core.cli.mistakes import UsageError

MOST_RPM = 1e5
"""Largest plausible speed; a larger one is a mistake in the unit."""


MOST_SAMPLES = 10_000_000
"""Largest number of samples; a dozen outputs of these fit into the memory of a small computer."""


class Parser(argparse.ArgumentParser):
    """ArgumentParser of one command: an example in its help, mistakes as UsageError."""

    def __init__(self, command: str, description: str, example: str) -> None:
        super().__init__(
            prog=f"textile-twin {command}",
            description=description,
            epilog=f"example:\n  {example}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
            allow_abbrev=False,
        )
        self._negative_number_matcher = re.compile(r"-[.]?\d")  # by default argparse reads -1e-3 as an option

    def error(self, message: str) -> NoReturn:
        """Raise UsageError."""
        raise UsageError(f"{message}; see {self.prog} --help")


def add_machine(parser: argparse.ArgumentParser, option: bool, required: bool = True) -> None:
    """Add MACHINE, positional or as --machine, and --set."""
    text = "name of a machine (see textile-twin machines) or path of a machine file (.yaml)"
    if option:
        parser.add_argument("--machine", required=required, help=text)
    else:
        parser.add_argument("machine", metavar="MACHINE", help=text)
    parser.add_argument(
        "--set",
        metavar="NAME=VALUE",
        action="append",
        default=[],
        help="another value for a parameter of a named machine, such as backing_force_N=900; may be repeated",
    )


def add_recording(
    parser: argparse.ArgumentParser, shaft: str | None = None, also: str = "", several: bool = False
) -> None:
    """Add BAG, its topics and, with a default for `shaft`, the estimator of the shaft motion."""
    text = f"a rosbag2 folder, an .mcap or a .db3 file{also}"
    if several:
        parser.add_argument("bags", metavar="BAG", type=Path, nargs="+", help=f"{text}, or a folder of recordings")
    else:
        parser.add_argument("bag", metavar="BAG", type=Path, help=text)
    add_recording_topics(parser)
    if shaft is not None:
        parser.add_argument(
            "--shaft",
            default=shaft,
            choices=["causal", "lag", "smooth"],
            help="estimator of the shaft's motion: causal (no lag), lag (fixed lag), smooth (looks at the whole"
            " recording); default %(default)s",
        )
        parser.add_argument("--shaft-lag", type=positive, metavar="S", help="lag of --shaft lag in seconds")


def add_recording_topics(parser: argparse.ArgumentParser) -> None:
    """Add the topics of a recording, and the treatment of bad samples."""
    parser.add_argument("--angle-topic", default="main_shaft/angle", help="default %(default)s")
    parser.add_argument("--torque-topic", default="balancing_torque/measured", help="default %(default)s")
    parser.add_argument("--joint", default="main_shaft", help="joint of a JointState topic (default %(default)s)")
    parser.add_argument(
        "--skip-bad-samples",
        action="store_true",
        help="leave out angles that are NaN or infinite, or whose stamp jumps ahead, instead of stopping",
    )


def shaft_settings(arguments: argparse.Namespace) -> dict[str, float]:
    """Return the settings of the shaft estimator."""
    if arguments.shaft_lag is None:
        return {}
    if arguments.shaft != "lag":
        raise UsageError(f"--shaft-lag belongs to --shaft lag, not to --shaft {arguments.shaft}")
    return {"shaft_lag_s": arguments.shaft_lag}


def positive(text: str) -> float:
    """Parse a positive finite number."""
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"must be a positive number, not '{text}'")
    return value


def number(text: str) -> float:
    """Parse a finite number."""
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not abs(value) < float("inf"):
        raise argparse.ArgumentTypeError(f"must be a number, not '{text}'")
    return value


def factor(text: str) -> float:
    """Parse a finite number other than zero."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if value == 0.0 or not abs(value) < float("inf"):
        raise argparse.ArgumentTypeError(f"must be a number other than zero, not '{text}'")
    return value


def shaft_speed(text: str) -> float:
    """Parse a plausible shaft speed in rpm."""
    value = number(text)
    if abs(value) > MOST_RPM:
        raise argparse.ArgumentTypeError(f"must be a speed in rpm, at most {MOST_RPM:g}, not '{text}'")
    return value


def count(text: str) -> int:
    """Parse a whole number from 1 on."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"must be a whole number from 1 on, not '{text}'")
    return int(text)


def samples(text: str) -> int:
    """Parse a number of samples that fit into memory."""
    value = count(text)
    if value > MOST_SAMPLES:
        raise argparse.ArgumentTypeError(f"must be at most {MOST_SAMPLES}, not '{text}': memory holds all of them")
    return value


def seed(text: str) -> int:
    """Parse the seed of a search."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"must be a whole number from 0 on, not '{text}'")
    return int(text)
