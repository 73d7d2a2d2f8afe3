"""The page as a game, in a real browser: power pellets and what the page says of them."""

from collections.abc import Callable

import pytest

from pacman_env.web import page_messages as m
from pacman_env.web.simulated import SimulatedGame
from tests.web.browser import Visitor
from tests.web.test_caught_ghosts import SETTINGS, places_on_the_way

Visit = Callable[..., Visitor]
FASTEST = 50


def test_caught_ghost_is_eyes_that_return(visit: Visit, simulated: SimulatedGame) -> None:
    simulated.handle("nobody", m.Setup(map="loop", policy="nearest", ghosts=("wander", "wander"), settings=SETTINGS))
    facts = simulated.scene().facts
    for ghost, (x, y) in enumerate(places_on_the_way(facts["pellets"], facts["home"][:2])):
        simulated.handle("nobody", m.PlaceClyde(x=x, y=y, ghost=ghost))
    page = visit()
    page.press("key")
    names = page.page.locator("#guide-key li").all_text_contents()
    assert sum("power pellet" in name or "frightened" in name for name in names) == 2
    page.press("guide-close")
    assert page.text("caught") == "0"
    page.slide("speed", 3)  # at a higher speed, a busy machine may show no frame with the points
    page.press("start")
    page.wait("state.frame.harmless_s.every((left) => left > 0)", "frightened ghosts")
    page.wait("state.frame.points.length", "points where a ghost was caught")
    ghost = page.value("state.frame.away_s.findIndex((left) => left > 0)")
    page.wait(f"state.frame.away_s[{ghost}] === 0", "the ghost starts again")
    assert int(page.text("caught")) > 0
    assert int(page.text("score")) >= 20


def test_first_visit_moves_and_plays_by_one_click(visit: Visit) -> None:
    page = visit(first=True)
    page.wait("state.demo && state.frame.state === 'menu'", "the demo moves without a click")
    first = page.value("state.demo.index")
    page.wait(f"state.demo.index > {first}")
    assert page.page.is_visible("#welcome")
    page.press("play")
    page.wait("state.frame.state === 'running'")
    assert not page.value("state.demo || state.invites")
    assert not page.page.is_visible("#welcome")
    assert page.value("[state.role, state.scene.ghosts.length, state.frame.speed]") == ["robot", 2, 3]
    assert page.value("state.scene.power.pellets.length > 0 && document.activeElement.id === 'top'")


def test_closed_card_ends_demo_until_reload(visit: Visit) -> None:
    page = visit(first=True)
    page.wait("state.demo")
    page.page.keyboard.press("Escape")
    page.wait("!state.demo && !state.frame.stopped")
    assert not page.page.is_visible("#welcome")
    page.open()
    page.wait("state.demo")


def test_demo_stands_still_if_motion_is_reduced(visit: Visit) -> None:
    page = visit(first=True, reduced_motion="reduce")
    page.page.wait_for_selector("#welcome:visible")
    page.press("play-clyde")
    page.wait("state.role === 'ghost-0' && state.frame.state === 'running'")
    assert page.value("state.demo") is None


#: Keeps what the page sends from now on.
RECORD = """() => {
  window.asked = [];
  const {send} = WebSocket.prototype;
  WebSocket.prototype.send = function (text) {
    window.asked.push(JSON.parse(text));
    send.call(this, text);
  };
}"""


def test_arrow_keys_choose_pellets_by_direction(visit: Visit) -> None:
    """The house's robot starts at the middle left; the screen shows x to the right and y up."""
    page = visit()
    page.press("tab-play")
    page.page.click("[data-role=robot]")
    page.press("start")
    page.wait("state.frame.state === 'running'")
    page.press("pause")
    page.wait("state.frame.paused")
    page.page.evaluate(RECORD)
    for key, ahead in (("ArrowRight", (1, 0)), ("ArrowDown", (0, -1)), ("ArrowUp", (0, 1))):
        page.page.keyboard.press(key)
        candidate = page.wait("asked.find((one) => one.do === 'goal')")["candidate"]
        x, y = page.value(f"state.scene.pellets[{candidate}]")
        robot = page.value("(asked.length = 0, state.frame.true)")
        assert (x - robot[0]) * ahead[0] + (y - robot[1]) * ahead[1] > 0
    page.page.keyboard.press("w")
    page.wait("asked.some((one) => one.do === 'drive' && one.v > 0)", "steering by hand has its own key")


def test_escape_stops_robot_even_if_card_is_open(
    visit: Visit, simulated: SimulatedGame, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(simulated, "source", "ros")
    page = visit()
    page.page.keyboard.press("?")
    page.page.wait_for_selector("#guide:visible")
    page.page.keyboard.press("Escape")
    page.wait("state.frame.stopped")


def test_round_of_person_is_shared_and_tried_again(visit: Visit, simulated: SimulatedGame) -> None:
    simulated.handle("nobody", m.Setup(map="loop", ghosts=("chase",), clyde_mps=0.8, settings={}))
    page = visit()
    page.press("tab-play")
    page.page.click("[data-role=robot]")
    page.slide("speed", 10)
    page.press("start")
    page.wait("state.frame.state === 'running'")
    page.page.keyboard.press("1")
    page.page.wait_for_selector("#end-share:visible")
    page.press("end-share")
    page.wait("location.hash.includes('moves=')")
    link, entry = page.value("location.hash"), page.value("document.querySelector('#result').textContent")
    page.press("tab-rounds")
    page.page.locator("#stories li button").first.click()
    page.wait("state.story")
    trail = page.value("state.story.frames.map((one) => one.true)")
    with page.page.expect_download() as download:
        page.press("story-save")
    page.press("story-next")
    moment = page.value("state.story.frames[state.story.index].time_s")
    page.press("story-again")
    page.wait("!state.story && state.role === 'robot' && ['starting', 'running'].includes(state.frame.state)")
    assert page.value("state.frame.time_s") >= moment
    page.reset()
    page.leave()
    other = visit(link)
    other.wait("state.story", "a person's round in another browser")
    assert other.value("state.story.frames.map((one) => one.true)") == trail
    other.page.wait_for_selector("#end:visible")
    assert other.text("result").split(":")[0] != entry
    other.press("story-close")
    other.page.set_input_files("#story-file", download.value.path())
    other.wait("state.story", "a file")
    assert other.value("state.story.frames.map((one) => one.true)") == trail


def test_end_card_leads_on(visit: Visit) -> None:
    page = visit()
    page.slide("speed", FASTEST)
    page.press("start")
    page.page.wait_for_selector("#end-moment:visible")
    won = page.value("document.querySelector('#end').dataset.won")
    assert ("Best time" in page.text("end-best")) == (won == "true")
    page.press("end-compare")
    page.wait("/clyde_aware: .* after/.test(document.querySelector('#end-other').textContent)")
    page.press("end-moment")
    page.wait("state.story && state.story.index > 0", "the moment is played")
    assert page.value("Number(document.querySelector('#story-speed').value)") <= 1, "not in one second"
    assert not page.page.is_visible("#end")
    page.press("story-close")
    page.reset()
    page.press("start")
    page.page.wait_for_selector("#end-again:visible")
    story = page.page.locator("#stories li").first.text_content()
    page.press("end-again")
    page.wait("state.frame.state === 'running'")
    assert f"seed {page.value('state.scene.seed')} " in story


def test_phone_shows_half_map_beside_replay_and_reasons(visit: Visit, simulated: SimulatedGame) -> None:
    simulated.handle("nobody", m.Setup(finish=True))
    page = visit(viewport={"width": 390, "height": 844}, has_touch=True)
    page.wait("view.bounds.join() !== '-5,-5,5,5'", "the picture of the map")
    assert page.value("view.turn > 0"), "a plan that is wider than high stands upright"
    x, y = page.value("state.scene.pellets[7]")
    assert page.value(f"view.toWorld(...view.toScreen({x}, {y}))") == pytest.approx([x, y])
    page.press("tab-rounds")
    page.page.locator("#stories li button").click()
    page.wait("state.story")
    page.press("tab-why")
    page.wait("document.querySelector('#why-table tbody tr')")
    top, bar = page.value(
        "['map', 'story-bar'].map((name) => document.getElementById(name).getBoundingClientRect().top)"
    )
    assert bar - top >= 422


def test_phone_shows_half_map_beside_panels_of_live_round(visit: Visit) -> None:
    page = visit(viewport={"width": 390, "height": 844}, has_touch=True)
    page.press("start")
    page.wait("state.frame.state === 'running'")
    for tab in ("play", "why", "rounds", "show", "ready", "game"):
        page.press(f"tab-{tab}")
        assert page.page.locator("#map").bounding_box()["height"] >= 422, tab
        assert page.page.is_visible(f"#panel-{tab}")
        assert page.value("view.turn > 0")
    for button in ("start", "pause", "reset", "stop"):
        x, y, width, height = page.page.locator(f"#{button}").bounding_box().values()
        at = f"{x + width / 2}, {y + height / 2}"
        assert page.value(f"document.elementFromPoint({at}).closest('button').id") == button


def test_key_has_no_power_pellets_if_game_has_none(visit: Visit) -> None:
    page = visit()
    page.page.keyboard.press("?")
    assert not any("frightened" in name for name in page.page.locator("#guide-key li").all_text_contents())
    assert not page.page.is_visible("#caught")


ENDED = """async ([role, holder, frame, entry]) => {
  const {state} = await import("./static/page.js");
  const {showResult} = await import("./static/end.js");
  const now = state.frame;
  state.role = role;
  state.people = {...state.people, operator: holder, roles: {robot: "ann"}};
  for (const one of frame) state.emit("frame", state.frame = {...now, lives: undefined, ...one});
  showResult({result: "caught", policies: ["ppo", "nearest"], story: 1, time_s: 9, collected: 2, spawned: 9, ...entry});
  const seen = [...document.querySelectorAll("#end [id]")].filter((one) => one.offsetParent).map((one) => one.id);
  return [document.getElementById("end-next").dataset.starts, document.getElementById("end-next").textContent.trim(),
    document.getElementById("end-other").textContent, seen];
}"""
SECOND = {"result": "caught", "collected": 1, "time_s": 5}
PERSON = {"player": "person", "second": SECOND}
HOME = {"state": "menu", "round": 1, "lives": 3}
WON, LOST, OVER = (
    {"state": state, "round": 2, "lives": n} for state, n in (("complete", 3), ("dying", 1), ("dying", 0))
)
POLICY = {"state": "dying", "round": 2}
GHOST = {"player": "policy", "ghosts_played": [0]}
ALWAYS = {"result", "end-moment", "end-share", "end-close"}
#: Role, person in control, frames until the end of the round, changes of the finished round; then what the main button
#: starts, and further parts of the card.
ENDS = {
    "level won": (
        "robot",
        None,
        [WON],
        {**PERSON, "result": "complete"},
        "level",
        {"end-next", "end-again", "end-other"},
    ),
    "level lost": ("robot", None, [LOST], PERSON, "retry", {"end-next", "end-again", "end-lives", "end-other"}),
    "game lost": ("robot", None, [OVER, HOME], PERSON, "game", {"end-next", "end-again", "end-lives", "end-other"}),
    "level of another": ("none", "ann", [LOST], PERSON, "round", {"end-lives", "end-other"}),
    "ghost of another's game": ("ghost-0", "ann", [LOST], {**GHOST, **PERSON}, "round", {"end-lives", "end-other"}),
    "ghost": ("ghost-0", None, [POLICY], GHOST, "round", {"end-next", "end-again"}),
    "policy": ("none", None, [POLICY], {"player": "policy"}, "round", {"end-next", "end-again", "end-compare"}),
}


def test_end_card_fits_role_and_level(visit: Visit) -> None:
    page = visit()
    for name, (role, holder, frames, entry, starts, parts) in ENDS.items():
        got, button, other, seen = page.page.evaluate(ENDED, [role, holder, frames, {"ghosts_played": [], **entry}])
        assert (got, set(seen) - {"end-best"}) == (starts, ALWAYS | parts), name
        assert ("3" in button) == (name == "level won"), "the next level is named before the robot is home"
        assert ("ann" in other) == (role != "robot" and "second" in entry), name


def test_end_card_shows_when_completed_robot_drives_home(
    visit: Visit, simulated: SimulatedGame, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(simulated, "source", "ros")
    page = visit()
    frames = "['running', 'returning_home'].map((now) => ({...state.frame, state: now, collected: 9, spawned: 9}))"
    page.value(f"{frames}.forEach((one) => state.emit('frame', one))")
    assert page.page.get_attribute("#end", "data-won") == "true"
    assert page.page.is_visible("#end")


def test_request_for_control_is_refused_by_operator(visit: Visit) -> None:
    holder, other = visit(), visit(viewport={"width": 844, "height": 390})
    holder.press("lease-take")
    name = holder.value("state.hello.you")
    other.wait(f"document.querySelector('#hint').textContent.includes('{name}')", "why Start cannot be pressed")
    other.press("tab-play")
    other.page.click("[data-role=ghost-0]")
    other.wait("state.role === 'ghost-0'")
    assert "Start" not in other.text("mode")
    other.press("lease-ask")
    holder.page.click(".notice[data-key=asking] button >> nth=1")
    other.page.wait_for_selector(".notice[data-key=kept]")
    assert other.page.is_visible("#lease-ask")
    other.value("document.querySelector('#state').textContent = 'Preparing the next round'")
    assert other.page.locator("#stop").bounding_box()["x"] + 100 <= 844
