"""Write the sources of the site for Sphinx, as ``scripts/docs`` does: ``python -m tools.site FOLDER``.

They are a copy of docs/ with pictures of the ids and the pages at the top of the checkout, next to links to the
sources that pages refer to.
"""

import shutil
import sys
from pathlib import Path

from pacman_env.envs.registration import IDS
from tools import ids, replay
from tools.common import ROOT


def assemble(folder: Path) -> None:
    """Write the folder ``docs`` in a folder, and replace an older one."""
    source = folder / "docs"
    shutil.rmtree(source, ignore_errors=True)
    shutil.copytree(ROOT / "docs", source, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pacman_env", "config", "eval", "train", "maps"):
        if not (folder / name).is_symlink():
            (folder / name).symlink_to(ROOT / name)
    for name in ("CHANGELOG", "CONTRIBUTING"):
        text = (ROOT / f"{name}.md").read_text(encoding="utf-8")
        (source / f"{name.lower()}.md").write_text(text.replace("](docs/", "]("), encoding="utf-8")
    for env_id in IDS:
        ids.write(env_id, source / "environments" / "ids")
    replay.write(source / "_static")


if __name__ == "__main__":
    assemble(Path(sys.argv[1]))
