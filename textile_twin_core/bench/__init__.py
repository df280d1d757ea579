"""Benchmark of speed against error on this computer: our methods, the limit in C, and peers."""

from textile_twin_core.bench.run import run_bench

__all__ = ["run_bench"]
