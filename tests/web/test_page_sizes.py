"""The operator's page at every size: nothing covers STOP, another control, or the robot."""

from collections.abc import Callable

import pytest

from pacman_env.web import page_messages as m
from pacman_env.web.simulated import SimulatedGame
from tests.web.browser import Visitor

#: What is wrong: names of controls that are covered or outside of the window, of what covers the robot, and of small
#: or missing STOP buttons. Lists that scroll are left out.
FAULTS = """async () => {
  for (let frames = 0; frames < 3; frames++) await new Promise(requestAnimationFrame);
  const {state, view} = window.pacman;
  const stop = document.getElementById("stop").getBoundingClientRect();
  const faults = document.documentElement.scrollWidth > innerWidth ? ["page scrolls sideways"] : [];
  if (Math.min(stop.width, stop.height) < 44) faults.push("stop is small");
  for (const one of document.querySelectorAll("button, select, input, .stick")) {
    if (!one.checkVisibility() || one.closest(".body, .side, .layers")) continue;
    const {left, top, right, bottom} = one.getBoundingClientRect();
    const [x, y] = [(left + right) / 2, (top + bottom) / 2];
    for (const at of [[x, top + 3], [x, bottom - 3], [left + 3, y], [right - 3, y]])
      if (!one.contains(document.elementFromPoint(...at))) faults.push(`${one.id} at ${at}`);
  }
  const map = document.getElementById("top").getBoundingClientRect();
  const pose = (state.story ? state.story.frames[state.story.index] : state.frame).true;
  const [x, y] = view.toScreen(...pose);
  const seen = document.elementFromPoint(map.left + x, map.top + y);
  if (seen?.id !== "top") faults.push(`robot is covered by ${seen?.id || seen?.className}`);
  return faults;
}"""
SIZES = [(390, 844)]
MORE_SIZES = [(360, 740), (667, 375), (720, 450), (1024, 768), (1440, 900)]


@pytest.mark.parametrize(
    ("width", "height"), [*SIZES, *(pytest.param(*size, marks=pytest.mark.daily) for size in MORE_SIZES)]
)
def test_page_covers_no_control_and_no_robot(
    visit: Callable[..., Visitor], simulated: SimulatedGame, width: int, height: int
) -> None:
    simulated.handle("nobody", m.Setup(finish=True))
    page = visit(first=True, viewport={"width": width, "height": height}, has_touch=width < 1100)
    page.wait("view.bounds.join() !== '-5,-5,5,5'", "the picture of the map")
    page.page.wait_for_selector("#welcome:visible")
    found = {"first visit": page.page.evaluate(FAULTS)}
    page.press("welcome-close", "layers")
    found["layers"] = page.page.evaluate(FAULTS)
    page.press("layers", "tab-play")
    page.page.click("[data-role=robot]")
    page.wait("state.role === 'robot' && !document.querySelector('.notice')")
    assert page.page.is_visible("#stick") == (width < 1100)
    found["robot"] = page.page.evaluate(FAULTS)
    page.value("document.getElementById('end').hidden = false")
    found["end of a round"] = page.page.evaluate(FAULTS)
    page.press("tab-rounds")
    page.page.locator("#stories li button").click()
    page.wait("state.story && document.querySelector('#end').hidden")
    found["replay and panel"] = page.page.evaluate(FAULTS)
    page.press("tab-rounds", "stop")
    page.wait("state.frame.stopped && !document.querySelector('.notice')")
    found["stopped"] = page.page.evaluate(FAULTS)
    assert not {name: faults for name, faults in found.items() if faults}
