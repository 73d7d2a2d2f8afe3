"""The operator's page for all users: axe-core, keyboard, names, both themes, forced colours, phones, older browsers."""

import re
from collections.abc import Callable

import pytest

from pacman_env.web.access import Tokens
from pacman_env.web.routes import STATIC
from pacman_env.web.server import WebServer
from pacman_env.web.simulated import SimulatedGame
from tests.web.browser import Visitor

Visit = Callable[..., Visitor]
TABS = ("game", "play", "why", "rounds", "show", "ready")
RUN = """async () => {
  const {violations, passes} = await axe.run(document);
  if (passes.length < 20) return [`only ${passes.length} rules were tried`];
  return violations.map(({id, help, nodes}) => `${id}: ${help}: ${nodes.map(({target, any}) =>
      `${target.join(' ')} ${any[0]?.message ?? ''}`).join('; ')}`);
}"""

#: Names of controls that a finger may miss.
SMALL = (
    "[...document.querySelectorAll('button, select, input:not([type=checkbox]), summary')]"
    ".filter((one) => one.checkVisibility() && !one.closest('#why-table'))"
    ".map((one) => [one.id || one.textContent, one.getBoundingClientRect()])"
    ".filter(([, box]) => box.height < 43.5 || box.width < 43.5).map(([name]) => name)"
)
SERIOUS = RUN.replace("violations.", "violations.filter(({impact}) => ['serious', 'critical'].includes(impact)).")

#: What browsers lack that are older than those of docs/web.md, or as old: as far as it can be taken away.
OLDER = """
for (const [owner, names] of [
  [Array.prototype, 'findLast findLastIndex toSorted toReversed toSpliced with'], [Array, 'fromAsync'],
  [Object, 'hasOwn groupBy'], [Map, 'groupBy'], [Promise, 'withResolvers try'], [URL, 'canParse parse'],
  [URLSearchParams.prototype, 'size'], [AbortSignal, 'any timeout'],
  [window, 'OffscreenCanvas structuredClone Iterator'],
]) for (const name of names.split(' ')) delete owner[name];
for (const name of ['localStorage', 'sessionStorage']) Object.defineProperty(window, name, {get() {
  throw new DOMException('denied', 'SecurityError');
}});
window.WebSocket = class extends WebSocket { constructor(url) {
  if (!/^wss?:/.test(url)) throw new SyntaxError(`The URL '${url}' is invalid.`);
  super(url);
} };
"""
#: What is newer than the browsers of docs/web.md.
NEWER = (
    r"\.(findLast|toSpliced|toSorted|toReversed|groupBy|withResolvers|hasOwn|showPopover)\(|structuredClone|OffscreenCanvas"
    r"|Params\(.*\)\.size|\(\?<[=!]|light-dark\(|:has\(|color-mix\(|@(container|layer|scope|starting-style|property)"
)


@pytest.mark.parametrize(
    ("width", "scheme"),
    [  # each width and each theme is always judged
        *((390, "dark"), (1280, "light")),
        *(pytest.param(*one, marks=pytest.mark.daily) for one in ((390, "light"), (1280, "dark"))),
    ],
)
def test_axe_finds_no_accessibility_fault(visit: Visit, axe: str, width: int, scheme: str) -> None:
    page = visit(first=True, color_scheme=scheme, viewport={"width": width, "height": 844}, has_touch=width < 800)
    page.page.evaluate(axe)
    page.page.wait_for_selector("#welcome:visible")
    found = {"first visit": violations} if (violations := page.page.evaluate(RUN)) else {}
    page.press("welcome-close")
    page.slide("speed", 8)  # while no panel hides it on a phone
    for tab in TABS:
        page.press(f"tab-{tab}")
        assert width > 800 or not page.value(SMALL)
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
            page.wait("document.querySelector('#stories li button')")
            page.page.wait_for_selector("#end:visible")
            if violations := page.page.evaluate(RUN):
                found["end of a round"] = violations
            page.page.locator("#stories li button").first.click()
            page.wait("state.story")
            page.wait("!document.querySelector('.notice')", "notices are gone")
        elif tab == "ready":
            page.wait("document.querySelector('#ready li')")
        if violations := page.page.evaluate(RUN):
            found[tab] = violations
    page.press("stop")
    page.wait("state.frame.stopped")
    if violations := page.page.evaluate(RUN):
        found["stopped"] = violations
    assert not found


def test_controls_are_reached_by_keyboard(visit: Visit) -> None:
    page = visit(first=True)
    page.page.wait_for_selector("#welcome:visible")
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
    card = ["welcome-close", "play", "play-clyde", "watch", "play-sound"]
    first = ["lease-take", "sound", "theme", "stop", "top", *card, "zoom-in", "zoom-out", "fit", "follow", "layers"]
    assert seen[: len(first)] == first
    assert {"start", "pause", "reset", "speed", "tab-game", "setup-map", "setup-start"} <= set(seen)
    page.page.focus("#tab-game")
    page.page.keyboard.press("ArrowRight")
    assert page.page.is_visible("#panel-play")
    assert page.value("document.activeElement.id") == "tab-play"


def test_chosen_theme_is_kept_after_reload(visit: Visit) -> None:
    page = visit(color_scheme="light")
    background = "getComputedStyle(document.body).backgroundColor"
    light = page.value(background)
    page.press("theme")
    dark = page.value(background)
    assert light != dark
    page.open()
    assert page.value(background) == dark, "the choice is kept"


def test_forced_colours_keep_their_meaning(visit: Visit) -> None:
    page = visit(forced_colors="active")
    page.press("tab-show", "stop", "release")
    colour = "getComputedStyle(document.querySelector('{}')).backgroundColor"
    tabs = [page.value(colour.format(f"#tab-{tab}")) for tab in TABS]
    assert [tab for tab, own in zip(TABS, tabs, strict=True) if tabs.count(own) == 1] == ["show"]
    page.page.click('[data-what="light"][data-word="pellet"]')
    led = "`rgb(${state.frame.ring[0].join(', ')})`"
    page.wait(f"state.frame.ring?.some((led) => led.some(Boolean)) && {colour.format('#ring i')} === {led}")
    page.press("tab-play")
    dots = [page.value(colour.format(f"#roles li:nth-child({k}) .dot")) for k in (1, 2)]
    assert dots[1] == page.value("`rgb(${state.hello.roles['ghost-0'].colour.join(', ')})`") != dots[0]


def test_older_browser_plays_a_round(visit: Visit, simulated: SimulatedGame) -> None:
    tokens = Tokens(operator="o" * 32, viewer="v" * 32)
    with WebServer(simulated, tokens=tokens, names=["http://127.0.0.1/pacman/"], write=lambda _: None) as server:
        page = visit(ready=False)
        page.leave()
        page.page.add_init_script(OLDER)
        page.url = f"http://127.0.0.1:{server.port}/pacman/"
        page.open(f"?token={tokens.operator}")
        page.foreign.clear()
        page.press("setup-ghost-add", "setup-only")
        page.wait("state.scene.ghosts.length === 2")
        page.page.click("[aria-label='Remove Blinky']")
        page.press("setup-only")
        page.wait("state.scene.ghosts.length === 1 && state.scene.map")
        page.slide("speed", 50)
        page.press("start", "tab-rounds")
        page.page.click("#stories li button")
        page.wait("state.story && view.bounds.join() !== '-5,-5,5,5'", "the round and the picture of the map")
        page.press("story-next", "story-next", "story-previous")
        assert page.value("state.story.index") > 0
        page.leave()


def test_page_files_use_no_newer_features_than_documented() -> None:
    for path in STATIC.rglob("*.*"):
        assert not re.search(NEWER, path.read_text()), path.name


@pytest.mark.parametrize(
    ("script", "file", "named"),
    [
        ("delete window.WebSocket", None, "WebSocket"),
        ("HTMLCanvasElement.prototype.getContext = () => null", None, "null"),
        ("", ("map.js", {"content_type": "text/javascript", "body": "new class { +"}), "SyntaxError"),
        ("", ("style/base.css", {"status": 404}), "base.css"),
        ("", ("view.js", {"status": 404}), "main.js"),
    ],
)
def test_page_says_why_it_cannot_start(
    visit: Visit, script: str, file: tuple[str, dict[str, object]] | None, named: str
) -> None:
    page = visit(ready=False, allowed=("",))
    page.leave()
    page.page.add_init_script(script)
    if file is not None:
        page.page.route(f"**/static/{file[0]}", lambda route: route.fulfill(**file[1]))
    page.open(ready=False)
    page.page.wait_for_selector("#unsupported")
    assert named in page.text("unsupported")
    assert page.text("state") != "Connecting"
