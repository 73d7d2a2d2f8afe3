"""Compile kernels that other kernels call: type and lower them once per process, but optimize only their callers.

All kernels are inlined, so machine code of callees, Python wrappers and cache files would be useless
(``benchmarks/history.md``: what that saves).
"""

import contextlib
import gc
import warnings
from collections.abc import Iterator
from types import BuiltinFunctionType
from typing import Any

from numba.core import types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.dispatcher import _FunctionCompiler  # type: ignore[attr-defined]
from numba.core.errors import NumbaExperimentalFeatureWarning
from numba.core.targetconfig import ConfigStack
from numba.core.typing import make_concrete_template


class _Library(JITCodeLibrary):
    """Library with a callee's functions and the functions that they call, for linking into callers' libraries."""

    def finalize(self) -> None:
        self._raise_if_finalized()
        for library in dict.fromkeys(self._linking_libraries):
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._finalized = True


class _CalleeCompiler(Compiler):
    def compile_extra(self, func: Any) -> Any:
        self.state.library = _Library(self.state.targetctx.codegen(), func.__qualname__)
        return super().compile_extra(func)

    def define_pipelines(self) -> Any:
        # Not set earlier, because NumPy's functions are compiled again for callers with other flags.
        self.state.flags.no_compile = self.state.flags.no_cpython_wrapper = True
        return super().define_pipelines()


class Callee:
    """A kernel as called from other kernels; replaces Numba's dispatcher methods."""

    def __init__(self, kernel: Any) -> None:
        self._name, self._context = kernel.py_func.__name__, kernel.targetctx
        self._compiler = _FunctionCompiler(
            *(kernel.py_func, kernel.targetdescr, kernel.targetoptions, kernel.locals, _CalleeCompiler)
        )
        self._signatures: dict[Any, Any] = {}

    def get_call_template(self, given: Any, named: Any) -> Any:
        parameters, kinds = self._compiler.fold_argument_types(given, named)
        if (key := self.get_overload(kinds)) not in self._signatures:
            compiled = self._compiler.compile(tuple(kinds), None)
            self._context.insert_user_function(key, compiled.fndesc, [compiled.library])
            self._signatures[key] = compiled.signature
        template = make_concrete_template(self._name, key=self._name, signatures=[*self._signatures.values()])
        return template, parameters, kinds, {}

    def get_overload(self, kinds: Any) -> Any:
        """Return the key by which Numba finds this function in the target context while it compiles a caller."""
        return self, tuple(kinds), ConfigStack().top().nrt


@contextlib.contextmanager
def quick_compilation(context: Any) -> Iterator[None]:
    """Switch off garbage collection in the block, and resolve the types of equal calls only once."""
    resolve = context.resolve_function_type
    if "resolve_function_type" in vars(context):  # an outer kernel is being compiled
        yield
        return
    results: dict[Any, Any] = {}  # for this kernel only, because Numba keeps state of the last typed call

    def remembered(function: Any, given: Any, named: Any) -> Any:
        if named or not isinstance(function, types.Function | BuiltinFunctionType):
            return resolve(function, given, named)
        call = function, tuple(given)
        if call not in results:
            results[call] = resolve(function, given, named)
        return results[call]

    context.resolve_function_type, collects = remembered, gc.isenabled()
    gc.disable()
    try:
        with warnings.catch_warnings():
            # Numba warns if a record is passed for another one with the same first fields.
            warnings.simplefilter("ignore", NumbaExperimentalFeatureWarning)
            yield
    finally:
        del context.resolve_function_type
        if collects:
            gc.enable()
