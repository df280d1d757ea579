"""Plain loops, compiled: `compiled` is numba's njit with this project's options and a cache on disk by content.

What was compiled once starts at once in the next process. The cache is $TEXTILE_TWIN_CACHE_DIR, or textile-twin in
$XDG_CACHE_HOME or ~/.cache. An entry's name tells the code, its constants and the compiled functions it calls, the
signature, the processor and the versions of Python and numba: nothing in it is ever out of date, and processes that
write the same entry write the same. Where it cannot be written or read, loops are compiled anew in each process, and
without numba they run as plain Python, slowly; either is reported once.
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
    from numba.core.compiler import CompileResult
    from numba.core.serialize import dumps
    from numba.core.types import void
    from numba.extending import intrinsic

    from textile_twin_core.linking import Vectors
    from textile_twin_core.programs import Program
    from textile_twin_core.references import pass_by_reference
except ImportError as error:
    numba, _LACKING = None, str(error)

_Function = TypeVar("_Function", bound=Callable[..., Any])
_Tuple = TypeVar("_Tuple", bound=type[tuple[Any, ...]])

_OPTIONS: Final[dict[str, Any]] = {"error_model": "numpy", "fastmath": {"contract"}, "nogil": True}
"""Divisions by zero as in IEEE 754; a product and a sum may become one operation; threads may run beside the loop."""
CACHE_LINE: Final = 64  # bytes


def compiled(
    function: _Function,
    *,
    inlined: bool = False,
    apart: bool = False,
    abreast: int = 0,
    wide: int = 0,
    counted: bool = True,
) -> _Function:
    """The function compiled when first called, for the types it is called with; it may call other compiled ones.

    `inlined` puts it into the functions that call it; `apart` promises that no two of its arrays share memory, which
    lets loops over many of them run on several samples at once, on `abreast` vectors of `wide` samples (powers of two)
    side by side (0: as LLVM likes). Without `counted` nothing counts who uses an array, at each mention: not for
    functions that make arrays, or are given such by those that they call. Values of module-level names are read once.
    Do not hand functions over as arguments: such calls are not kept.
    """
    if numba is None:
        say_once(f"loops run uncompiled, some hundred times slower: {_LACKING}; install numba 0.68")
        return function
    dispatcher = Program(function, apart, Vectors(abreast, wide), forceinline=inlined, _nrt=counted, **_OPTIONS)
    dispatcher._cache = _ContentCache(function, inlined, apart, abreast, wide, counted)
    result: _Function = dispatcher
    return result


compiled_in_place: Final = partial(compiled, counted=False)
"""Of functions that work on arrays of their callers: that is a third faster where the loops are short."""


def is_available() -> bool:
    """Whether there is a compiler."""
    return numba is not None


def records(dtype: np.dtype[Any], count: int = 1) -> npt.NDArray[Any]:
    """So many records of zeros, whose fields loops find by name, compiled or not."""
    return _with_names(np.zeros(count, dtype))


def aligned_records(dtype: np.dtype[Any], count: int = 1) -> npt.NDArray[Any]:
    """The same, the first at the begin of a line of the processor's cache."""
    room = np.zeros(count * dtype.itemsize + CACHE_LINE, np.uint8)
    first = -room.ctypes.data % CACHE_LINE
    return _with_names(room[first : first + count * dtype.itemsize].view(dtype))


def _with_names(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    return array if numba is not None else array.view(np.recarray)


def by_reference(kind: _Tuple) -> _Tuple:
    """A kind of named tuple of arrays and numbers that compiled functions read the fields of, and make none of."""
    if numba is not None:
        pass_by_reference(kind)
    return kind


def compile_for(function: Any, examples: Sequence[Any]) -> None:
    """Compile what `compiled` gave, now, for arguments of the examples' types and what converts to them, alone."""
    function.compile(tuple(numba.typeof(example) for example in examples))
    function.disable_compile()


def entry(function: _Function, *examples: Any) -> _Function:
    """What `compiled` gave, for arguments of the very types of the examples, which it does not look at again.

    Looking takes as long as a short loop where a program wakes seldom, with cold caches.
    """
    if numba is None:
        return function
    made: _Function = cast(Any, function).compile(tuple(numba.typeof(example) for example in examples))
    return made


def _aligned(_typing_context: Any) -> Any:
    """Of a call that does nothing but have its function's stack begin at a cache line."""

    def generate(context: Any, builder: Any, _signature: Any, _arguments: Any) -> Any:
        builder.function.attributes.alignstack = 64
        builder.function.attributes.add("noinline")  # what it is put into would not have it
        return context.get_dummy_value()

    return void(), generate


align_stack: Final[Callable[[], None]] = intrinsic(_aligned) if numba is not None else lambda: None
"""Called in a compiled loop: what does not fit the processor's registers is kept in whole cache lines.

Vectors of 64 bytes would else lie across two of them in three processes of four: a third more time for many outputs.
"""


@cache
def say_once(line: str) -> None:
    """Tell a person, once in a process, on stderr unless the program logs elsewhere."""
    logging.getLogger("textile_twin_core").warning("%s", line)


def cache_directory() -> Path:
    """Where compiled loops are kept."""
    chosen = os.environ.get("TEXTILE_TWIN_CACHE_DIR")
    if chosen:
        return Path(chosen)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser()) / "textile-twin"


class _ContentCache:
    """One file for each function and signature, written whole or not at all (the interface of numba's own caches)."""

    def __init__(self, function: Callable[..., Any], *options: int) -> None:
        self._function, self._options = function, options

    @property
    def cache_path(self) -> str:
        """The directory, as numba's statistics tell it."""
        return str(cache_directory())

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The compiled function kept for a signature, None if there is none that can be used."""
        target_context.refresh()
        try:
            data = self._path(sig, target_context.codegen()).read_bytes()
            return CompileResult._rebuild(target_context, *pickle.loads(data))
        except FileNotFoundError:
            return None
        except Exception as error:  # whatever a damaged file brings about
            say_once(f"compiled loops cannot be read from {cache_directory()} ({_brief(error)}): compiling them anew")
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a compiled function."""
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
                f"compiled loops cannot be kept in {cache_directory()} ({_brief(error)}): every process compiles them"
                " anew; set TEXTILE_TWIN_CACHE_DIR to a directory that can be written"
            )

    def _path(self, sig: Any, codegen: Any) -> Path:
        digest = sha256(repr((_VERSIONS, self._options, str(sig), codegen.magic_tuple())).encode())
        for part in _content(self._function, set()):
            digest.update(part)
        return cache_directory() / f"{self._function.__name__}-{digest.hexdigest()[:32]}"


_KEPT_S: Final = 90 * 86_400
"""Entries that nobody read for so long [s] go when another one comes."""
_VERSIONS: Final = (sys.implementation.cache_tag, getattr(numba, "__version__", None), sorted(_OPTIONS))


def _content(function: Any, met: set[Any]) -> Iterator[bytes]:
    """What a function's meaning hangs on: its code, the constants that it finds by name, the functions it calls."""
    if function in met:
        return
    met.add(function)
    yield repr((function.__defaults__, [cell.cell_contents for cell in function.__closure__ or ()])).encode()
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
    """The values of the names that code mentions, also those it finds in one of our modules."""
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
            if path.stat().st_atime < time.time() - _KEPT_S:
                path.unlink()


def _brief(error: Exception) -> str:
    return getattr(error, "strerror", None) or type(error).__name__
