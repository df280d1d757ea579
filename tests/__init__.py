"""Tests, their references and benchmarks. Linear algebra runs on one thread, as in the command."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy is imported
