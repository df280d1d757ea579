"""Compile plain loops: `compiled` is numba's njit with this project's options and a cache on disk by content.

A loop that was compiled once starts at once in the next process. The cache is $TEXTILE_TWIN_CACHE_DIR, or textile-twin
in $XDG_CACHE_HOME or ~/.cache. The name of an entry is a hash of the code, its constants, the compiled functions it
calls, the signature, the processor and the versions of Python and numba: entries never go stale, and processes that
write the same entry write the same bytes. Without a usable cache each process compiles its loops; without numba they
run as plain Python, slowly. Both are reported once.

Loops compile by numba's public interface, too. With the releases that `numba_internals` knows, compiling takes about
a third of the time; TEXTILE_TWIN_PLAIN_NUMBA=1 leaves it out.
"""

from __future__ import annotations

import logging
import os
import pickle
import sys
import time
import types
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import cache, partial
from hashlib import sha256
from pathlib import Path
from typing import Any, Final, TypeVar, cast
from uuid import uuid4

import numpy as np
import numpy.typing as npt

try:
    import numba
    from numba.extending import intrinsic
except ImportError as error:
    numba, _LACKING = None, str(error)

internals: Any = None
if numba is not None and not os.environ.get("TEXTILE_TWIN_PLAIN_NUMBA"):
    with suppress(ImportError):
        from textile_twin_core import numba_internals as internals
with suppress(ImportError):  # of numba's own cache; where they are missing, nothing is cached
    from numba.core.compiler import CompileResult
    from numba.core.runtime import rtsys
    from numba.core.serialize import dumps

_Function = TypeVar("_Function", bound=Callable[..., Any])
_Tuple = TypeVar("_Tuple", bound=type[tuple[Any, ...]])

_OPTIONS: Final[dict[str, Any]] = {"error_model": "numpy", "fastmath": {"contract"}, "nogil": True}
"""Divisions by zero as in IEEE 754; a product and a sum may become one operation; threads may run beside the loop."""
CACHE_LINE: Final = 64  # bytes


def compiled(
    function: _Function,
    *,
    inlined: bool = False,
    noalias: bool = False,
    interleave: int = 0,
    width: int = 0,
    counted: bool = True,
) -> _Function:
    """Compile a function when it is first called, for the types of its arguments.

    Module-level names are read once. Functions given as arguments prevent caching.

    Args:
        function: A loop over numbers and arrays; it may call other compiled functions.
        inlined: Put the function into its callers: for small functions, and for large ones with few callers. Numba's
            public interface compiles a large function again for each compiled function above it, unless it is inlined.
        noalias: Promise that no two of its arrays share memory, so that loops over several arrays can be vectorised.
        interleave: Vectors side by side in a loop, a power of two; 0 leaves it to LLVM.
        width: Numbers in a vector, a power of two; 0 leaves it to LLVM.
        counted: Count references to arrays. Set it to False only for functions that make no arrays.

    Returns:
        The compiled function, or the function itself where numba is missing.
    """
    if numba is None:
        say_once(f"loops run uncompiled, some hundred times slower: {_LACKING}; install numba")
        return function
    if internals is None:
        dispatcher = numba.njit(function, inline="always" if inlined else "never", **_OPTIONS)
    else:
        vectors = internals.Vectors(interleave, width)
        dispatcher = internals.Program(function, noalias, vectors, forceinline=inlined, _nrt=counted, **_OPTIONS)
    dispatcher._cache = _ContentCache(function, inlined, noalias, interleave, width, counted)
    result: _Function = dispatcher
    return result


compiled_in_place: Final = partial(compiled, counted=False)
"""`compiled` for functions that make no arrays: a third faster where the loops are short."""


def is_available() -> bool:
    """Tell whether numba is installed."""
    return numba is not None


def records(dtype: np.dtype[Any], count: int = 1) -> npt.NDArray[Any]:
    """Make an array of zeroed records, whose fields are read by name in compiled and in plain loops."""
    return _with_names(np.zeros(count, dtype))


def aligned_records(dtype: np.dtype[Any], count: int = 1) -> npt.NDArray[Any]:
    """Make an array of zeroed records that begins at a line of the processor's cache."""
    room = np.zeros(count * dtype.itemsize + CACHE_LINE, np.uint8)
    first = -room.ctypes.data % CACHE_LINE
    return _with_names(room[first : first + count * dtype.itemsize].view(dtype))


def _with_names(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    return array if numba is not None else array.view(np.recarray)


def by_reference(kind: _Tuple) -> _Tuple:
    """Declare a named tuple of arrays and numbers as argument of compiled functions, which only read its fields."""
    if internals is not None:
        internals.pass_by_reference(kind)
    return kind


def compile_for(function: Any, examples: Sequence[Any]) -> None:
    """Compile a `compiled` function now, for the examples' types and what converts to them, and for no others."""
    function.compile(tuple(numba.typeof(example) for example in examples))
    function.disable_compile()


def entry(function: _Function, *examples: Any) -> _Function:
    """Compile a `compiled` function for the examples' types and skip the type check of later calls where possible.

    The check takes as long as a short loop does in a program that wakes seldom, with cold caches.
    """
    if numba is None:
        return function
    made: _Function = cast(Any, function).compile(tuple(numba.typeof(example) for example in examples))
    return made if internals is not None else function


def _aligned(_typing_context: Any) -> Any:
    """Type and lower `align_stack`."""

    def generate(context: Any, builder: Any, _signature: Any, _arguments: Any) -> Any:
        builder.function.attributes.alignstack = 64
        builder.function.attributes.add("noinline")  # a caller would lose the alignment
        return context.get_dummy_value()

    return numba.types.void(), generate


align_stack: Final[Callable[[], None]] = intrinsic(_aligned) if numba is not None else lambda: None
"""Align the stack of a compiled function with the processor's cache lines.

Spilled vectors of 64 bytes would otherwise lie across two lines in three processes of four: loops with many outputs
would take a third more time.
"""


@cache
def say_once(line: str) -> None:
    """Warn once per process, on stderr unless the program logs elsewhere."""
    logging.getLogger("textile_twin_core").warning("%s", line)


def cache_directory() -> Path:
    """Directory of the compiled loops."""
    chosen = os.environ.get("TEXTILE_TWIN_CACHE_DIR")
    if chosen:
        return Path(chosen)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser()) / "textile-twin"


class _ContentCache:
    """One file per function and signature, written atomically; it has the interface of numba's own caches."""

    def __init__(self, function: Callable[..., Any], *options: int) -> None:
        self._function, self._options = function, options

    @property
    def cache_path(self) -> str:
        """The directory, for numba's statistics."""
        return str(cache_directory())

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load the compiled function for a signature; None where there is no usable entry.

        Needs numba's runtime alone: `refresh`, as numba's own caches call it, also imports all that compiles.
        """
        try:
            data = self._path(sig, target_context.codegen()).read_bytes()
            rtsys.initialize(target_context)
            return CompileResult._rebuild(target_context, *pickle.loads(data))
        except FileNotFoundError:
            return None
        except Exception as error:  # a damaged file can raise anything
            say_once(f"compiled loops cannot be read from {cache_directory()} ({_brief(error)}): compiling them again")
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store a compiled function."""
        if data.library.has_dynamic_globals or data.lifted or " at 0x" in str(sig):
            return
        try:
            path = self._path(sig, data.codegen)
            path.parent.mkdir(parents=True, exist_ok=True)
            unfinished = path.with_suffix(f".{uuid4().hex}")
            try:
                unfinished.write_bytes(dumps(data._reduce()))
                unfinished.replace(path)
                _forget_unused(path.parent)
            finally:
                unfinished.unlink(missing_ok=True)
        except Exception as error:  # a full disk must not stop a machine
            say_once(
                f"compiled loops cannot be stored in {cache_directory()} ({_brief(error)}): every process compiles them"
                " again; set TEXTILE_TWIN_CACHE_DIR to a directory that can be written"
            )

    def _path(self, sig: Any, codegen: Any) -> Path:
        digest = sha256(repr((_VERSIONS, self._options, str(sig), codegen.magic_tuple())).encode())
        for part in _content(self._function, set()):
            digest.update(part)
        return cache_directory() / f"{self._function.__name__}-{digest.hexdigest()[:32]}"


_UNUSED_S: Final = 90 * 86_400
"""Age since the last read [s] after which an entry is removed, when another one is written."""
_VERSIONS: Final = (
    sys.implementation.cache_tag,
    getattr(numba, "__version__", None),
    getattr(internals, "SUPPORTED", "plain, inlined by numba"),
    sorted(_OPTIONS),
)


def _content(function: Any, met: set[Any]) -> Iterator[bytes]:
    """Yield what a function's file depends on: module, code, constants found by name, the functions that it calls."""
    if function in met:
        return
    met.add(function)
    yield repr(
        (function.__module__, function.__defaults__, [cell.cell_contents for cell in function.__closure__ or ()])
    ).encode()
    for code in _codes(function.__code__):
        yield code.co_code
        yield repr((code.co_names, [c for c in code.co_consts if not isinstance(c, types.CodeType)])).encode()
        for value in _named(code, function.__globals__):
            if isinstance(getattr(value, "_cache", None), _ContentCache):
                yield from _content(value.py_func, met)
            elif isinstance(value, np.ndarray):
                yield value.tobytes() + repr((value.dtype, value.shape)).encode()
            elif isinstance(value, type):
                yield repr((value.__qualname__, getattr(value, "_fields", ()))).encode()
            elif isinstance(value, (bool, int, float, str, tuple, np.generic)):
                yield repr(value).encode()


def _named(code: types.CodeType, scope: dict[str, Any]) -> Iterator[Any]:
    """Yield the values of the names in a code object, also of attributes of this package's modules."""
    for name in code.co_names:
        value = scope.get(name)
        yield value
        if isinstance(value, types.ModuleType) and value.__name__.startswith(__package__):
            yield from (getattr(value, other, None) for other in code.co_names)


def _codes(code: types.CodeType) -> Iterator[types.CodeType]:
    yield code
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield from _codes(constant)


def _forget_unused(directory: Path) -> None:
    for path in directory.iterdir():
        with suppress(FileNotFoundError):  # another process was first
            if path.stat().st_atime < time.time() - _UNUSED_S:
                path.unlink()


def _brief(error: Exception) -> str:
    return getattr(error, "strerror", None) or type(error).__name__
