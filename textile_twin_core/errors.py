"""Errors that a user can correct; each message is one line that says what is wrong, where, and what to do.

Examples:
    >>> import textile_twin_core as ttc
    >>> try:
    ...     ttc.compile(ttc.machines.tufting(), outputs=["torque"])
    ... except ttc.TwinError as error:
    ...     print(type(error).__name__)
    SceneError
"""

from __future__ import annotations


class TwinError(Exception):
    """Base class of the errors that a user can correct; the command line prints them and exits with code 2.

    Examples:
        >>> import textile_twin_core as ttc
        >>> try:
        ...     ttc.load_machine("no_such_file.yaml")
        ... except ttc.TwinError as error:
        ...     print(type(error).__name__)
        MachineError
    """


class MachineError(TwinError):
    """Wrong declaration of a machine: geometry that cannot close, a negative mass, an unknown name."""


class SceneError(TwinError):
    """Request that the machine or method cannot serve: an unknown output, method or parameter."""


class MotionError(TwinError):
    """Unusable shaft motion: wrong shape, NaN or infinite values, a missing column."""


class RecordingError(TwinError):
    """Recording that cannot be read or written: no bag or topic, empty, truncated, no space, no permission."""


class OutputError(TwinError):
    """Output that cannot be written to the requested place."""


class AlignmentError(TwinError):
    """Measured and predicted torque without a common time axis."""


class ContactError(TwinError):
    """Impossible contact model or motion: a bad parameter, a start inside a stop, a body jammed between stops."""


_EXTRAS = {
    "files": ("lz4", "mcap", "pyarrow", "rosbags", "zstandard"),
    "view": ("matplotlib", "rerun"),
    "design": ("aiohttp", "ezdxf"),
    "plc": ("asyncua", "cryptography", "pymodbus"),
    "logs": ("asammdf", "h5py", "nptdms"),
    "cluster": ("dask", "distributed"),
}
"""Modules by the extra of pyproject.toml that installs them."""
_PACKAGES = {"rerun": "rerun-sdk", "nptdms": "npTDMS", "dask": "distributed"}
"""Package names that differ from the module's name."""


def how_to_install(module: str, *more: str) -> str:
    """Word the installation hint for a missing module: its package, and the extra in a checkout with `more` extras.

    Examples:
        >>> how_to_install("pyarrow.csv")
        "pip install pyarrow, or in a checkout pip install '.[files]'"
    """
    module = module.partition(".")[0]
    package = f"pip install {_PACKAGES.get(module, module)}"
    extra = next((extra for extra, modules in _EXTRAS.items() if module in modules), "")
    extras = ",".join(dict.fromkeys([*filter(None, [extra]), *more]))
    return f"{package}, or in a checkout pip install '.[{extras}]'" if extras else package
