"""The pages of the documentation, as tests read them."""

import importlib.util
import re
import textwrap
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).resolve().parents[1]


def examples(page: Path) -> list[str]:
    """Return the blocks of Python of a page."""
    return [textwrap.dedent(found) for found in re.findall(r"```python\n(.*?)```", page.read_text(), re.DOTALL)]


def public_names() -> set[str]:
    """Return the names that users import, those of ``sb3`` with its name; needs Stable-Baselines3."""
    import pacman_env
    from pacman_env import sb3

    return {*pacman_env.__all__, *(f"sb3.{name}" for name in sb3.__all__)}


def loaded(path: Path) -> ModuleType:
    """Return the module of a script."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
