"""What goes wrong by the user's hand: every such error is one line that says what, where and what to do."""

from __future__ import annotations


class TwinError(Exception):
    """Base of all errors that a user can mend; the command line prints it as one line and exits with code 2."""


class MachineError(TwinError):
    """A machine's declaration is wrong: geometry that cannot close, a negative mass, an unknown name."""


class SceneError(TwinError):
    """A scene asks for what the machine or the method cannot give: an unknown output, method or parameter."""


class MotionError(TwinError):
    """Shaft motion that cannot be used: wrong shape, NaN or infinite values, a missing column."""


class RecordingError(TwinError):
    """A recording cannot be read or written: no bag, no such topic, empty, truncated, no room, no permission."""


class OutputError(TwinError):
    """An output cannot be written where the user wants it."""


class AlignmentError(TwinError):
    """Measured and predicted torque cannot be brought onto one time axis."""


class ContactError(TwinError):
    """A contact model or its motion cannot be: a bad parameter, a start inside a stop, a body jammed between stops."""


_EXTRAS = {
    "files": ("lz4", "mcap", "pyarrow", "rosbags", "zstandard"),
    "view": ("matplotlib", "rerun"),
    "design": ("aiohttp", "ezdxf"),
    "plc": ("asyncua", "pymodbus"),
    "logs": ("asammdf", "h5py", "nptdms"),
    "cluster": ("dask", "distributed"),
}
"""Modules by the extra of pyproject.toml that brings them."""
_PACKAGES = {"rerun": "rerun-sdk", "nptdms": "npTDMS", "dask": "distributed"}
"""Packages that are not called as their module."""


def how_to_install(module: str, *more: str) -> str:
    """The words for a user who lacks a module: the package's own name, and the extra in a checkout with `more` of them.

    Example:
        >>> how_to_install("pyarrow.csv")
        "pip install pyarrow, or in a checkout pip install '.[files]'"
    """
    module = module.partition(".")[0]
    package = f"pip install {_PACKAGES.get(module, module)}"
    extra = next((extra for extra, modules in _EXTRAS.items() if module in modules), "")
    extras = ",".join(dict.fromkeys([*filter(None, [extra]), *more]))
    return f"{package}, or in a checkout pip install '.[{extras}]'" if extras else package
