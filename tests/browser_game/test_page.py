"""The page without a server: it moves at once, plays rounds, and requests nothing from other hosts."""

from typing import Any

from tests.web.browser import Visitor


def test_page_shows_demo_and_plays_round_to_its_end(game_url: str, chromium: Any) -> None:
    with chromium.new_page() as tab:
        visitor = Visitor(tab, game_url, first=True).watch().open()
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
