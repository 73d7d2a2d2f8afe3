"""The modules of the page that the replay of the documentation uses, in a real browser."""

from typing import Any

from tests.web.browser import chromium
from tools.bundle import bundle

__all__ = ["chromium"]


def test_bundled_modules_start_on_empty_page(chromium: Any) -> None:
    with chromium.new_context() as context:
        names = context.new_page().evaluate(f"Object.keys({bundle('map', 'why', 'player')})")
    assert {"map", "why", "player", "state", "dom"} <= set(names)
    assert not {"page", "connection", "notices"} & set(names), "these belong to one document"
