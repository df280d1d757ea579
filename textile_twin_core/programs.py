"""A function compiled as one program with all functions that it calls; these alone become no machine code.

numba by itself makes machine code of every function, and wrappers by which Python can call it, and does so again
wherever one is part of another: of forty functions that call each other that takes three times as long.
"""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

from numba.core.caching import NullCache
from numba.core.cgutils import ir
from numba.core.codegen import CPUCodeLibrary, JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import CPUDispatcher

_COLLECT_AFTER = 200_000
"""Objects until Python looks for what is no longer used: a compiler makes millions that stay."""


@contextmanager
def _few_collections() -> Iterator[None]:
    """Looking through all objects again and again takes a fifth of what compiling takes."""
    before = gc.get_threshold()
    gc.set_threshold(max(before[0], _COLLECT_AFTER) if before[0] else 0, *before[1:])
    try:
        yield
    finally:
        gc.set_threshold(*before)


class _Part(CPUCodeLibrary):  # type: ignore[misc]
    """A function that others call, for them to link: they optimise it, and make machine code of it, with their own."""

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalized = True


class _Abreast(JITCodeLibrary):  # type: ignore[misc]
    """A function whose loops take several vectors of samples side by side: while one waits for a root, others go on.

    LLVM by itself does so for short loops alone, though a processor does not see far enough ahead in long ones.
    """

    def __init__(self, codegen: Any, vectors: int) -> None:
        super().__init__(codegen, "abreast")
        self._vectors = vectors
        self.enable_object_caching()

    def add_ir_module(self, module: Any) -> None:
        """What numba hands over; its loops are told how many (LLVM Language Reference, llvm.loop.interleave.count)."""
        count = ir.Constant(ir.IntType(32), self._vectors)
        told = module.add_metadata([ir.MetaDataString(module, "llvm.loop.interleave.count"), count])
        for end in _ends_of_loops(module):
            loop = module.add_metadata([told])
            loop.operands = (loop, told)
            end.set_metadata("llvm.loop", loop)
        super().add_ir_module(module)


def _ends_of_loops(module: Any) -> Iterator[Any]:
    """Jumps back, to a block that stands before."""
    for function in module.functions:
        met = set()
        for block in function.blocks:
            met.add(block.name)
            if isinstance(block.terminator, ir.Branch) and block.terminator.operands[0].name in met:
                yield block.terminator


class _Pipeline(Compiler):  # type: ignore[misc]
    def __init__(
        self, abreast: int, types: Any, context: Any, _library: Any, args: Any, result: Any, flags: Any, *more: Any
    ):
        library: Any = _Part(context.codegen(), "part") if flags.no_compile else None
        if abreast > 1 and library is None:
            library = _Abreast(context.codegen(), abreast)
        super().__init__(types, context, library, args, result, flags, *more)


class Program(CPUDispatcher):  # type: ignore[misc]
    """A compiled function: a program of its own when Python calls it, a part of another when that one does."""

    _cache: Any

    def __init__(self, function: Any, apart: bool, abreast: int, **options: Any) -> None:
        options = {"nopython": True, "boundscheck": None} | options
        super().__init__(function, targetoptions=options, pipeline_class=partial(_Pipeline, abreast))
        self._compiler._customize_flags = self._set
        self._apart, self._is_part = apart, False

    def _set(self, flags: Any) -> Any:
        flags.noalias = self._apart
        flags.no_cfunc_wrapper = True
        flags.no_cpython_wrapper = flags.no_compile = self._is_part
        return flags

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """What numba asks of a function that another one calls."""
        with global_compiler_lock:
            before = self._is_part, self._cache
            self._is_part, self._cache = True, NullCache()  # a part is kept with its program
            try:
                return super().get_call_template(args, kws)
            finally:
                self._is_part, self._cache = before

    def compile(self, sig: Any) -> Any:
        """Compile for a signature: for Python anew what is there as a part only."""
        with global_compiler_lock, _few_collections():  # another thread may be at it as a part
            if not self._is_part:
                for args in [args for args, made in self.overloads.items() if isinstance(made.library, _Part)]:
                    del self.overloads[args]
            return super().compile(sig)

    def add_overload(self, made: Any) -> None:
        """Keep what was compiled; a part where functions that call it find it, and Python does not."""
        if isinstance(made.library, _Part):
            made = made._replace(entry_point=object())  # what it is known by
            self.targetctx.insert_user_function(made.entry_point, made.fndesc, [made.library])
            self.overloads[tuple(made.signature.args)] = made
        else:
            super().add_overload(made)
