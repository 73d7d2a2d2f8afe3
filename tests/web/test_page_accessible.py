"""The operator's page for all users: axe-core, keyboard, names, both themes, a phone."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tests.web.browser import Visitor

Visit = Callable[..., Visitor]
TABS = ("game", "play", "why", "rounds", "show", "ready")
RUN = """async () => {
  const {violations, passes} = await axe.run(document);
  if (passes.length < 20) return [`only ${passes.length} rules were tried`];
  return violations.filter(({impact}) => impact === 'serious' || impact === 'critical')
    .map(({id, help, nodes}) => `${id}: ${help}: ${nodes.map(({target, any}) =>
      `${target.join(' ')} ${any[0]?.message ?? ''}`).join('; ')}`);
}"""


@pytest.mark.parametrize(
    ("width", "scheme"),
    [  # each width and each theme is always judged
        *((390, "dark"), (1280, "light")),
        *(pytest.param(*one, marks=pytest.mark.daily) for one in ((390, "light"), (1280, "dark"))),
    ],
)
def test_axe_finds_nothing_serious(visit: Visit, axe: str, width: int, scheme: str) -> None:
    page = visit(color_scheme=scheme, viewport={"width": width, "height": 844})
    page.page.evaluate(axe)
    page.slide("speed", 10)
    found = {}
    for tab in TABS:
        page.press(f"tab-{tab}")
        if tab == "game":
            page.page.click("#settings summary")
            page.page.click("#upload summary")
        elif tab == "play":
            page.page.click("[data-role=robot]")
            page.wait("state.role === 'robot'")
            if not page.page.is_visible("#panel-play"):  # on a phone the panel makes room for the map
                page.press("tab-play")
            page.page.click("[data-role=robot]")
            page.wait("state.role === 'none'")
        elif tab == "why":
            page.press("start")
            page.wait("state.frame.state === 'running' && document.querySelector('#why-table tbody tr')")
        elif tab == "rounds":
            page.slide("speed", 50)
            page.wait("document.querySelector('#stories li button')")
            page.page.locator("#stories li button").first.click()
            page.wait("state.story")
            page.wait("!document.querySelector('.notice')", "notices are gone")
        elif tab == "ready":
            page.wait("document.querySelector('#ready li')")
        if serious := page.page.evaluate(RUN):
            found[tab] = serious
    page.press("stop")
    page.wait("state.frame.stopped")
    if serious := page.page.evaluate(RUN):
        found["stopped"] = serious
    assert not found


def test_all_is_reached_by_keyboard(visit: Visit) -> None:
    page = visit()
    seen = []
    for _ in range(60):
        page.page.keyboard.press("Tab")
        focus = page.value(
            "(() => { const one = document.activeElement, style = getComputedStyle(one); return [one.id ||"
            "one.getAttribute('aria-label') || one.tagName, style.outlineStyle !== 'none']; })()"
        )
        if focus[0] == "BODY":
            break
        assert focus[1], f"the focus on {focus[0]} is not seen"
        seen.append(focus[0])
    first = ["lease-take", "sound", "theme", "stop", "top", "zoom-in", "zoom-out", "fit", "follow", "layers"]
    assert seen[: len(first)] == first
    assert {"start", "pause", "reset", "speed", "tab-game", "setup-map", "setup-start"} <= set(seen)
    page.page.focus("#tab-game")
    page.page.keyboard.press("ArrowRight")
    assert page.page.is_visible("#panel-play")
    assert page.value("document.activeElement.id") == "tab-play"


def test_every_control_has_a_name_and_is_large_enough(visit: Visit) -> None:
    page = visit(viewport={"width": 390, "height": 844}, has_touch=True)
    for tab in TABS:
        page.press(f"tab-{tab}")
        small = page.value(
            "[...document.querySelectorAll('button, select, input:not([type=checkbox]), summary')]"
            ".filter((one) => one.checkVisibility() && !one.closest('#why-table'))"
            ".map((one) => [one.id || one.textContent, one.getBoundingClientRect()])"
            ".filter(([, box]) => box.height < 43.5 || box.width < 43.5).map(([name]) => name)"
        )
        assert not small, (tab, small)
    unnamed = page.value(
        "[...document.querySelectorAll('button')].filter((one) => !(one.ariaLabel || one.textContent.trim()))"
        ".map((one) => one.outerHTML)"
    )
    assert not unnamed


def test_dark_and_light(visit: Visit) -> None:
    page = visit(color_scheme="light")
    background = "getComputedStyle(document.body).backgroundColor"
    light = page.value(background)
    page.press("theme")
    dark = page.value(background)
    assert light != dark
    page.open()
    assert page.value(background) == dark, "the choice is kept"
