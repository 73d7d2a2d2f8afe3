"""A kernel's key changes with all that its machine code depends on, and with nothing else."""

import dis
import importlib
import os
import pkgutil
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba import njit
from numba.core.dispatcher import Dispatcher

import pacman_env
from pacman_env.engine import kernel_key
from pacman_env.sim.core.ticks import play
from tests.calls import calls_of
from tests.sample_kernels import KERNELS, loaded, write

PACKAGE = Path(pacman_env.__file__).parent
ROOMS = ("game", "world", "sim", "heuristics")


@pytest.fixture(autouse=True)
def _seen_anew() -> Iterator[None]:
    yield
    kernel_key.forget()


def keys(folder: Path, edit: tuple[str, str, str] | None = None) -> dict[str, str]:
    """By name, the keys of the sample's kernels after an edit (file, before, after)."""
    module = loaded(write(folder, {edit[0]: edit[1:]} if edit else {}))
    return {name: kernel_key.kernel_key(getattr(module, name)) for name in KERNELS}


def changed(folder: Path, edit: tuple[str, str, str]) -> set[str]:
    before, after = keys(folder / "before"), keys(folder / "after", edit)
    return {name for name in KERNELS if before[name] != after[name]}


@pytest.mark.parametrize(
    ("edit", "others"),
    [
        (("kernels.py", "x * values.RADIUS", "x / values.RADIUS"), {"constant"}),
        (("values.py", "RADIUS = 0.25", "RADIUS = 0.3"), {"constant", "calls"}),
        (("values.py", "RADIUS = 0.25", "RADIUS = np.float32(0.25)"), {"constant", "calls"}),
        (("helpers.py", "return x + by", "return x - by"), {"calls"}),
        (("helpers.py", "by=1.0", "by=1.5"), {"calls"}),
        (("helpers.py", "by=1.0", "by=1"), {"calls"}),
        (("values.py", "NAMES = (1, 2.0)", "NAMES = (2, 2.0)"), {"frozen"}),
        (("values.py", "[1.0, 2.0]", "[1.0, 3.0]"), {"frozen"}),
        (("values.py", "np.array([1.0, 2.0])", "np.array([1.0, 2.0], np.float32)"), {"frozen"}),
        (("values.py", "GHOST = 2", "GHOST = 3"), {"frozen"}),
        (("values.py", '("y", np.float64)', '("y", np.float32)'), {"made"}),
        (("values.py", '("x", np.float64), ("y", np.float64)', '("y", np.float64), ("x", np.float64)'), {"made"}),
        (("values.py", "left: float\n    right: float", "right: float\n    left: float"), {"pair"}),
        (("operations.py", "SHIFT = 1", "SHIFT = 2"), {"operates"}),
        (("operations.py", "builder.shl(", "builder.lshr("), {"operates"}),
        (("operations.py", "_made(10)", "_made(11)"), {"operates"}),
        (("kernels.py", "x * 2.0 for", "x * 3.0 for"), {"inner_loop"}),
    ],
)
def test_edit_changes_keys_of_kernels_that_reach_it(
    edit: tuple[str, str, str], others: set[str], tmp_path: Path
) -> None:
    assert changed(tmp_path, edit) == others


@pytest.mark.parametrize(
    "edit",
    [
        ("values.py", "UNREACHED = 1", "UNREACHED = 2"),
        ("values.py", '"""Constants."""', '"""Other words."""\n\n# a comment\n'),
        ("helpers.py", "def not_called(x):\n    return x", "def not_called(x):\n    return x + 1"),
        ("helpers.py", "return [not_called]", "return []"),
        ("kernels.py", "import numpy as np\n", "import numpy as np\n\n\n# Each function is some lines further down.\n"),
    ],
)
def test_unreached_edit_changes_no_key(edit: tuple[str, str, str], tmp_path: Path) -> None:
    assert changed(tmp_path, edit) == set()


def test_other_compiler_options_have_another_key() -> None:
    def half(x: float) -> float:
        return x * 0.5

    assert kernel_key.kernel_key(njit(half)) != kernel_key.kernel_key(njit(half, fastmath=True))


def test_unknown_content_gives_no_key(tmp_path: Path) -> None:
    module = loaded(write(tmp_path / "plain"))
    for value in ([1, 2], {"a": 1}, object(), np.array([object()]), Path("here")):
        vars(sys.modules["sample.operations"])["SHIFT"] = value
        kernel_key.forget()
        with pytest.raises(kernel_key.UnknownContent):
            kernel_key.kernel_key(module.operates)
    late = "    return builder.shl", "    from .values import RADIUS\n    return builder.shl"
    module = loaded(write(tmp_path / "late", {"operations.py": late}))
    with pytest.raises(kernel_key.UnknownContent, match="imports"):
        kernel_key.kernel_key(module.operates)


def test_constant_slices_have_different_keys(tmp_path: Path) -> None:
    """Slices are constants from Python 3.14 on."""
    kernel, found = loaded(write(tmp_path)).calls, []
    code = kernel.py_func.__code__
    for one in (slice(None), slice(1), slice(1, None), slice(None, None, 1), slice(1.0), slice(1.0)):
        kernel.py_func.__code__ = code.replace(co_consts=(*code.co_consts, one))
        kernel_key.forget()
        found.append(kernel_key.kernel_key(kernel))
    assert len(set(found)) == 5
    assert found[-1] == found[-2]


def test_profiler_changes_no_key(tmp_path: Path) -> None:
    module = loaded(write(tmp_path))
    before = kernel_key.kernel_key(module.calls)
    module.calls(1.0)
    assert calls_of(lambda: module.calls(1.0)) > 0
    kernel_key.forget()
    assert kernel_key.kernel_key(module.calls) == before


# The package's own kernels


def package_kernels() -> dict[str, Dispatcher]:
    """All kernels, by module and name, rules that were compiled among them."""
    found: dict[str, Dispatcher] = {}
    waiting: list[Any] = []
    for room in ROOMS:
        for module in pkgutil.walk_packages([str(PACKAGE / room)], f"pacman_env.{room}."):
            waiting += vars(importlib.import_module(module.name)).values()
    for one in waiting:  # grows meanwhile
        if isinstance(one, Dispatcher) and (name := f"{one.py_func.__module__}.{one.__qualname__}") not in found:
            found[name] = one
            waiting += one.py_func.__globals__.values()
    return found


def test_every_kernel_has_its_own_key() -> None:
    named = {name: kernel_key.kernel_key(kernel) for name, kernel in package_kernels().items()}
    assert len(named) > 150
    assert len(set(named.values())) == len(named)


def test_every_constant_read_is_in_the_key(monkeypatch: pytest.MonkeyPatch) -> None:
    """Found here by disassembling, which the keys do without."""
    read = 0
    for name, kernel in package_kernels().items():
        known = kernel.py_func.__globals__
        constants = {
            instruction.argval
            for instruction in dis.get_instructions(kernel.py_func)
            if instruction.opname == "LOAD_GLOBAL" and isinstance(known.get(instruction.argval), int | float)
        }
        before = kernel_key.kernel_key(kernel)
        for constant in sorted(constants):
            with monkeypatch.context() as patched:
                patched.setitem(known, constant, known[constant] + 1)
                kernel_key.forget()
                assert kernel_key.kernel_key(kernel) != before, f"{name}: {constant}"
            read += 1
        kernel_key.forget()
    assert read > 200


def test_keys_are_equal_in_another_process(tmp_path: Path) -> None:
    """Edits outside of kernels change no key either."""
    shutil.copytree(PACKAGE, tmp_path / "pacman_env", ignore=shutil.ignore_patterns("__pycache__"))
    for path in ("game/lights.py", "game/sounds.py", "policies/base.py"):
        with (tmp_path / "pacman_env" / path).open("a") as file:
            file.write("\n_ADDED = 1\n")
    sections = tmp_path / "pacman_env" / "config" / "sections.py"
    field = "    pickup_radius_m: Positive = "
    sections.write_text(sections.read_text().replace(field, f"    added_m: Positive = 1.0\n{field}"))
    program = """
import pacman_env
from pacman_env.engine.kernel_key import kernel_key
from pacman_env.sim.core.ticks import play
print(pacman_env.__file__, kernel_key(play))
"""
    environment = {**os.environ, "PYTHONPATH": str(tmp_path), "PYTHONHASHSEED": "1"}  # sets are ordered by hashes
    found = []
    for level in "3", "1":  # Numba's own, and another one
        command = [sys.executable, "-c", program]
        out = subprocess.check_output(command, cwd="/", env={**environment, "NUMBA_OPT": level}, text=True)
        found.append(out.split())
    assert found[0] == [str(tmp_path / "pacman_env" / "__init__.py"), kernel_key.kernel_key(play)]
    assert found[1][1] != found[0][1]  # compiled in another way


def test_package_extends_numba_only_by_intrinsics() -> None:
    """Intrinsics and types are followed; an ``overload`` would be reached by no name."""
    allowed = {"intrinsic", "models", "register_model"}
    for path in PACKAGE.rglob("*.py"):
        text = path.read_text()
        for names in re.findall(r"from numba\.(?:core\.)?extending import ([^\n(]+)", text):
            used = {name.strip() for name in names.partition("#")[0].split(",")}
            assert used <= allowed | ({"_Intrinsic"} if path.name == "kernel_key.py" else set()), path
        assert not re.search(
            r"numba\.extending import \(|import numba\.extending|numba\.extending\.|lower_builtin", text
        ), path
