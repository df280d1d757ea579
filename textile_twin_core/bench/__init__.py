"""Speed against error, on the computer at hand: our methods, the limit in C, and peers."""

from textile_twin_core.bench.run import run_bench

__all__ = ["run_bench"]
