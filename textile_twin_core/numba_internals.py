"""Faster compilation by numba's internals: whole programs instead of one library per function, tuples by reference.

This module is optional. `compiling` uses it with the numba releases that it was written for (`SUPPORTED`), and numba's
public `njit` with every other release. Results are the same; compiling takes about a third of the time with it, since

- numba itself emits machine code and Python wrappers for every function, and again wherever one calls another;
- numba passes each array of a named tuple as seven separate values.
"""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache, partial
from itertools import accumulate
from typing import Any, Final, NamedTuple

import numba
from numba.core import cgutils
from numba.core.cgutils import ir
from numba.core.codegen import CPUCodeLibrary, JITCodeLibrary, ll
from numba.core.compiler import Compiler, Flags
from numba.core.compiler_lock import global_compiler_lock
from numba.core.compiler_machinery import PassManager
from numba.core.imputils import impl_ret_borrowed, lower_getattr_generic
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
from numba.core.types import Function, Type
from numba.core.typing import make_concrete_template
from numba.core.typing.templates import AttributeTemplate
from numba.core.untyped_passes import (
    DeadBranchPrune,
    FixupArgs,
    GenericRewrites,
    IRProcessing,
    ReconstructSSA,
    RewriteSemanticConstants,
    TranslateByteCode,
)
from numba.extending import NativeValue, infer_getattr, models, register_model, typeof_impl, unbox

SUPPORTED: Final = "0.68."
"""Prefix of the numba versions whose internals this module knows."""
if not numba.__version__.startswith(SUPPORTED):
    raise ImportError(f"numba {numba.__version__}: internals known of {SUPPORTED}x alone")

_COLLECT_AFTER = 1_000_000
"""Allocations between two garbage collections while compiling: a compiler makes millions of objects that stay."""


class Vectors(NamedTuple):
    """Vectorisation of loops: `interleave` vectors side by side, of `width` numbers each; 0 leaves it to LLVM."""

    interleave: int = 0
    width: int = 0


# Code libraries -----------------------------------------------------------------------------------------------------


class ProgramPart(CPUCodeLibrary):  # type: ignore[misc]
    """Code of a function that other functions call; its program optimises and emits it together with all others."""

    def __init__(self, codegen: Any, vectors: Vectors) -> None:
        super().__init__(codegen, "part")
        self._vectors = vectors

    def add_ir_module(self, module: Any) -> None:
        """Add a module that numba lowered."""
        _set_loop_vectors(module, self._vectors)
        super().add_ir_module(module)

    def add_llvm_module(self, module: Any) -> None:
        """Link a module without optimising it."""
        self._final_module.link_in(module)

    def finalize(self) -> None:
        """Mark the functions as droppable where every call of them is inlined."""
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage == ll.Linkage.external:
                function.linkage = ll.Linkage.linkonce_odr
        self._shared_module = self._final_module
        self._finalized = True


class BorrowedPart(ProgramPart):
    """Code of one of numba's own functions with everything that it calls, since numba's functions may share it."""

    def finalize(self) -> None:
        """Link the functions that it calls."""
        for library in self._linking_libraries:
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._linking_libraries.clear()
        super().finalize()


class WholeProgram(JITCodeLibrary):  # type: ignore[misc]
    """Machine code of a function and of all its parts, each linked once."""

    def __init__(self, codegen: Any, vectors: Vectors) -> None:
        super().__init__(codegen, "program")
        self._vectors = vectors
        self.enable_object_caching()

    def add_linking_library(self, library: CPUCodeLibrary) -> None:
        """Link a called function and, recursively, the functions that it calls."""
        if library not in self._linking_libraries:
            super().add_linking_library(library)
            for called in library._linking_libraries if isinstance(library, ProgramPart) else ():
                self.add_linking_library(called)

    def add_ir_module(self, module: Any) -> None:
        """Add a module that numba lowered."""
        _set_loop_vectors(module, self._vectors)
        super().add_ir_module(module)

    def _optimize_final_module(self) -> None:
        """Optimise once; numba's cheap inlining pass before it is slow on many parts and makes none faster."""
        if not self._linking_libraries:
            super()._optimize_final_module()
            return
        passes, builder = self._codegen._module_pass_manager()
        passes.run(self._final_module, builder)


def _set_loop_vectors(module: Any, vectors: Vectors) -> None:
    """Set LLVM's llvm.loop.interleave.count and llvm.loop.vectorize.width on every loop of a module.

    Interleaving hides the latency of square roots and divisions; LLVM alone does so for short loops only. In loops of
    few rounds LLVM's choice, the widest vector of the processor, is slow.
    """
    settings = []
    for name, count in (("interleave.count", vectors.interleave), ("vectorize.width", vectors.width)):
        if count > 0:
            number = ir.Constant(ir.IntType(32), count)
            settings.append(module.add_metadata([ir.MetaDataString(module, f"llvm.loop.{name}"), number]))
    for end in _back_edges(module) if settings else ():
        loop = module.add_metadata(settings)
        loop.operands = (loop, *settings)
        end.set_metadata("llvm.loop", loop)


def _back_edges(module: Any) -> Iterator[Any]:
    for function in module.functions:
        met = set()
        for block in function.blocks:
            met.add(block.name)
            if isinstance(block.terminator, ir.Branch) and block.terminator.operands[0].name in met:
                yield block.terminator


# Dispatchers --------------------------------------------------------------------------------------------------------


@contextmanager
def _rare_collections() -> Iterator[None]:
    """Collect garbage rarely: the collector takes a fifth of the time of compiling otherwise."""
    before = gc.get_threshold()
    gc.set_threshold(max(before[0], _COLLECT_AFTER) if before[0] else 0, *before[1:])
    try:
        yield
    finally:
        gc.set_threshold(*before)


class _Flags(Flags):  # type: ignore[misc]
    """Options of a program or part, all equal: numba looks up what it compiled of its own functions by them."""

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Flags)

    def __hash__(self) -> int:
        return id(_Flags)


class _Typing:
    """numba's typing context with a memory for the signatures of numba's own functions."""

    def __init__(self, context: Any) -> None:
        self._context = context
        self._known: dict[tuple[Any, Any], Any] = {}

    def __getattr__(self, name: str) -> Any:
        return getattr(self._context, name)

    def resolve_function_type(self, function: Any, args: Any, kws: Any) -> Any:
        """Resolve the signature of a call."""
        found = self._known.get((function, args)) if not kws else None
        if found is None:
            found = self._context.resolve_function_type(function, args, kws)
            if found is not None and type(function) is Function and not kws:
                self._known[function, args] = found
        return found


_typing = cache(_Typing)


class _Target(CPU):  # type: ignore[misc]
    """Compilation target on which numba's own functions are parts of the program, too."""


class _Pipeline(Compiler):  # type: ignore[misc]
    _PART: type[ProgramPart] = BorrowedPart

    def __init__(
        self, vectors: Vectors, types: Any, context: Any, _library: Any, args: Any, result: Any, flags: Any, *more: Any
    ):
        code = context.codegen()
        library = self._PART(code, vectors) if flags.no_compile else WholeProgram(code, vectors)
        super().__init__(_typing(types), context.subtarget(target=_Target), library, args, result, flags, *more)


class _PlainLoops(_Pipeline):
    """numba's passes that functions without closures and array expressions need, in numba's order."""

    _PART = ProgramPart
    _PASSES = (
        *(TranslateByteCode, FixupArgs, IRProcessing, RewriteSemanticConstants, DeadBranchPrune, GenericRewrites),
        *(ReconstructSSA, DeadBranchPrune, NopythonTypeInference, PreLowerStripPhis, IRLegalization, AnnotateTypes),
        *(NativeLowering, NoPythonBackend),
    )

    def define_pipelines(self) -> list[PassManager]:
        """List the passes, as numba asks for them."""
        passes = PassManager("plain loops")
        for each in self._PASSES:
            passes.add_pass(each, each.__name__)
        passes.finalize()
        return [passes]


class Program(CPUDispatcher):  # type: ignore[misc]
    """Compiled function: a whole program when Python calls it, a part of another program when that one does."""

    _cache: Any

    def __init__(
        self,
        function: Any,
        noalias: bool = False,
        vectors: Vectors = Vectors(),  # noqa: B008
        passes: type = _PlainLoops,
        **options: Any,
    ) -> None:
        options = {"nopython": True, "boundscheck": None} | options
        super().__init__(function, targetoptions=options, pipeline_class=partial(passes, vectors))
        self._compiler._customize_flags = self._customize
        self._noalias, self._is_part = noalias, False

    def _customize(self, flags: Any) -> Any:
        flags = _Flags(flags)
        flags.noalias = self._noalias
        flags.no_cfunc_wrapper = True
        flags.no_cpython_wrapper = flags.no_compile = self._is_part
        return flags

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Compile as a part for a caller, as numba asks for it."""
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
        """Compile for a signature, also where only a part of it exists so far."""
        with global_compiler_lock, _rare_collections():  # another thread may compile it as a part
            for args in [args for args, made in self.overloads.items() if isinstance(made.library, ProgramPart)]:
                del self.overloads[args]
            return super().compile(sig)

    def add_overload(self, made: Any) -> None:
        """Register a compiled function; callers find a part, Python does not."""
        if isinstance(made.library, ProgramPart):
            made = made._replace(entry_point=object())  # the key under which callers find it
            self.targetctx.insert_user_function(made.entry_point, made.fndesc, [made.library])
            self.overloads[tuple(made.signature.args)] = made
        else:
            super().add_overload(made)


dispatcher_registry[_Target] = CPUDispatcher
jit_registry[_Target] = partial(partial, Program, passes=_Pipeline)


# Named tuples by reference ------------------------------------------------------------------------------------------

_WORD = 8  # bytes


def pass_by_reference(kind: type[tuple[Any, ...]]) -> None:
    """Let compiled functions take named tuples of this kind by address, and read their fields."""
    typeof_impl.register(kind)(_type_of)


class _Reference(Type):
    """Address of the fields of a named tuple; the fields do not change while it is in use."""

    def __init__(self, kind: Any, fields: tuple[Any, ...]) -> None:
        self.fields = dict(zip(kind._fields, fields, strict=True))
        self.offsets: tuple[int, ...] = ()
        super().__init__(f"&{kind.__module__}.{kind.__qualname__}({', '.join(map(str, fields))})")


def _type_of(value: tuple[Any, ...], context: Any) -> _Reference:
    return _Reference(type(value), tuple(typeof_impl(field, context) for field in value))


@register_model(_Reference)
class _Model(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: _Reference) -> None:
        super().__init__(manager, kind, cgutils.voidptr_t)


def _offsets(context: Any, kind: _Reference) -> tuple[int, ...]:
    """Offsets of the fields, then the size of all [bytes]."""
    if not kind.offsets:
        sizes = [context.get_abi_sizeof(context.get_value_type(field)) for field in kind.fields.values()]
        kind.offsets = tuple(accumulate([-(-size // _WORD) * _WORD for size in sizes], initial=0))
    return kind.offsets


def _from_python(kind: _Reference, value: Any, c: Any) -> Any:
    """Write the fields to the stack for the duration of a call."""
    *offsets, end = _offsets(c.context, kind)
    content = cgutils.alloca_once(c.builder, cgutils.intp_t, end // _WORD)
    wrong, natives = cgutils.false_bit, []
    for number, (offset, field) in enumerate(zip(offsets, kind.fields.values(), strict=True)):
        native = c.unbox(field, c.pyapi.tuple_getitem(value, number))
        address = cgutils.pointer_add(c.builder, content, offset, native.value.type.as_pointer())
        c.builder.store(native.value, address)
        wrong = c.builder.or_(wrong, native.is_error)
        natives.append((field, native))

    def cleanup() -> None:
        for field, native in natives:
            if native.cleanup is not None:
                native.cleanup()
            if c.context.enable_nrt:
                c.context.nrt.decref(c.builder, field, native.value)

    # Reads of the fields may be moved anywhere behind this barrier, but not before it.
    barrier_type = cgutils.ir.FunctionType(cgutils.voidptr_t, [content.type])
    barrier = cgutils.ir.InlineAsm(barrier_type, "", "=r,0,~{memory}", side_effect=True)
    return NativeValue(c.builder.call(barrier, [content]), wrong, cleanup)


@infer_getattr
class _Fields(AttributeTemplate):  # type: ignore[misc]
    key = _Reference

    def generic_resolve(self, kind: _Reference, name: str) -> Any:
        """Resolve the type of a field."""
        return kind.fields.get(name)


def _read(context: Any, builder: Any, kind: _Reference, address: Any, name: str) -> Any:
    """Load a field."""
    field, offset = kind.fields[name], dict(zip(kind.fields, _offsets(context, kind), strict=False))[name]
    to_field = context.get_value_type(field).as_pointer()
    value = builder.load(cgutils.pointer_add(builder, address, offset, to_field))
    value.set_metadata("invariant.load", builder.module.add_metadata([]))
    return impl_ret_borrowed(context, builder, field, value)


unbox(_Reference)(_from_python)
lower_getattr_generic(_Reference)(_read)
