"""The bench as pictures, one for each table."""

from textile_twin_core.bench.plots.speed import plot_work_precision

__all__ = ["plot_work_precision"]
