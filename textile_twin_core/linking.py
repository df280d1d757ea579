"""Code of compiled functions on its way to a program: parts, linked and optimised once, and the whole."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from numba.core.cgutils import ir
from numba.core.codegen import CPUCodeLibrary, JITCodeLibrary, ll


class Vectors(NamedTuple):
    """How loops take vectors: so many side by side, of so many numbers each; 0: as LLVM likes."""

    abreast: int = 0
    wide: int = 0


class ProgramPart(CPUCodeLibrary):  # type: ignore[misc]
    """A function that others call: their program optimises it, and makes machine code of it, with all the others."""

    def __init__(self, codegen: Any, vectors: Vectors) -> None:
        super().__init__(codegen, "part")
        self._vectors = vectors

    def add_ir_module(self, module: Any) -> None:
        """What numba hands over."""
        _tell_vectors(module, self._vectors)
        super().add_ir_module(module)

    def add_llvm_module(self, module: Any) -> None:
        """Take the function's code as it is."""
        self._final_module.link_in(module)

    def finalize(self) -> None:
        """Let a program link it, and drop it where all calls of it are inlined."""
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage == ll.Linkage.external:
                function.linkage = ll.Linkage.linkonce_odr
        self._shared_module = self._final_module
        self._finalized = True


class BorrowedPart(ProgramPart):
    """A function of numba's own, with all that it calls: other functions of numba's may want it beside a program."""

    def finalize(self) -> None:
        """Take in what it calls."""
        for library in self._linking_libraries:
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._linking_libraries.clear()
        super().finalize()


class WholeProgram(JITCodeLibrary):  # type: ignore[misc]
    """A program: each of its parts is linked once, however many others call it."""

    def __init__(self, codegen: Any, vectors: Vectors) -> None:
        super().__init__(codegen, "program")
        self._vectors = vectors
        self.enable_object_caching()

    def add_linking_library(self, library: CPUCodeLibrary) -> None:
        """Link what is called, and all that it calls."""
        if library not in self._linking_libraries:
            super().add_linking_library(library)
            for called in library._linking_libraries if isinstance(library, ProgramPart) else ():
                self.add_linking_library(called)

    def add_ir_module(self, module: Any) -> None:
        """What numba hands over."""
        _tell_vectors(module, self._vectors)
        super().add_ir_module(module)

    def _optimize_final_module(self) -> None:
        """Once: numba inlines cheaply before, which of many parts takes long, and makes none of them faster."""
        if not self._linking_libraries:
            super()._optimize_final_module()
            return
        passes, builder = self._codegen._module_pass_manager()
        passes.run(self._final_module, builder)


def _tell_vectors(module: Any, vectors: Vectors) -> None:
    """Have loops take such vectors (llvm.loop.interleave.count and .vectorize.width in LLVM).

    While one waits for a root, others go on: LLVM by itself does so for short loops alone, though a processor does not
    see far enough ahead in long ones. Where a loop has few rounds, those that it cannot take side by side are slow, and
    so are those that fill no vector: LLVM likes the widest that the processor has.
    """
    told = []
    for name, count in (("interleave.count", vectors.abreast), ("vectorize.width", vectors.wide)):
        if count > 0:
            number = ir.Constant(ir.IntType(32), count)
            told.append(module.add_metadata([ir.MetaDataString(module, f"llvm.loop.{name}"), number]))
    for end in _ends_of_loops(module) if told else ():
        loop = module.add_metadata(told)
        loop.operands = (loop, *told)
        end.set_metadata("llvm.loop", loop)


def _ends_of_loops(module: Any) -> Iterator[Any]:
    """Jumps back, to a block that stands before."""
    for function in module.functions:
        met = set()
        for block in function.blocks:
            met.add(block.name)
            if isinstance(block.terminator, ir.Branch) and block.terminator.operands[0].name in met:
                yield block.terminator
