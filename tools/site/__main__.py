"""Build the site, offline, with warnings as errors: ``scripts/docs``, ``python -m tools.site`` (extra ``docs``).

The pages of docs/ are copied to build/site beside links to the sources that they point to, the others are written
there: ids, public names, and the pages at the top of the checkout.
"""

import argparse
import re
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

from pacman_env.cli.command import Parser, run_command
from pacman_env.envs.registration import IDS
from tools.common import ROOT
from tools.site import ids, reference

BUILD = ROOT / "build" / "site"
OUT = ROOT / "results" / "site"
_SOURCES = ("pacman_env", "config", "eval", "train", "maps")  # to which pages link
_NOT_PAGES = shutil.ignore_patterns("__pycache__", "*.pyc")


def assemble(build: Path) -> Path:
    """The folder that Sphinx reads, made anew."""
    source = build / "docs"
    shutil.rmtree(source, ignore_errors=True)
    shutil.copytree(ROOT / "docs", source, ignore=_NOT_PAGES)
    for name in _SOURCES:
        link = build / name
        if not link.is_symlink():
            link.symlink_to(ROOT / name)
    for name in ("CHANGELOG", "CONTRIBUTING"):
        text = (ROOT / f"{name}.md").read_text(encoding="utf-8")
        (source / f"{name.lower()}.md").write_text(text.replace("](docs/", "]("), encoding="utf-8")
    for path in source.rglob("*.md"):
        path.write_text(adapted(path.read_text(encoding="utf-8")), encoding="utf-8")
    index = source / "index.md"
    index.write_text(f"---\nfirstpage: true\n---\n{index.read_text(encoding='utf-8')}", encoding="utf-8")
    libraries = sorted(path.stem for path in (source / "use_with").glob("*.md") if path.stem != "README")
    _add_toctree(source / "use_with" / "README.md", libraries)
    _write_ids(source / "environments")
    names = source / "reference"
    names.mkdir()
    (names / "index.md").write_text(reference.index(), encoding="utf-8")
    for name in reference.GROUPS:
        (names / f"{name}.md").write_text(reference.page(name), encoding="utf-8")
    return source


def adapted(text: str) -> str:
    """A page without the marks that only tools read."""
    return re.sub(r"^<!-- (?:table: [\w-]+|end) -->\n", "", text, flags=re.MULTILINE)


def _write_ids(folder: Path) -> None:
    pages = folder / "ids"
    pages.mkdir()
    for env_id in IDS:
        (pages / f"{ids.file_name(env_id)}.md").write_text(ids.page(env_id, pages), encoding="utf-8")
    overview = folder / "ids.md"
    text = re.sub(r"^\| `(PacManBot\w*-v\d)` ", r"| [`\1`](ids/\1.md) ", overview.read_text(), flags=re.MULTILINE)
    overview.write_text(text, encoding="utf-8")
    _add_toctree(overview, [f"ids/{ids.file_name(env_id)}" for env_id in IDS])


def _add_toctree(page: Path, entries: Sequence[str]) -> None:
    """Pages below a page; on GitHub its links are enough."""
    listed = "\n".join(entries)
    text = page.read_text(encoding="utf-8")
    page.write_text(f"{text}\n```{{toctree}}\n:hidden:\n\n{listed}\n```\n", encoding="utf-8")


def main(argv: Sequence[str] | None = None) -> int:
    parser = Parser(prog="python -m tools.site", description="Build the site of the documentation, offline.")
    add = parser.add_argument
    add("--out", type=Path, default=OUT, metavar="FOLDER", help="of the pages (results/site)")
    add("--build", type=Path, default=BUILD, metavar="FOLDER", help="of what Sphinx reads and keeps (build/site)")
    return run_command(parser, argv, _build, "docs")


def _build(arguments: argparse.Namespace) -> int:
    from sphinx.cmd.build import build_main

    build = arguments.build
    build.mkdir(parents=True, exist_ok=True)
    source = assemble(build)
    pages = build / "html"  # myst-nb writes a folder beside it
    shutil.rmtree(pages, ignore_errors=True)
    options = ["-q", "-E", "-W", "--keep-going", "-b", "html", "-d", str(build / "doctrees")]
    status = build_main([*options, str(source), str(pages)])
    if status == 0:
        shutil.copytree(pages, arguments.out, dirs_exist_ok=True)
        print(f"written: {arguments.out / 'index.html'}")
    return status


if __name__ == "__main__":
    sys.exit(main())
