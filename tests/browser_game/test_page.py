"""The page without a server: it moves at once, plays rounds, and requests nothing from other hosts."""

import shutil
from pathlib import Path
from typing import Any

from tests.web.browser import Visitor
from tools.browser_game import page


def test_page_shows_demo_and_plays_round_to_its_end(browser_game: Path, game_url: str, chromium: Any) -> None:
    page.write(browser_game / "play", ["house"])
    for name in ("game.wasm.bin", "network.bin", "maps/house.bin", "maps/house.png"):
        (browser_game / "play" / "game" / "maps").mkdir(exist_ok=True)
        shutil.copy(browser_game / name, browser_game / "play" / "game" / name)
    with chromium.new_page() as tab:
        visitor = Visitor(tab, f"{game_url}play/", first=True).watch().open()
        visitor.wait("state.demo?.index > 0", "the demo")
        visitor.press("play")
        visitor.wait("state.role === 'robot' && state.frame.state === 'running' && state.frame.time_s > 1")
        visitor.reset()
        visitor.press("place")
        x, y = visitor.value("state.frame.true.slice(0, 2)")
        visitor.click_at(x + 0.1, y)
        visitor.wait("!state.placing", "the ghost is at the robot")
        visitor.press("start")
        visitor.wait("state.frame.state === 'dying' && !document.querySelector('#end').hidden", "the robot is caught")
        assert visitor.text("result").startswith("Caught by Clyde")
        visitor.check()
