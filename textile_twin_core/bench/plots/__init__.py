"""Pictures of the benchmark, one for each table."""

from textile_twin_core.bench.plots.impacts import plot_impacts
from textile_twin_core.bench.plots.shaft import plot_shaft
from textile_twin_core.bench.plots.speed import plot_work_precision

__all__ = ["plot_impacts", "plot_shaft", "plot_work_precision"]
