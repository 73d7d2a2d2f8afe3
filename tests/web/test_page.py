"""The operator's page as people use it, in a real browser over the server and the simulator."""

import gzip
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from pacman_env.config import make_config
from pacman_env.web import page_messages
from pacman_env.web.access import Tokens
from pacman_env.web.game_interface import Scene
from pacman_env.web.routes import STATIC
from pacman_env.web.server import WebServer
from pacman_env.web.simulated import SimulatedGame
from pacman_env.world.maps.occupancy import shipped_maps
from tests.web.browser import Visitor

Visit = Callable[..., Visitor]
MAPS = Path(__file__).parents[2] / "maps"
FASTEST = 50
TABS = ("play", "why", "rounds", "show", "ready", "game")
STANDS_STILL = """async () => {
  const {count} = window.pacman;
  for (let tries = 0; tries < 500; tries++) {
    const before = count.frames_drawn;
    for (let looks = 0; looks < 30; looks++) await new Promise(requestAnimationFrame);
    if (count.frames_drawn === before) return true;
  }
  return false;
}"""


def start(visitor: Visitor, speed: float = 1) -> None:
    """Begin a round of 90 s, its show in haste; what is to be seen while it runs needs a low speed."""
    visitor.slide("speed", 4)
    visitor.press("start")
    visitor.wait("state.frame.state === 'running'")
    visitor.slide("speed", speed)
    visitor.wait(f"Math.round(state.frame.speed) === {speed}")


def take_role(visitor: Visitor, role: str) -> None:
    visitor.press("tab-play")
    visitor.page.click(f"[data-role={role}]")
    visitor.wait(f"state.role === '{role}'")


def test_new_page_starts_and_follows_round(visit: Visit) -> None:
    page = visit()
    assert page.text("state") == "In the menu"
    assert "Press Start" in page.text("hint")
    page.press("tab-why")
    start(page, 3)
    assert page.text("lease-words") == "You have control"
    page.wait("state.frame.score > 1")
    assert page.page.locator("#why-table tbody tr").count() > 3
    rows = page.value(
        "[...document.querySelectorAll('#why-table tbody tr')].map((row) => [row.dataset.candidate,"
        " row.querySelector('button').textContent])"
    )
    pellets = [(candidate, text.split()[-1]) for candidate, text in rows if "Pellet" in text]
    assert pellets
    assert all(candidate == number for candidate, number in pellets)  # as in the environment and on the robot
    assert re.search(r"ppo: \w+ \d+.*clyde_aware: \w+", page.text("why-words"))
    assert re.search(r"\w+.*: .*nearest, \d+\.\d m; Clyde|waits", page.text("why-sentence"))
    page.slide("speed", FASTEST)
    page.wait("document.querySelectorAll('#stories li').length === 1", "the round has ended")
    page.wait(r"/\d+ of 13 pellets/.test(document.querySelector('#result').textContent)", "the result")
    page.wait("state.frame.state === 'menu'")
    assert page.value("count.frames_drawn") > 20


def test_round_is_paused_resumed_and_reset(visit: Visit) -> None:
    page = visit()
    x, y = page.value("state.scene.pellets[7]")
    page.press("place")
    page.click_at(x, y)
    page.wait(f"Math.hypot(state.frame.ghosts[0][0] - {x}, state.frame.ghosts[0][1] - {y}) < 0.3", "Clyde is placed")
    assert page.value("state.placing") == ""
    start(page)
    page.press("pause")
    page.wait("state.frame.paused")
    assert page.text("state") == "Paused"
    stood = page.value("state.frame.time_s")
    page.press("pause")
    page.wait(f"!state.frame.paused && state.frame.time_s > {stood}")
    assert page.page.is_disabled("#start")
    assert "Reset" in page.page.get_attribute("#start", "title")
    for button in ("reset", "setup-only"):  # each would end the round
        page.press(button, "ask-no")
    assert page.value("state.frame.state === 'running'")
    page.press("reset", "ask-yes")
    page.wait("state.frame.state === 'menu'")
    page.page.wait_for_selector("#start:enabled")


def test_event_plays_its_light_and_sound(visit: Visit) -> None:
    page = visit()
    page.press("tab-show", "sound")
    page.wait("window.pacman.sounds.on")
    words = {name: page.value(f"Object.keys(state.hello.{name}s)") for name in ("event", "light", "sound")}
    for name, shown in words.items():
        assert page.page.locator(f"#show-{name} button").count() == len(shown)
    notes = page.value("state.hello.sounds[state.hello.events.pellet.sound].length")
    page.page.locator('[data-what="event"][data-word="pellet"]').click()
    page.wait("count.lit > 0", "the light")
    page.wait(f"count.notes >= {notes}", "the notes")
    assert not page.page.is_checked("#arm")
    page.page.check("#arm")


def test_person_plays_robot_by_map_and_list(visit: Visit) -> None:
    page = visit()
    take_role(page, "robot")
    page.wait("state.frame.baseline")
    assert page.text("duel") == "Pellets: you 0, ppo 0"
    start(page)
    pellet = page.value(
        "(() => { const {frame, scene} = state; const [x, y] = frame.true; let best = -1, least = Infinity;"
        "scene.pellets.forEach(([a, b], k) => { const away = Math.hypot(a - x, b - y);"
        "if (frame.alive[k] && away < least) [best, least] = [k, away]; }); return best; })()"
    )
    page.click_at(*page.value(f"state.scene.pellets[{pellet}]"))
    page.wait(f"state.frame.goal === {pellet}")
    page.press("tab-why")
    page.page.hover("#why-table tbody button")
    page.page.mouse.down()  # the list changes meanwhile
    pellet = page.value("document.querySelector('#why-table tr:active').dataset.candidate")
    page.wait(f"state.why.time_s > {page.value('state.why.time_s')}")
    page.page.mouse.up()
    page.wait(f"state.frame.goal === {pellet}")
    page.press("tab-play")
    page.slide("speed", FASTEST)
    page.wait("document.querySelector('#end-other').textContent", "who was better")
    assert re.search(r"(You were better|ppo was better|It is a draw)\. ppo: ", page.text("end-other"))
    assert re.match(r"Pellets: you \d+, ppo \d+", page.text("duel"))
    assert page.value("document.querySelectorAll('#stories li')[0].textContent.includes('played by a person')")


def test_two_people_drive_robot_and_ghost(visit: Visit) -> None:
    robot, ghost = visit(), visit()
    take_role(robot, "robot")
    take_role(ghost, "ghost-0")
    ghost.wait("state.people.roles.robot")
    assert ghost.page.is_disabled("[data-role=robot]")
    start(robot)
    x, y, _ = robot.value("state.frame.true")
    gx, gy = ghost.value("state.frame.ghosts[0]")
    robot.page.focus("#top")
    robot.page.keyboard.down("ArrowUp")
    ghost.click_at(*ghost.value("state.scene.pellets[0]"))
    robot.wait(f"Math.hypot(state.frame.true[0] - {x}, state.frame.true[1] - {y}) > 0.25", "the robot drives")
    robot.page.keyboard.up("ArrowUp")
    robot.wait("Math.abs(state.frame.velocity[0]) < 0.02", "it stands when the key is up")
    ghost.wait(f"Math.hypot(state.frame.ghosts[0][0] - {gx}, state.frame.ghosts[0][1] - {gy}) > 0.2", "Clyde moves")
    assert ghost.page.is_disabled("#reset")
    assert "has control" in ghost.text("reason")
    ghost.press("lease-ask")
    robot.page.click(".notice button:has-text('Hand over')")
    ghost.wait("state.people.operator === state.hello.you")
    ghost.reset()
    robot.wait("state.frame.state === 'menu'")


def test_ghost_chases_the_robot_by_clicks(visit: Visit) -> None:
    page = visit()
    take_role(page, "ghost-0")
    assert page.text("mode").startswith("You are Clyde: press Start")
    page.press("tab-game")
    page.slide("clyde-speed", 2)
    page.wait("state.scene.clyde_speed_mps === 2")
    x, y = page.value("state.frame.ghosts[0]")
    page.click_at(x + 0.1, y)  # no pellet is near
    goal = page.wait("state.frame.ghost_goals[0][0] !== null && state.frame.ghost_goals[0]")
    assert math.dist(goal, (x, y)) < 1.1
    page.click_at(*page.value("state.frame.true.slice(0, 2)"))
    page.wait("Math.hypot(...[0, 1].map((k) => state.frame.ghost_goals[0][k] - state.frame.true[k])) < 0.01")
    page.slide("speed", FASTEST)
    page.press("start")
    page.wait("document.querySelector('#result').textContent.startsWith('You won: you caught the robot')")


def test_preset_fills_form_but_keeps_changed_settings(visit: Visit) -> None:
    page = visit()
    fields = {
        name: page.page.locator(f'.setting:has(label:text-matches("^{name}(,|$)")) input')
        for name in ("power.pellets", "power.return_s", "robot.speed_mps")
    }
    page.page.click("#settings summary")
    page.page.fill("#settings-search", "power")
    fields["power.return_s"].fill("4")
    fields["power.return_s"].blur()
    for preset, pellets, speed in (("arcade", "4", "0.285"), ("ideal", "0", "0.306"), ("arcade", "4", "0.285")):
        page.page.select_option("#setup-preset", preset)
        ghosts = page.value("[...document.querySelectorAll('#setup-ghosts select')].map(({value}) => value)")
        assert tuple(ghosts) == make_config(preset).clyde.ghosts
        assert (fields["power.pellets"].input_value(), fields["robot.speed_mps"].input_value()) == (pellets, speed)
        assert (page.text("settings-count"), fields["power.return_s"].input_value()) == ("2 changed", "4")
    page.press("setup-only")
    scene = page.wait("state.scene.preset === 'arcade' && state.scene")
    assert scene["settings"] == {"power.return_s": 4, "time_limit_s": 90}
    assert (len(scene["ghosts"]), len(scene["power"]["pellets"])) == (4, 4)


def test_setup_changes_map_policies_ghosts_settings(visit: Visit) -> None:
    page = visit()
    names = page.value("[...document.querySelector('#setup-map').options].map(({value}) => value)")
    assert {*shipped_maps(), "generated"} <= set(names)
    page.page.select_option("#setup-map", "loop")
    page.page.select_option("#setup-policy", "nearest")
    page.page.select_option("#setup-second", "lookahead")
    page.press("setup-ghost-add")
    page.page.locator("#setup-ghosts select").nth(1).select_option("chase")
    page.page.fill("#setup-seed", "12")
    page.page.click("#settings summary")
    page.page.fill("#settings-search", "time_limit")
    limit = page.page.locator("#settings-list input:visible")
    assert limit.count() == 1
    page.page.press("#settings-search", "Escape")
    assert page.page.input_value("#settings-search") == ""
    page.page.press("#settings-search", "Escape")
    assert page.value("state.frame.stopped || document.activeElement.type === 'search'") is False
    page.page.fill("#settings-search", "time_limit")
    limit.fill("33")
    limit.blur()
    assert "1 changed" in page.text("settings-count")
    page.press("setup-start")
    scene = page.wait("state.scene.map?.name === 'loop' && state.scene")
    assert (scene["policy"], scene["second"], scene["seed"]) == ("nearest", "lookahead", 12)
    assert [ghost["behaviour"] for ghost in scene["ghosts"]] == ["wander", "chase"]
    assert scene["settings"] == {"time_limit_s": 33}
    page.wait("state.frame.state !== 'menu' && state.frame.ghosts.length === 2")
    page.reset()
    page.wait("state.frame.state === 'menu'")
    page.slide("clyde-speed", 0.6)
    page.wait("state.scene.clyde_speed_mps === 0.6")
    page.page.select_option("#setup-map", "generated")
    page.page.fill("#setup-level", "5")
    page.press("setup-only")
    page.wait("state.scene.map?.name === 'generated' && state.scene.level === 5")


def test_uploaded_map_is_played_or_refused(visit: Visit, tmp_path: Path) -> None:
    page = visit()
    image, yaml = tmp_path / "flat.pgm", tmp_path / "flat.yaml"
    image.write_bytes((MAPS / "loop.pgm").read_bytes())
    yaml.write_text((MAPS / "loop.yaml").read_text().replace("loop.pgm", "flat.pgm"))
    page.page.click("#upload summary")
    page.page.set_input_files("#upload-files", [yaml])
    page.press("upload-send")
    assert "two files" in page.text("upload-words")
    page.page.set_input_files("#upload-files", [yaml, image])
    page.press("upload-send")
    page.wait("document.querySelector('#setup-map').value === 'flat'", "the map is chosen")
    assert "pellets" in page.text("upload-words")
    page.press("setup-only")
    page.wait("state.scene.map?.name === 'flat'")
    image.write_bytes(b"P5\n3 3\n255\n" + bytes(9))
    page.page.set_input_files("#upload-files", [yaml, image])
    page.press("upload-send")
    page.wait("/cannot be played/.test(document.querySelector('#upload-words').textContent)", "it is refused")


def test_finished_round_is_replayed_from_a_link(visit: Visit) -> None:
    link = "#map=house&preset=robot&policy=ppo&second=clyde_aware&ghosts=wander&clyde=0.25&seed=11&tick=25"
    page = visit(link)
    page.wait("state.story?.index === 25", "the moment of the link")
    story = page.value("state.story.entry")
    assert story["ticks"] + 1 == page.value("state.story.frames.length")
    page.press("tab-why")
    page.wait("document.querySelectorAll('#why-table tbody tr').length > 3")
    page.press("story-next")
    marks = story["parts"] or story["decisions"]
    following = next(tick for tick in marks if tick > 25)
    assert page.value("state.story.index") == following
    if story["parts"]:
        page.wait("document.querySelector('#why-words .disagreement')")
    page.press("story-previous")
    assert page.value("state.story.index") < following
    page.slide("story-range", 40)
    assert page.value("state.story.index") == 40
    assert page.text("story-at").startswith("0:")
    page.page.focus("#top")
    page.page.keyboard.press("ArrowRight")
    assert page.value("state.story.index") == 41
    page.press("story-play")
    page.wait("state.story.index > 43")
    page.press("story-play", "story-share")
    assert re.search(r"seed=11&tick=\d+$", page.page.url)
    page.press("story-close", "tab-rounds")
    assert page.value("state.story") is None
    assert page.page.locator("#stories li").count() == 1


def test_page_reconnects_to_restarted_server(visit: Visit, page_server: WebServer, simulated: SimulatedGame) -> None:
    page = visit(allowed=("WebSocket connection to",))
    start(page)
    port = page_server.port
    page_server.close()
    page.wait("((lost) => !lost.hidden && lost.textContent.includes('No connection'))(document.querySelector('#lost'))")
    assert page.page.is_disabled("#start")
    page.page.keyboard.press("Escape")
    page.wait("document.querySelector('#lost').textContent.includes('NOT delivered')")
    with WebServer(simulated, port=port, write=lambda _: None):
        page.page.wait_for_selector(".notice[data-key=restarted]")
        page.wait("state.connected && document.querySelector('#lost').hidden", "it is back by itself")
        page.wait("state.frame.stopped", "the STOP that was owed arrives")
        page.page.click("#release:visible:enabled")
        page.wait("!state.frame.stopped")
        page.press("stop")
        page.wait("state.frame.stopped")


def test_page_tells_that_messages_are_late(
    visit: Visit, simulated: SimulatedGame, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = visit()
    start(page)
    assert not page.page.is_visible("#late")
    last = simulated.frame()
    with monkeypatch.context() as context:
        context.setattr(simulated, "frame", lambda: last)  # nothing new arrives
        page.page.wait_for_selector("#late:visible")
    page.page.wait_for_selector("#late", state="hidden")


def test_page_keeps_connection_after_sleep(visit: Visit) -> None:
    page = visit()
    page.page.clock.install(time=0)
    page.open()
    page.page.clock.pause_at(1000)
    assert page.value("state.connected")


def test_page_draws_only_when_visible_and_changed(visit: Visit) -> None:
    page = visit()
    page.wait("view.bounds.join() !== '-5,-5,5,5'", "the picture of the map is shown")
    assert page.page.evaluate(STANDS_STILL), "thirty looks have found no other drawing"
    start(page)
    page.page.evaluate("window.goAway(true)")
    page.page.evaluate("new Promise(requestAnimationFrame)")  # after the last drawing that was asked for before
    drawn, received = page.value("[count.frames_drawn, count.frames]")
    page.wait(f"count.frames > {received + 5}")
    assert page.value("count.frames_drawn") == drawn
    page.page.evaluate("window.goAway(false)")
    page.wait(f"count.frames_drawn > {drawn}")


def test_viewer_page_only_watches_and_stops(simulated: SimulatedGame, visit: Visit) -> None:
    tokens = Tokens(operator="o" * 32, viewer="v" * 32)
    with WebServer(simulated, tokens=tokens, write=lambda _: None) as server:
        page = visit(ready=False)
        page.url = f"http://127.0.0.1:{server.port}/"
        page.page.goto(f"{page.url}?token={'v' * 32}")
        page.wait("state.frame")
        page.foreign.clear()  # the page that was left
        for name in ("start", "reset", "setup-start", "clyde-speed", "place"):
            assert page.page.is_disabled(f"#{name}"), name
        assert "viewer" in page.text("reason")
        page.press("stop")
        page.wait("state.frame.stopped")
        assert page.page.is_disabled("#release")
        assert page.value("state.scene.map.url").startswith("map/")
        page.leave()


def test_alert_asks_for_robot_pose(simulated: SimulatedGame, visit: Visit, monkeypatch: pytest.MonkeyPatch) -> None:
    alerts = [{"kind": "pose jumped", "words": "pose jumped 3.1 m", "remedy": "look", "asks": True}]
    asked: list[page_messages.Message] = []
    scene, handle = simulated.scene, simulated.handle

    def shown() -> Scene:
        now = scene()
        return Scene(now.revision + 1000 * len(alerts), {**now.facts, "alerts": list(alerts)}, now.picture)

    def handled(person: str, message: page_messages.Message) -> Any:
        if not isinstance(message, page_messages.SetPose | page_messages.Continue):
            return handle(person, message)
        asked.append(message)
        return None

    monkeypatch.setattr(simulated, "scene", shown)
    monkeypatch.setattr(simulated, "handle", handled)
    page = visit(viewport={"width": 390, "height": 844})
    page.press("tab-why")
    assert page.text("alert-words") == "Pose jumped 3.1 m. Where is the robot?"
    x, y = page.value("state.scene.pellets[7]")
    page.press("set-pose")
    assert page.text("mode") == "Click where the robot stands"
    assert not page.page.is_visible("#panel-why"), "on a telephone the map needs its place"
    page.wait("view.fitted")
    page.click_at(x, y)
    assert page.text("mode") == "Click a place that it faces"
    assert page.value("state.stands") == pytest.approx([x, y], abs=0.1)  # where the map has a cross
    page.click_at(x, y + 1.0)
    page.until(lambda: asked, "a pose")
    (pose,) = asked
    assert isinstance(pose, page_messages.SetPose)
    assert (pose.x, pose.y, pose.heading) == pytest.approx((x, y, math.pi / 2), abs=0.1)
    page.wait("state.placing === ''")
    page.press("continue")
    page.until(lambda: len(asked) == 2, "to continue")
    alerts.append({"kind": "silent", "words": "a node does not respond", "remedy": "wait", "asks": False})
    page.wait("document.querySelectorAll('#alert-words p').length === 2")
    assert page.page.locator("#alert-words p").last.text_content() == "A node does not respond: wait."
    alerts.clear()
    page.until(lambda: not page.page.is_visible("#alert"), "the end of the alert")


@pytest.mark.parametrize("width", [390, 1440])
def test_stop_button_and_key_work_at_any_width(visit: Visit, width: int) -> None:
    page = visit(viewport={"width": width, "height": 844 if width < 800 else 768}, has_touch=width < 800)
    for tab in TABS:
        page.press(f"tab-{tab}")
        assert page.page.is_visible(f"#panel-{tab}")
        box = page.page.locator("#stop").bounding_box()
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= width
        assert box["y"] + box["height"] <= page.page.viewport_size["height"]
        assert min(box["width"], box["height"]) >= 44
        assert page.value(f"document.elementFromPoint({box['x'] + 20}, {box['y'] + 20}).id") == "stop"
    assert page.value("document.documentElement.scrollWidth") <= width
    page.page.keyboard.press("Escape")
    page.wait("state.frame.stopped", "no card is open")
    assert page.page.is_disabled("#start")
    for tab in TABS:  # Release covers none of them
        box = page.page.locator(f"#tab-{tab}").bounding_box()
        at = f"{box['x'] + box['width'] / 2}, {box['y'] + box['height'] / 2}"
        assert page.value(f"document.elementFromPoint({at}).id") == f"tab-{tab}"
    page.press("release")
    page.wait("!state.frame.stopped")


def test_page_hides_simulator_controls_on_robot(
    simulated: SimulatedGame, visit: Visit, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(simulated, "source", "ros")
    page = visit()
    for name in ("share", "setup-seed", "setup-dice", "setup-second", "pause", "speed"):
        assert not page.page.is_visible(f"#{name}"), name
    assert page.page.is_visible("#setup-policy")
    page.press("tab-play")
    page.until(lambda: page.page.locator("#roles li").all_text_contents() == ["Robot: freePlay Robot"], "one role")
    page.press("tab-rounds")
    assert page.text("stories-words").startswith("Rounds of a robot are not kept here.")


def test_page_files_are_small_and_self_contained() -> None:
    files = list(STATIC.rglob("*.*"))
    assert sum(len(gzip.compress(path.read_bytes(), 6)) for path in files) < 75_000, "bytes that a browser loads"
    for path in files:
        for address in re.findall(r"\w+://[^\s\"'`)]+", path.read_text()):
            assert address.startswith("http://www.w3.org/"), f"{path.name}: {address}"
    page = (STATIC / "index.html").read_text()
    assert not re.search(r"\son\w+=|\sstyle=|<style|<script(?![^>]*\ssrc=)", page)
    named = set(re.findall(r"\"static/([\w./]+)", page)) | {
        name for path in files for name in re.findall(r"from \"\./([\w.]+)\"", path.read_text())
    }
    assert named <= {path.relative_to(STATIC).as_posix() for path in files}
