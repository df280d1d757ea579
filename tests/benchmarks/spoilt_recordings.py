"""Ten thousand spoilt recordings and a recording cut at every record and a thousand other places: result of each.

Run from the root of the repository: python -m tests.benchmarks.spoilt_recordings [COUNT]
Ends with an error at the first that gives data never recorded, an error that is not one line, or takes ten seconds.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from tests.recordings.mutations import cut_everywhere, run


def main() -> None:
    """Print the counts."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000
    with tempfile.TemporaryDirectory() as folder:
        for name, judge in run(Path(folder), count, seed=1).items():
            words = ", ".join(f"{number} {outcome}" for outcome, number in judge.outcomes.most_common())
            print(f"{name:18} {words}; the slowest {judge.slowest_s:.2f} s")
        places = cut_everywhere(Path(folder), 1000, seed=1)
        print(f"cut at {places} places: all that stood before came back")


if __name__ == "__main__":
    main()
