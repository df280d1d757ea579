"""Packages that only some work needs: what to install, in words."""

from __future__ import annotations


def needs(what: str, package: str, extra: str) -> str:
    """A line that says which package is missing and how to install it, from a checkout or without.

    Example:
        >>> needs("log.h5: an HDF5 file", "h5py", "logs")
        "log.h5: an HDF5 file needs the package h5py; pip install h5py, or pip install '.[logs]' in a checkout"
    """
    return f"{what} needs the package {package}; pip install {package}, or pip install '.[{extra}]' in a checkout"
