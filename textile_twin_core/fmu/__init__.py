"""Functional mock-up units: a machine as C sources and a shared library behind FMI 2.0 or 3.0."""

from textile_twin_core.fmu.archive import FmuReport, write_fmu

__all__ = ["FmuReport", "write_fmu"]
