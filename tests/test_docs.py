"""The documentation tells the truth: its Python runs, its commands exist, its links lead somewhere."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
EXAMPLES = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)


@pytest.mark.parametrize("example", EXAMPLES, ids=range(len(EXAMPLES)))
def test_readme_examples_run(example: str) -> None:
    exec(compile(example, "README.md", "exec"), {})


def test_links_lead_to_files() -> None:
    for page in PAGES:
        for target in re.findall(r"\]\(([^)#]+)\)", page.read_text()):
            if not target.startswith("http"):
                assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_commands_of_the_pages_take_their_arguments() -> None:
    commands = set()
    for page in PAGES:
        commands.update(re.findall(r"python -m (eval\.\w+)(.*)", page.read_text()))
    assert len(commands) > 5
    for module in {module for module, _ in commands}:
        help_text = subprocess.run(
            [sys.executable, "-m", module, "--help"], cwd=ROOT, capture_output=True, text=True, check=True
        ).stdout
        for other, rest in commands:
            if other == module:
                arguments = shlex.split(rest.split("`")[0].split("#")[0], posix=False)
                for option in (word for word in arguments if word.startswith("--")):
                    assert option in help_text, f"{module} {option}"


def test_no_page_has_a_gap_to_be_filled_in() -> None:
    for page in PAGES:
        assert not re.findall(r"^[A-Z]{4,}$|: [A-Z]{4,}$", page.read_text(), re.MULTILINE), page.name
