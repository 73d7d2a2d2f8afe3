"""A small package of kernels that tests write somewhere, edit and call, in this process or another."""

import importlib
import sys
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType

#: File by file. Each value or function of the first three is reached by one or more of the kernels in the last one.
FILES = {
    "__init__.py": "",
    "values.py": '''
"""Constants."""
import enum
from typing import NamedTuple
import numpy as np

RADIUS = 0.25
NAMES = (1, 2.0)
TABLE = np.array([1.0, 2.0])
RECORD = np.dtype([("x", np.float64), ("y", np.float64)])
UNREACHED = 1

class Kind(enum.IntEnum):
    PELLET = 1
    GHOST = 2

class Pair(NamedTuple):
    left: float
    right: float
''',
    "helpers.py": '''
from pacman_env.engine.jit import kernel
from . import values

@kernel
def grown(x, by=1.0):
    """A helper."""
    return x + by + values.RADIUS

@kernel
def not_called(x):
    return x

def python_code():
    return [not_called]
''',
    "operations.py": """
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

SHIFT = 1

def shifted(builder, value):
    return builder.shl(value, ir.Constant(ir.IntType(64), SHIFT))

def _made(amount):
    @intrinsic
    def operation(typing_context, value):
        def generate(context, builder, signature, arguments):
            return builder.add(shifted(builder, arguments[0]), ir.Constant(ir.IntType(64), amount))
        return types.int64(types.int64), generate
    return operation

doubled = _made(10)
""",
    "kernels.py": """
import numpy as np
from pacman_env.engine.jit import kernel
from . import helpers, values
from .helpers import grown
from .operations import doubled
from .values import NAMES, RECORD, TABLE, Kind, Pair

@kernel
def constant(x):
    return x * values.RADIUS

@kernel
def calls(x):
    return grown(x) + helpers.grown(x, 2.0)

@kernel
def frozen(k):
    return TABLE[k] + NAMES[0] + Kind.GHOST

@kernel
def made():
    return np.zeros(2, RECORD)[0]

@kernel
def pair(left, right):
    return Pair(left, right).left

@kernel
def of_pair(both):
    return both.left - both.right

@kernel
def operates(x):
    return doubled(x)

@kernel
def inner_loop(x):
    total = 0.0
    for k in range(3):
        total += sum([x * 2.0 for _ in range(k)])
    return total
""",
}
KERNELS = ("constant", "calls", "frozen", "made", "pair", "of_pair", "operates", "inner_loop")


def write(folder: Path, edits: Mapping[str, tuple[str, str]] | None = None) -> Path:
    """The package below ``folder``, in each file of ``edits`` one text replaced by another; returns ``folder``."""
    package = folder / "sample"
    package.mkdir(parents=True)
    for name, text in FILES.items():
        if name in (edits or {}):
            before, after = (edits or {})[name]
            assert before in text
            text = text.replace(before, after)
        (package / name).write_text(text)
    return folder


def loaded(folder: Path) -> ModuleType:
    """The module of kernels, in this process; an earlier one stays as it is."""
    sys.path.insert(0, str(folder))
    try:
        for name in [name for name in sys.modules if name.partition(".")[0] == "sample"]:
            del sys.modules[name]
        importlib.invalidate_caches()
        return importlib.import_module("sample.kernels")
    finally:
        sys.path.remove(str(folder))
