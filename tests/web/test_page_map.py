"""What part of the map the page shows, in a real browser."""

from collections.abc import Callable

import pytest

from tests.web.browser import Visitor

Visit = Callable[..., Visitor]
#: Whether the whole map lies in what the card leaves free, with the end of a round as the card.
CLEAR = """(([x0, y0, x1, y1]) => {
  const map = document.getElementById("map").getBoundingClientRect();
  const card = document.getElementById("end").getBoundingClientRect();
  return [[x0, y0], [x1, y0], [x0, y1], [x1, y1]].map(([x, y]) => view.toScreen(x, y))
    .every(([x, y]) => x >= 0 && y >= 0 && (x + map.left <= card.left || y + map.top <= card.top));
})(view.bounds)"""
#: Cards that cover everything below the middle of the map, without a gap.
COVER = """(() => {
  document.getElementById("end").hidden = false;
  const cards = document.getElementById("end").parentElement;
  cards.style = "position: absolute; grid-area: auto; inset: 55% 0 0 0; align-items: end";
})()"""
UNCOVER = "document.getElementById('end').parentElement.style = 'display: none'"


@pytest.mark.parametrize(("width", "height"), [(1280, 800), (390, 844)])
def test_fitted_map_stays_clear_of_cards(visit: Visit, width: int, height: int) -> None:
    page = visit(viewport={"width": width, "height": height})
    page.wait("view.bounds.join() !== '-5,-5,5,5'", "the picture of the map")
    side = "bottom" if width < 800 else "right"
    page.wait(f"view.insets.{side} < 100", "no card is open")
    before = page.value(f"view.insets.{side}")
    page.value("document.getElementById('end').hidden = false")
    page.wait(f"view.fitted && view.insets.{side} > {before} && {CLEAR}")
    page.press("end-close")
    page.wait(f"view.fitted && view.insets.{side} === {before}")


def test_zoomed_map_moves_if_card_covers_robot(visit: Visit) -> None:
    page = visit()
    page.wait("view.bounds.join() !== '-5,-5,5,5'", "the picture of the map")
    page.value("((robot) => { view.zoom(2); view.centre(...robot); view.pan(0, view.height / 4); })(state.frame.true)")
    page.value(COVER)
    page.wait("view.insets.bottom > 0")
    assert page.value("view.toScreen(...state.frame.true)") == pytest.approx(page.value("view.middle"))
    page.value(UNCOVER)
    page.wait("view.insets.bottom === 0")
    before = page.value("(view.pan(0, -view.height), view.toScreen(...state.frame.true))")
    page.value(COVER)
    page.wait("view.insets.bottom > 0")
    assert page.value("view.toScreen(...state.frame.true)") == before, "no card covers the robot"
