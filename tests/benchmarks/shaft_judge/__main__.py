"""Prints the judge's tables.

Run from the root of the repository:
python -m tests.benchmarks.shaft_judge [--engine PATH] [--kinds SEEDS] [--many SEEDS] [--only KIND ..] [--view VIEW ..]
"""

from __future__ import annotations

import argparse
from pathlib import Path

from tests.benchmarks.shaft_judge.tables import engine_tables, kinds_table, trouble_table
from tests.benchmarks.shaft_judge.views import VIEWS, package
from tests.shaft.kinds import KINDS


def main() -> None:
    """Parse the arguments and print."""
    parser = argparse.ArgumentParser(prog="shaft_judge", description=__doc__)
    parser.add_argument("--engine", type=Path, help="git directory of the fetched recordings, or a folder of caches")
    parser.add_argument("--kinds", type=int, default=10, help="seeds of each kind")
    parser.add_argument("--many", type=int, default=0, help="seeds of each kind for divergence alone")
    parser.add_argument("--only", nargs="*", default=list(KINDS), help="kinds, without their shares of outliers")
    parser.add_argument("--view", nargs="*", default=list(VIEWS))
    arguments = parser.parse_args()
    if arguments.kinds:
        kinds_table(package, arguments.only, range(arguments.kinds), arguments.view)
    if arguments.many:
        trouble_table(package, arguments.only, range(arguments.many), arguments.view)
    if arguments.engine:
        engine_tables(package, arguments.engine, arguments.view)


if __name__ == "__main__":
    main()
