"""Arguments that several commands share, read strictly: a mistake is one line that names what would be right."""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import NoReturn

from textile_twin_core.cli.mistakes import UsageError

MOST_RPM = 1e5
"""No shaft of a textile machine turns faster; who asks for more has mistaken the unit."""


MOST_SAMPLES = 10_000_000
"""So many samples of a dozen outputs still fit into the memory of a small computer."""


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
        self._negative_number_matcher = re.compile(r"-[.]?\d")  # argparse takes -1e-3 for an option

    def error(self, message: str) -> NoReturn:
        """Raise UsageError."""
        raise UsageError(f"{message}; see {self.prog} --help")


def add_machine(parser: argparse.ArgumentParser, option: bool, required: bool = True) -> None:
    """MACHINE, as an argument of its own or as --machine, and --set."""
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
    """BAG or several, the topics, and with a default for `shaft` how the shaft's motion is estimated."""
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
    """Topics of a recording, and what to do with bad samples."""
    parser.add_argument("--angle-topic", default="main_shaft/angle", help="default %(default)s")
    parser.add_argument("--torque-topic", default="balancing_torque/measured", help="default %(default)s")
    parser.add_argument("--joint", default="main_shaft", help="joint of a JointState topic (default %(default)s)")
    parser.add_argument(
        "--skip-bad-samples",
        action="store_true",
        help="leave out angles that are NaN or infinite, or whose stamp leaps ahead, instead of stopping",
    )


def shaft_settings(arguments: argparse.Namespace) -> dict[str, float]:
    """Settings of the shaft estimator."""
    if arguments.shaft_lag is None:
        return {}
    if arguments.shaft != "lag":
        raise UsageError(f"--shaft-lag belongs to --shaft lag, not to --shaft {arguments.shaft}")
    return {"shaft_lag_s": arguments.shaft_lag}


def positive(text: str) -> float:
    """A positive finite number, as a type of an argument."""
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"must be a positive number, not '{text}'")
    return value


def number(text: str) -> float:
    """A finite number, as a type of an argument."""
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not abs(value) < float("inf"):
        raise argparse.ArgumentTypeError(f"must be a number, not '{text}'")
    return value


def factor(text: str) -> float:
    """A finite number other than zero, as a type of an argument."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if value == 0.0 or not abs(value) < float("inf"):
        raise argparse.ArgumentTypeError(f"must be a number other than zero, not '{text}'")
    return value


def shaft_speed(text: str) -> float:
    """A speed in rpm that a machine's shaft may have, as a type of an argument."""
    value = number(text)
    if abs(value) > MOST_RPM:
        raise argparse.ArgumentTypeError(f"must be a speed in rpm, at most {MOST_RPM:g}, not '{text}'")
    return value


def count(text: str) -> int:
    """A whole number from 1 on, as a type of an argument."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"must be a whole number from 1 on, not '{text}'")
    return int(text)


def samples(text: str) -> int:
    """How many samples to compute at once, as a type of an argument."""
    value = count(text)
    if value > MOST_SAMPLES:
        raise argparse.ArgumentTypeError(f"must be at most {MOST_SAMPLES}, not '{text}': memory holds all of them")
    return value


def seed(text: str) -> int:
    """The seed of a search, as a type of an argument."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"must be a whole number from 0 on, not '{text}'")
    return int(text)
