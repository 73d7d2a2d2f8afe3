"""The screenshots of the operator's page in the documentation: ``python -m tools.screenshots``.

A real browser (Chromium of the system, driven by Playwright) shows the real server's page over the simulator. Moving
things are not drawn alike each time, so no test compares these pictures.
"""

from __future__ import annotations

import argparse
import io
import shutil
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from PIL import Image

from pacman_env.web.rules import Rules
from pacman_env.web.server import WebServer
from pacman_env.web.simulated import SimulatedGame

IMAGES = Path(__file__).resolve().parents[1] / "docs" / "images"
PATIENCE_S = 120.0
_SEED = 11
_COLOURS = 255  # of a picture's palette
_FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--disable-sync",
    "--force-color-profile=srgb",
)


def _wait(page: Any, expression: str) -> None:
    end = time.monotonic() + PATIENCE_S
    while not page.evaluate(f"(() => {{ const {{state}} = window.pacman ?? {{}}; return {expression} }})()"):
        if time.monotonic() > end:
            raise RuntimeError(f"the page never had {expression}")
        page.wait_for_timeout(30)


def _speed(page: Any, times: int) -> None:
    page.locator("#speed").fill(str(times))


def _round(page: Any, pellets: int, speed: int = 10) -> None:
    """A round under way, so many pellets collected."""
    _speed(page, speed)
    page.click("#start")
    _wait(page, f"state.frame.state === 'running' && state.frame.collected >= {pellets}")
    _speed(page, 2)
    page.wait_for_timeout(700)


def _running(page: Any) -> None:
    _round(page, 5)


def _playing(page: Any) -> None:
    """A user plays the robot, beside the policy's own choice."""
    page.click("#tab-play")
    page.click("[data-role=robot]")
    _wait(page, "state.role === 'robot' && state.frame.baseline")
    _speed(page, 4)
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
    """A round that has ended, where the policies disagree."""
    page.evaluate(f"location.hash = 'seed={_SEED}&tick=30'")
    _wait(page, "state.story")
    page.click("#tab-why")
    page.click("#story-next")
    _wait(page, "document.querySelector('.parted')")
    page.mouse.move(5, 400)
    page.wait_for_timeout(300)


def _four_ghosts(page: Any) -> None:
    for _ in range(3):
        page.click("#setup-ghost-add")
    page.fill("#setup-seed", "4")
    page.click("#setup-only")
    _wait(page, "state.scene.ghosts.length === 4")
    _wait(page, "!document.querySelector('.notice')")
    page.locator("#panel-game").evaluate("(panel) => panel.scrollTo(0, 0)")
    _round(page, 3)


#: By name: width, height, pixels a pixel of the page, colours, what is on it.
SHOTS: dict[str, tuple[int, int, float, str, Callable[[Any], None]]] = {
    "web-390-dark": (390, 844, 1.5, "dark", _running),
    "web-390-light": (390, 844, 1.5, "light", _playing),
    "web-1024-dark": (1024, 768, 1.0, "dark", _playing),
    "web-1024-light": (1024, 768, 1.0, "light", _explained),
    "web-1440": (1440, 900, 1.0, "dark", _running),
    "web-1920-dark": (1920, 1080, 1.0, "dark", _recorded),
    "web-1920-light": (1920, 1080, 1.0, "light", _four_ghosts),
}


def compact(png: bytes) -> bytes:
    """The same picture with a palette."""
    out = io.BytesIO()
    image = Image.open(io.BytesIO(png)).convert("RGB")
    image.quantize(_COLOURS, Image.Quantize.MEDIANCUT, kmeans=2, dither=Image.Dither.NONE).save(
        out, "PNG", optimize=True
    )
    return out.getvalue()


def shoot(browser: Any, name: str) -> bytes:
    width, height, ratio, scheme, prepare = SHOTS[name]
    game = SimulatedGame(Rules(), seed=_SEED)
    try:
        with WebServer(game, write=lambda _: None) as server:
            context = browser.new_context(
                viewport={"width": width, "height": height},
                device_scale_factor=ratio,
                color_scheme=scheme,
                has_touch=width < 800,
                is_mobile=width < 800,
            )
            page = context.new_page()
            page.goto(f"http://127.0.0.1:{server.port}/")
            _wait(page, "state?.frame && state.scene.map")
            prepare(page)
            _wait(page, "!document.querySelector('.notice')")
            picture = page.screenshot()
            context.close()
            return compact(picture)
    finally:
        game.close()


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.screenshots", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(SHOTS)}; all if none is given")
    parser.add_argument("--out", type=Path, default=IMAGES, metavar="FOLDER", help="where to (docs/images)")
    given = parser.parse_args(arguments)
    unknown = [name for name in given.names if name not in SHOTS]
    if unknown:
        parser.error(f"no picture {unknown[0]!r}")
    program = shutil.which("chromium") or shutil.which("google-chrome")
    try:
        from playwright.sync_api import sync_playwright
    except ModuleNotFoundError:
        program = None
    if program is None:
        print("needs Chromium and Playwright for Python", file=sys.stderr)
        return 2
    given.out.mkdir(parents=True, exist_ok=True)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=list(_FLAGS))
        for name in given.names or SHOTS:
            picture = shoot(browser, name)
            (given.out / f"{name}.png").write_bytes(picture)
            print(f"{given.out / name}.png: {len(picture) / 1000:.0f} kB")
        browser.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
