"""Pictures of the benchmark, one for each table."""

from tests.benchmarks.plots.impacts import plot_impacts
from tests.benchmarks.plots.shaft import plot_shaft
from tests.benchmarks.plots.speed import plot_work_precision

__all__ = ["plot_impacts", "plot_shaft", "plot_work_precision"]
