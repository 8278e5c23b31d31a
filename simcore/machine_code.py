"""When kernels become machine code: once, as what Python calls, with all that they call inside.

Numba optimises every kernel, makes machine code of it, and does both again inside each kernel that calls it. Here a
kernel that another one calls stays LLVM code. What Python calls is linked with everything below it, and that whole is
optimised and becomes machine code. No bit of a result depends on it: optimisation keeps the order of all sums.
"""
# mypy: disable-error-code="no-untyped-call"

from __future__ import annotations

import gc
from typing import TYPE_CHECKING, Any

from llvmlite.binding import Linkage
from numba.core import types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.environment import lookup_environment
from numba.core.registry import CPUDispatcher

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

OPTIONS = {"nopython": True, "boundscheck": None, "error_model": "numpy", "no_cfunc_wrapper": True}
_ENVIRONMENT = "_ZN08NumbaEnv"  # begins the names of what holds a function's Python objects


class CalledCode(JITCodeLibrary):
    """LLVM code of a kernel for the kernels that call it: neither optimised nor made machine code by itself."""

    def finalize(self) -> None:
        """Nothing is left to do: those who call it link it."""
        self._raise_if_finalized()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Null, as Numba has it of a function that is not there."""
        del name
        return 0

    @property
    def codegen(self) -> CalledCode:
        """Itself, since there is no machine code whose environment could be set."""
        return self

    def set_env(self, name: str, environment: object) -> None:
        """Left to the code that this is linked into."""

    def _get_module_for_linking(self) -> Any:
        """With all that it calls, for functions that are no kernels of this program."""
        module = self._final_module.clone()
        for library in _below(self):
            module.link_in(_own_module(library), preserve=True)
        for function in _defined(module):
            if function.linkage == Linkage.external:
                function.linkage = "linkonce_odr"
        return module


class EntryCode(JITCodeLibrary):
    """Machine code of a kernel for Python, all that it calls inside."""

    def finalize(self) -> None:
        """Link, optimise the whole, make machine code of it."""
        self._raise_if_finalized()
        codegen: Any = self._codegen
        module = self._final_module
        own = {function.name for function in _defined(module)}
        for library in _below(self):
            self._reload_init.update(library._reload_init)
            module.link_in(_own_module(library), preserve=True)
        for function in _defined(module):
            if function.name not in own:
                function.linkage = "internal"  # so that what is inlined everywhere is dropped
        self._optimize_final_module()
        module.verify()
        self._finalize_final_module()
        for variable in module.global_variables:
            if variable.name.startswith(_ENVIRONMENT) and not variable.is_declaration:
                environment = lookup_environment(variable.name)
                if environment is not None:
                    codegen.set_env(variable.name, environment)


def _own_module(library: JITCodeLibrary) -> Any:
    """What of a library is to be linked once: of a kernel's without the code that it calls."""
    return library._final_module if isinstance(library, CalledCode) else library._get_module_for_linking()


def _below(library: JITCodeLibrary) -> list[JITCodeLibrary]:
    """All libraries whose code a library calls, over kernels that it calls in between; each once."""
    found: dict[JITCodeLibrary, None] = {}
    waiting = list(library._linking_libraries)
    while waiting:
        next_one = waiting.pop()
        if next_one not in found and next_one is not library:
            found[next_one] = None
            waiting += next_one._linking_libraries if isinstance(next_one, CalledCode) else ()
    return list(found)


def _defined(module: Any) -> Iterator[Any]:
    return (function for function in module.functions if not function.is_declaration)


class _CalledCompiler(Compiler):
    """Numba's compiler, its code kept for the kernels that call it."""

    def define_pipelines(self) -> Any:
        """Numba's own."""
        self.state.library = CalledCode(self.state.targetctx.codegen(), self.state.func_id.func_qualname)
        return super().define_pipelines()


class _EntryCompiler(Compiler):
    """Numba's compiler, its code made machine code with all that it calls."""

    def define_pipelines(self) -> Any:
        """Numba's own."""
        self.state.library = EntryCode(self.state.targetctx.codegen(), self.state.func_id.func_qualname)
        self.state.library.enable_object_caching()
        return super().define_pipelines()


class Kernel(CPUDispatcher):
    """A compiled function. Called from Python it is machine code, kept on disk; called from kernels it is `inner`,
    whose code becomes part of theirs."""

    def __init__(self, function: Callable[..., object]) -> None:
        super().__init__(function, targetoptions=dict(OPTIONS), pipeline_class=_EntryCompiler)
        self.enable_caching()
        inner_options = {**OPTIONS, "no_cpython_wrapper": True}
        self.inner = CPUDispatcher(function, targetoptions=inner_options, pipeline_class=_CalledCompiler)

    def compile(self, sig: Any) -> Any:
        """Compile for Python, without collecting garbage meanwhile: the compiler makes objects by the million."""
        collected = gc.isenabled()
        gc.disable()
        try:
            return super().compile(sig)
        finally:
            if collected:
                gc.enable()

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """For the type inference of kernels: the same code whether a number is written out at the call or not."""
        plain = {name: types.unliteral(kind) for name, kind in kws.items()}
        return self.inner.get_call_template(tuple(types.unliteral(kind) for kind in args), plain)

    def get_overload(self, sig: Any) -> Any:
        """What kernels call."""
        return self.inner.get_overload(sig)
