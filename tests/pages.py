"""The pages of the documentation, as tests read them."""

from __future__ import annotations

import re
import textwrap
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def examples(page: Path) -> list[str]:
    """Return the blocks of Python of a page."""
    return [textwrap.dedent(found) for found in re.findall(r"```python\n(.*?)```", page.read_text(), re.DOTALL)]
