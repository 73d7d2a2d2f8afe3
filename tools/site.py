"""Build the site, offline, with warnings as errors: ``scripts/docs``, ``python -m tools.site`` (extra ``docs``).

Sphinx reads a copy of docs/ in build/site, beside links to the sources that pages point to. The pages of the ids and
those at the top of the checkout are added to the copy.
"""

import argparse
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

from pacman_env.cli.command import Parser, run_command
from pacman_env.envs.registration import IDS
from tools import ids
from tools.common import ROOT


def assemble(build: Path) -> Path:
    """Write the folder that Sphinx reads anew."""
    source = build / "docs"
    shutil.rmtree(source, ignore_errors=True)
    shutil.copytree(ROOT / "docs", source, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pacman_env", "config", "eval", "train", "maps"):
        link = build / name
        if not link.is_symlink():
            link.symlink_to(ROOT / name)
    for name in ("CHANGELOG", "CONTRIBUTING"):
        text = (ROOT / f"{name}.md").read_text(encoding="utf-8")
        (source / f"{name.lower()}.md").write_text(text.replace("](docs/", "]("), encoding="utf-8")
    folder = source / "environments" / "ids"
    folder.mkdir()
    for env_id in IDS:
        ids.write(env_id, folder)
    return source


def main(argv: Sequence[str] | None = None) -> int:
    parser = Parser(prog="python -m tools.site", description="Build the site of the documentation, offline.")
    add, build, out = parser.add_argument, ROOT / "build" / "site", ROOT / "results" / "site"
    add("--out", type=Path, default=out, metavar="FOLDER", help="of the pages (results/site)")
    add("--build", type=Path, default=build, metavar="FOLDER", help="of what Sphinx reads and keeps (build/site)")
    return run_command(parser, argv, _build, "docs")


def _build(arguments: argparse.Namespace) -> int:
    from sphinx.cmd.build import build_main

    build = arguments.build
    build.mkdir(parents=True, exist_ok=True)
    pages = build / "html"  # myst-nb writes a folder beside it
    shutil.rmtree(pages, ignore_errors=True)
    options = ["-q", "-E", "-W", "--keep-going", "-b", "html", "-d", str(build / "doctrees")]
    status = build_main([*options, str(assemble(build)), str(pages)])
    if status == 0:
        shutil.copytree(pages, arguments.out, dirs_exist_ok=True)
        print(f"written: {arguments.out / 'index.html'}")
    return status


if __name__ == "__main__":
    sys.exit(main())
