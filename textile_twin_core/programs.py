"""A function compiled as one program with all functions that it calls; these alone become no machine code.

numba by itself makes machine code of every function, and wrappers by which Python can call it, and does so again
wherever one is part of another: of forty functions that call each other that takes three times as long.
"""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache, partial
from typing import Any

from numba.core.compiler import Compiler, Flags
from numba.core.compiler_lock import global_compiler_lock
from numba.core.compiler_machinery import PassManager
from numba.core.registry import CPUDispatcher
from numba.core.target_extension import CPU, dispatcher_registry, jit_registry
from numba.core.typed_passes import (
    AnnotateTypes,
    IRLegalization,
    NativeLowering,
    NoPythonBackend,
    NopythonTypeInference,
    PreLowerStripPhis,
)
from numba.core.types import Function
from numba.core.typing import make_concrete_template
from numba.core.untyped_passes import (
    DeadBranchPrune,
    FixupArgs,
    GenericRewrites,
    IRProcessing,
    ReconstructSSA,
    RewriteSemanticConstants,
    TranslateByteCode,
)

from textile_twin_core.linking import BorrowedPart, ProgramPart, Vectors, WholeProgram

_COLLECT_AFTER = 1_000_000
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


class _Flags(Flags):  # type: ignore[misc]
    """Options of a program or part. numba looks by them for what it has compiled of itself, which is one for all."""

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Flags)

    def __hash__(self) -> int:
        return id(_Flags)


class _Typing:
    """numba's typing context, which finds out once what a function of numba's own makes of arguments of some types."""

    def __init__(self, context: Any) -> None:
        self._context = context
        self._known: dict[tuple[Any, Any], Any] = {}

    def __getattr__(self, name: str) -> Any:
        return getattr(self._context, name)

    def resolve_function_type(self, function: Any, args: Any, kws: Any) -> Any:
        """The signature of a call."""
        found = self._known.get((function, args)) if not kws else None
        if found is None:
            found = self._context.resolve_function_type(function, args, kws)
            if found is not None and type(function) is Function and not kws:
                self._known[function, args] = found
        return found


_typing = cache(_Typing)


class _Target(CPU):  # type: ignore[misc]
    """What programs are compiled for. On it numba's own functions in them are parts, too."""


class _Pipeline(Compiler):  # type: ignore[misc]
    _PART: type[ProgramPart] = BorrowedPart

    def __init__(
        self, vectors: Vectors, types: Any, context: Any, _library: Any, args: Any, result: Any, flags: Any, *more: Any
    ):
        code = context.codegen()
        library = self._PART(code, vectors) if flags.no_compile else WholeProgram(code, vectors)
        super().__init__(_typing(types), context.subtarget(target=_Target), library, args, result, flags, *more)


class _PlainLoops(_Pipeline):
    """What functions without closures and array expressions need of numba's passes, in numba's order."""

    _PART = ProgramPart
    _PASSES = (
        *(TranslateByteCode, FixupArgs, IRProcessing, RewriteSemanticConstants, DeadBranchPrune, GenericRewrites),
        *(ReconstructSSA, DeadBranchPrune, NopythonTypeInference, PreLowerStripPhis, IRLegalization, AnnotateTypes),
        *(NativeLowering, NoPythonBackend),
    )

    def define_pipelines(self) -> list[PassManager]:
        """The passes, as numba asks for them."""
        passes = PassManager("plain loops")
        for each in self._PASSES:
            passes.add_pass(each, each.__name__)
        passes.finalize()
        return [passes]


class Program(CPUDispatcher):  # type: ignore[misc]
    """A compiled function: a program of its own when Python calls it, a part of another when that one does."""

    _cache: Any

    def __init__(
        self,
        function: Any,
        apart: bool = False,
        vectors: Vectors = Vectors(),  # noqa: B008
        passes: type = _PlainLoops,
        **options: Any,
    ) -> None:
        options = {"nopython": True, "boundscheck": None} | options
        super().__init__(function, targetoptions=options, pipeline_class=partial(passes, vectors))
        self._compiler._customize_flags = self._set
        self._apart, self._is_part = apart, False

    def _set(self, flags: Any) -> Any:
        flags = _Flags(flags)
        flags.noalias = self._apart
        flags.no_cfunc_wrapper = True
        flags.no_cpython_wrapper = flags.no_compile = self._is_part
        return flags

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """What numba asks of a function that another one calls."""
        signature, folded = self._compiler.fold_argument_types(args, kws)
        args = tuple(folded)
        with global_compiler_lock, self._compiling_counter:
            if args not in self.overloads and self._can_compile:
                before, self._is_part = self._is_part, True
                try:
                    self.add_overload(self._compiler.compile(args, None))
                finally:
                    self._is_part = before
        name = self.py_func.__name__
        return make_concrete_template(name, key=name, signatures=self.nopython_signatures), signature, args, {}

    def compile(self, sig: Any) -> Any:
        """Compile for a signature: for Python anew what is there as a part only."""
        with global_compiler_lock, _few_collections():  # another thread may be at it as a part
            for args in [args for args, made in self.overloads.items() if isinstance(made.library, ProgramPart)]:
                del self.overloads[args]
            return super().compile(sig)

    def add_overload(self, made: Any) -> None:
        """Keep what was compiled; a part where functions that call it find it, and Python does not."""
        if isinstance(made.library, ProgramPart):
            made = made._replace(entry_point=object())  # what it is known by
            self.targetctx.insert_user_function(made.entry_point, made.fndesc, [made.library])
            self.overloads[tuple(made.signature.args)] = made
        else:
            super().add_overload(made)


dispatcher_registry[_Target] = CPUDispatcher
jit_registry[_Target] = partial(partial, Program, passes=_Pipeline)
