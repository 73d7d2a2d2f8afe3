"""Take the screenshots of the operator's page in the documentation: ``python -m tools.screenshots``.

Chromium takes them. Moving things differ between runs, so no test compares these pictures.
"""

import argparse
import io
import shutil
import sys
from collections.abc import Callable
from contextlib import closing
from importlib.util import find_spec
from typing import Any

from PIL import Image

from pacman_env.command_line.command import Parser, run_command
from pacman_env.web.rules import Rules
from pacman_env.web.server import WebServer
from pacman_env.web.simulated import SimulatedGame
from tools.common import add_images

_SEED = 11
_COLOURS = 100  # of a picture, for small files
_FLAGS = ["--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-sync", "--force-color-profile=srgb"]


def _wait(page: Any, expression: str) -> None:
    page.wait_for_function(f"(({{state}}) => {expression})(window.pacman ?? {{}})", timeout=120_000)


def _first(page: Any) -> None:
    """Leave the card of a first visit open until the demo has collected some pellets."""
    _wait(page, "state.demo && state.demo.frames[state.demo.index].collected >= 3")


def _round(page: Any, pellets: int) -> None:
    """Start a round and wait until ``pellets`` pellets are collected."""
    page.fill("#speed", "10")
    page.click("#start")
    _wait(page, f"state.frame.state === 'running' && state.frame.collected >= {pellets}")
    page.fill("#speed", "2")
    page.wait_for_timeout(700)


def _playing(page: Any) -> None:
    page.click("#tab-play")
    page.click("[data-role=robot]")
    _wait(page, "state.role === 'robot' && state.frame.baseline")
    page.fill("#speed", "4")
    page.click("#start")
    _wait(page, "state.frame.state === 'running'")
    page.keyboard.press("1")
    _wait(page, "state.frame.collected >= 1")
    page.keyboard.press("3")
    page.wait_for_timeout(1500)
    page.mouse.move(600, 300)


def _explained(page: Any) -> None:
    page.click("#tab-why")
    _round(page, 6)


def _recorded(page: Any) -> None:
    """Show an ended round at a tick where the policies disagree."""
    page.evaluate(f"location.hash = 'seed={_SEED}&tick=30'")
    _wait(page, "state.story")
    page.click("#tab-why")
    page.click("#story-next")
    _wait(page, "document.querySelector('.disagreement')")
    page.mouse.move(5, 400)
    page.wait_for_timeout(300)


def _set_up(page: Any, prepared: str) -> None:
    """Prepare a round, which the expression ``prepared`` recognizes."""
    page.fill("#setup-seed", "4")
    page.click("#setup-only")
    _wait(page, f"{prepared} && !document.querySelector('.notice')")
    page.locator("#panel-game").evaluate("(panel) => panel.scrollTo(0, 0)")


def _arcade(page: Any) -> None:
    """Play the preset with power pellets until ghosts are frightened."""
    page.click("#tab-game")
    page.select_option("#setup-preset", "arcade")
    _set_up(page, "state.scene.power")
    if not page.is_visible("#speed"):
        page.click("#tab-game")  # on a telephone the panel leaves its place to the map
    page.fill("#speed", "5")
    page.click("#start")
    _wait(page, "state.frame.collected > 2 && state.frame.harmless_s.some((left) => left > 10)")
    page.fill("#speed", "1")
    page.wait_for_timeout(700)


def _four_ghosts(page: Any) -> None:
    for _ in range(3):
        page.click("#setup-ghost-add")
    _set_up(page, "state.scene.ghosts.length === 4")
    _round(page, 3)


#: Width, height, device pixel ratio, colour scheme and preparation of each picture, by name.
SHOTS: dict[str, tuple[int, int, float, str, Callable[[Any], None]]] = {
    "web-390-dark": (390, 844, 1.5, "dark", _arcade),
    "web-390-light": (390, 844, 1.5, "light", _playing),
    "web-1024-light": (1024, 768, 1.0, "light", _explained),
    "web-1280-first": (1280, 800, 1.0, "light", _first),
    "web-1440": (1440, 900, 1.0, "dark", _arcade),
    "web-1920-dark": (1920, 1080, 1.0, "dark", _recorded),
    "web-1920-light": (1920, 1080, 1.0, "light", _four_ghosts),
}
NAMES = (*SHOTS, "robot")


def shoot(browser: Any, name: str) -> Image.Image:
    width, height, ratio, scheme, prepare = SHOTS[name]
    phone = width < 800
    options = {"device_scale_factor": ratio, "color_scheme": scheme, "has_touch": phone, "is_mobile": phone}
    with (
        closing(SimulatedGame(Rules(), seed=_SEED)) as game,
        WebServer(game, write=lambda _: None) as server,
        browser.new_context(viewport={"width": width, "height": height}, bypass_csp=True, **options) as context,
    ):
        page = context.new_page()
        page.goto(f"http://127.0.0.1:{server.port}/")
        _wait(page, "state?.frame && state.scene.map")
        if prepare is not _first:
            page.click("#welcome-close")
        prepare(page)
        _wait(page, "!document.querySelector('.notice')")
        image = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
    return image.quantize(_COLOURS, Image.Quantize.MEDIANCUT, kmeans=2, dither=Image.Dither.NONE)


def _shoot_all(arguments: argparse.Namespace) -> None:
    from playwright.sync_api import sync_playwright

    program = shutil.which("chromium") or shutil.which("google-chrome")
    if program is None:
        raise ValueError("needs Chromium")
    arguments.out.mkdir(parents=True, exist_ok=True)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=_FLAGS)
        every = NAMES if find_spec("action_msgs") else SHOTS  # the robot's pictures need ROS
        for name in arguments.names or every:
            if name == "robot":
                from tools import robot_pictures  # only then: it needs ROS

                robot_pictures.save(browser, arguments.out)
            else:
                path = arguments.out / f"{name}.png"
                shoot(browser, name).save(path, optimize=True)
                print(f"{path}: {path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    parser = Parser(prog="python -m tools.screenshots", description="Take the screenshots of the operator's page.")
    add_images(parser, NAMES)
    sys.exit(run_command(parser, None, _shoot_all, "dev"))
