"""Write the sources of the site for Sphinx, as ``scripts/docs`` does: ``python -m tools.site FOLDER``.

They are a copy of docs/ with dark pictures, films of the ids and the pages at the top of the checkout, next to links to
the sources that pages refer to.
"""

import re
import shutil
import sys
from pathlib import Path

from pacman_env.envs.registration import IDS
from tools import gallery, ids, replay
from tools.common import ROOT, SUFFIXES

_DARK = {  # the colours of diagrams in the dark theme
    "#1b1f24": "#eef1f8", "#57606a": "#a7b1c6", "#ffffff": "#0d1018", "#d0d7de": "#3b465f", "#f6f8fa": "#161b28",
    "#fff7d6": "#33290c", "#b38600": "#ffd54a", "#e7f0ff": "#1b2947", "#2f6fd0": "#7fa9ff", "#e9f7ec": "#12301d",
    "#2f8f4e": "#63d38f",
}  # fmt: skip


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
    for name in gallery.PICTURES:
        gallery.save(name, source / "images" / f"{name}{SUFFIXES['dark']}.png", "dark")
    for path in (ROOT / "docs" / "images").glob("*.svg"):
        text = re.sub("#[0-9a-f]{6}", lambda colour: _DARK[colour[0]], path.read_text(encoding="utf-8"))
        (source / "images" / f"{path.stem}{SUFFIXES['dark']}.svg").write_text(text, encoding="utf-8")
    for env_id in IDS:
        ids.write(env_id, source / "environments" / "ids")
    replay.write(source / "_static")


if __name__ == "__main__":
    assemble(Path(sys.argv[1]))
