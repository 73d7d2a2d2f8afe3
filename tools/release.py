"""Write the version of a release and today's date into all files: ``python -m tools.release 0.24.0``."""

import datetime
import re
import sys
from collections.abc import Iterator
from pathlib import Path

from pacman_env.command_line.command import Parser, run_command
from pacman_env.config.validation import require
from tools.common import ROOT, update


def texts(version: str, date: str) -> Iterator[tuple[Path, str]]:
    """Yield the files that contain the version, and their texts for a version and its date; ValueError if invalid."""
    require(bool(re.fullmatch(r"\d+\.\d+\.\d+", version)), "version", version, "must be three numbers such as 0.24.0")
    top, heading = r"## \[Unreleased\]", f"## [{version}] - {date}"
    for name, pattern, words in (
        ("pacman_env/_version.py", "__version__ = .*", f'__version__ = "{version}"'),
        ("package.xml", "<version>.*</version>", f"<version>{version}</version>"),
        ("CITATION.cff", "\nversion: .*\ndate-released: .*", f"\nversion: {version}\ndate-released: {date}"),
        ("CHANGELOG.md", rf"{top}(\n\n## \[{version}\].*)?", f"## [Unreleased]\n\n{heading}"),
    ):
        yield ROOT / name, re.sub(pattern, words, (ROOT / name).read_text(encoding="utf-8"), count=1)


if __name__ == "__main__":
    parser = Parser(prog="python -m tools.release", description="Write the version of a release into all files.")
    parser.add_argument("version", metavar="X.Y.Z")
    today = str(datetime.date.today())
    sys.exit(
        run_command(parser, None, lambda given: max(update(*one, False, "") for one in texts(given.version, today)))
    )
