"""What part of the map the page shows, in a real browser."""

from collections.abc import Callable

import pytest

from pacman_env.web import page_messages as m
from pacman_env.web.simulated import SimulatedGame
from tests.web.browser import Visitor

Visit = Callable[..., Visitor]
#: Whether the whole map lies above an element.
ABOVE = """(([x0, y0, x1, y1]) => {
  const top = document.getElementById("map").getBoundingClientRect().top;
  const limit = document.getElementById("story-bar").getBoundingClientRect().top - top;
  return [[x0, y0], [x1, y0], [x0, y1], [x1, y1]].every(([x, y]) => view.toScreen(x, y)[1] <= limit);
})(view.bounds)"""
#: A card at the lower side that covers everything below the middle of the map, without a gap.
COVER = """(() => {
  const card = document.getElementById("end");
  card.style = "inset: 55% 0 0 0; width: auto; height: auto; max-height: none; transform: none";
  card.hidden = false;
})()"""


@pytest.mark.parametrize(("width", "height"), [(1280, 800), (390, 844)])
def test_fitted_map_stays_clear_of_cards(visit: Visit, simulated: SimulatedGame, width: int, height: int) -> None:
    simulated.handle("nobody", m.Setup(finish=True))
    page = visit(viewport={"width": width, "height": height})
    page.wait("view.bounds.join() !== '-5,-5,5,5'", "the picture of the map")
    page.press("tab-rounds")
    page.page.locator("#stories li button").click()
    page.wait("state.story")
    page.wait(f"view.fitted && view.insets.bottom > 0 && {ABOVE}")
    page.press("story-close")
    page.wait("view.fitted && view.insets.bottom === 0")


def test_zoomed_map_moves_if_card_covers_robot(visit: Visit) -> None:
    page = visit()
    page.wait("view.bounds.join() !== '-5,-5,5,5'", "the picture of the map")
    page.value("((robot) => { view.zoom(2); view.centre(...robot); view.pan(0, view.height / 4); })(state.frame.true)")
    page.value(COVER)
    page.wait("view.insets.bottom > 0")
    assert page.value("view.toScreen(...state.frame.true)") == pytest.approx(page.value("view.middle"))
    page.value("document.getElementById('end').hidden = true")
    page.wait("view.insets.bottom === 0")
    before = page.value("(view.pan(0, -view.height), view.toScreen(...state.frame.true))")
    page.value(COVER)
    page.wait("view.insets.bottom > 0")
    assert page.value("view.toScreen(...state.frame.true)") == before, "no card covers the robot"
