"""Kernels that other kernels call: typed and lowered once in a process, optimized and compiled only with their callers.

All kernels are inlined. Machine code of a callee, its wrapper for Python and its file in the cache would be made for
nothing; a first start takes 0.7 of its processor time without them.
"""

import contextlib
from collections.abc import Iterator
from types import BuiltinFunctionType
from typing import Any

from numba.core import types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.dispatcher import _FunctionCompiler  # type: ignore[attr-defined]
from numba.core.targetconfig import ConfigStack
from numba.core.typing import make_concrete_template


class _Library(JITCodeLibrary):
    """The simplified functions of a callee and of those that it calls, for the libraries of its callers."""

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
        # Not earlier: NumPy's functions are compiled again for a caller whose flags differ.
        self.state.flags.no_compile = self.state.flags.no_cpython_wrapper = True
        return super().define_pipelines()


class Callee:
    """A kernel as Numba sees it in its callers."""

    def __init__(self, kernel: Any) -> None:
        self._name, self._context = kernel.py_func.__name__, kernel.targetctx
        self._compiler = _FunctionCompiler(
            *(kernel.py_func, kernel.targetdescr, kernel.targetoptions, kernel.locals, _CalleeCompiler)
        )
        self._signatures: dict[Any, Any] = {}

    def get_call_template(self, given: Any, named: Any) -> Any:
        parameters, kinds = self._compiler.fold_argument_types(given, named)
        if (key := self.get_overload(kinds)) not in self._signatures:
            made = self._compiler.compile(tuple(kinds), None)
            self._context.insert_user_function(key, made.fndesc, [made.library])
            self._signatures[key] = made.signature
        template = make_concrete_template(self._name, key=self._name, signatures=[*self._signatures.values()])
        return template, parameters, kinds, {}

    def get_overload(self, kinds: Any) -> Any:
        """Return the key of the machine code in the target context, for the caller that is being compiled."""
        return self, tuple(kinds), ConfigStack().top().nrt


@contextlib.contextmanager
def calls_remembered(context: Any) -> Iterator[None]:
    """Type each call of a built-in function with the same types of arguments once: a sixth of the compiler's time."""
    resolve = context.resolve_function_type
    if "resolve_function_type" in vars(context):  # by the kernel that this one is compiled for
        yield
        return
    known: dict[Any, Any] = {}  # for this kernel alone: what Numba knows of a call is of the last one that it has typed

    def remembered(function: Any, given: Any, named: Any) -> Any:
        if named or not isinstance(function, types.Function | BuiltinFunctionType):
            return resolve(function, given, named)
        call = function, tuple(given)
        if call not in known:
            known[call] = resolve(function, given, named)
        return known[call]

    context.resolve_function_type = remembered
    try:
        yield
    finally:
        del context.resolve_function_type
