"""A small package of kernels that tests write somewhere, edit and call in another process."""

from collections.abc import Mapping
from pathlib import Path

FILES = {
    "__init__.py": "",
    "helpers.py": """
from pacman_env.engine.jit import kernel

RADIUS = 0.25

@kernel
def grown(x, by=1.0):
    return x + by + RADIUS
""",
    "kernels.py": """
import sys
from numba.core import event
from pacman_env.engine.jit import kernel
from pacman_env.rng import mix
from . import helpers

@kernel
def constant(x):
    return x * helpers.RADIUS

@kernel
def calls(x):
    return helpers.grown(x) + helpers.grown(x, 2.0)

class Compiled(event.Listener):
    names = []
    def on_start(self, event):
        self.names.append(event.data["dispatcher"].__name__)
    def on_end(self, event):
        pass

if __name__ == "__main__":
    event.register("numba:compile", Compiled())
    print(constant(2.0), calls(1.0), kernel(mix)(0))
    print(*sorted(Compiled.names))
""",
}


def write(folder: Path, edits: Mapping[str, tuple[str, str]] | None = None) -> Path:
    """Write the package below ``folder``, one text per file of ``edits`` replaced by another; return ``folder``."""
    package = folder / "sample"
    package.mkdir(parents=True, exist_ok=True)
    for name, text in FILES.items():
        before, after = (edits or {}).get(name, ("", ""))
        assert before in text
        if not (package / name).exists() or before:  # the time of a file that stays does not change
            (package / name).write_text(text.replace(before, after) if before else text)
    return folder
