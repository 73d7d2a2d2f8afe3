"""Draw every picture of the documentation from seeds: ``python -m tools.gallery``."""

import argparse
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pacman_env.command_line.command import Parser, run_command
from pacman_env.config import make_config
from pacman_env.envs.pacmanbot import PacManBotEnv
from pacman_env.evaluation.replay import RecordedGame, film, record_games
from pacman_env.files import prepare, replaced
from pacman_env.levels.assets import MapAssets, map_assets
from pacman_env.levels.level_source import TEST_LEVEL, prepare_level
from pacman_env.policies.registry import make_policy
from pacman_env.render.frames import map_view, render_frame
from pacman_env.render.palette import DARK, LIGHT, THEMES, Colour, Theme
from pacman_env.render.symbols import Image, paste, text
from pacman_env.world.maps.occupancy import shipped_maps
from tools import learning_curves, replay
from tools.common import add_images, save_film

_GAP = 10  # px between pictures
_PX_PER_M = 21.0  # scale of the maps in a sheet
_SEEN: dict[Theme, tuple[Colour, ...]] = {  # walls, floor, pellets, ghosts, robot; page, seen area, rings of a scan
    "light": ((60, 66, 84), (250, 250, 247), (214, 158, 0), (235, 100, 20), LIGHT.plan,
              (255, 255, 255), (232, 240, 252), (206, 212, 222)),
    "dark": (DARK.wall, DARK.floor, DARK.pac, (255, 140, 26), DARK.plan, DARK.page, DARK.floor, (70, 82, 112)),
}  # fmt: skip


def play(seed: int, decisions: int, *, policy: str = "clyde_aware", **arguments: Any) -> PacManBotEnv:
    """Return an environment after ``decisions`` decisions of a policy, or at the end of the round if it is earlier."""
    env = PacManBotEnv(**arguments)
    for _ in islice(moments(env, seed, policy), decisions + 1):
        pass
    return env


def moments(env: Any, seed: int, policy: str) -> Iterator[None]:
    """Play a round, and pause before each decision of a policy and at the end; with velocities, drive a curve."""
    env.reset(seed=seed)
    selector = make_policy(policy)
    selector.reset(np.ones(1, dtype=np.bool_), env.config)
    over, drives = False, env.config.action == "velocity"
    while not over:
        yield
        action = np.array([0.1, 0.2]) if drives else env.action_of(selector.select(env.situation))[0]
        over = any(env.step(action)[2:4])
    yield


def sheet(theme: Theme, pictures: Sequence[Image], columns: int, captions: Sequence[str] = ()) -> Image:
    """Place pictures in rows, each centred in its place, with a caption below."""
    below, colours = 26 if captions else 0, THEMES[theme]
    widths = [max(picture.shape[1] for picture in pictures[c::columns]) for c in range(columns)]
    rows = [pictures[k : k + columns] for k in range(0, len(pictures), columns)]
    heights = [max(picture.shape[0] for picture in row) for row in rows]
    tops = _GAP + np.cumsum([0, *(height + below + _GAP for height in heights)])
    lefts = _GAP + np.cumsum([0, *(width + _GAP for width in widths)])
    page = np.full((tops[-1], lefts[-1], 3), colours.page, dtype=np.uint8)
    for k, picture in enumerate(pictures):
        r, c = divmod(k, columns)
        y, x = tops[r] + (heights[r] - picture.shape[0]) // 2, lefts[c] + (widths[c] - picture.shape[1]) // 2
        page[y : y + picture.shape[0], x : x + picture.shape[1]] = picture
        if captions:
            caption = text(captions[k], 9.5, False, colours.ink, colours.page)
            paste(page, lefts[c] + (widths[c] - caption.shape[1]) / 2, tops[r] + heights[r] + below / 2, caption)
    return page


def tile(theme: Theme, assets: MapAssets, px_per_m: float = _PX_PER_M) -> Image:
    """Draw a map with its pellets, refuges and home; all maps have the same scale."""
    config, height = make_config(), 360
    for _ in range(6):  # iterate, because the height includes the legend
        view = map_view(assets, config, height, theme=theme)
        if abs(view.scale - px_per_m) < 0.02 * px_per_m:
            break
        height = max(2 * round(0.5 * height * px_per_m / view.scale), 120)
    x, y = view.pixels(corners(assets)).T
    picture = view.layer(np.ones(assets.pellets, dtype=np.bool_))
    left, top = max(math.floor(x.min()), 0), max(math.floor(y.min()), view.header)
    return picture[top : math.ceil(y.max()) + 1, left : math.ceil(x.max()) + 1]


def corners(assets: MapAssets) -> NDArray[np.float64]:
    """Return the corners of the playable part of the map, (4, 2) m."""
    rows, columns = assets.grid.shape
    return np.array([assets.grid.to_world(c, r) for c in (0, columns - 1) for r in (0, rows - 1)])


def _games() -> list[RecordedGame]:
    return record_games("house", make_config(), {policy: policy for policy in replay.POLICIES}, replay.SEED)


def draw_replay(theme: Theme) -> Image:
    """Draw the rounds of the page "Replay" at their ends."""
    games = _games()
    for game in games:
        while not game.over:
            game.step()
    return sheet(theme, [game.picture(420, theme) for game in games], 2)


def save_round(path: Path, theme: Theme = "light") -> None:
    """Film these rounds at 8 times real time: every second picture, the last one for 2 s."""
    save_film([*film(_games(), 400, theme)][::-2][::-1], path, 125, 2000)


def draw_story(theme: Theme) -> Image:
    frames = []
    for decisions in (0, 90, 220, 2000):
        batch = play(7, decisions, map="loop").batch
        view = map_view(batch.assets, batch.config, 400, theme=theme)
        bottom = view.pixels(corners(batch.assets))[:, 1].max() + _GAP
        frame = render_frame(batch, 0, height=view.height, theme=theme)
        frames.append(frame[: math.ceil(bottom)])  # without the legend
    return sheet(theme, frames, 2)


def draw_ghosts(theme: Theme) -> Image:
    env = play(5, 24, map="open_plan", ghosts=("wander", "chase", "arcade", "wander"))
    return render_frame(env.batch, 0, height=560, title="four ghosts", theme=theme)


def draw_power(theme: Theme) -> Image:
    env = play(87, 50, map="open_plan", preset="arcade")
    return render_frame(env.batch, 0, height=560, title="power pellets", theme=theme)


def draw_maps(theme: Theme) -> Image:
    drawn = {name: map_assets(name, make_config()) for name in shipped_maps()}
    captions = [f"{name}: {assets.pellets} pellets" for name, assets in drawn.items()]
    return sheet(theme, [tile(theme, assets, 30.0) for assets in drawn.values()], 2, captions)


def draw_reading(theme: Theme) -> Image:
    """Draw a saved map image next to the game's view of it."""
    assets = map_assets("house", make_config())
    game = tile(theme, assets, 30.0)
    x, y = corners(assets).T
    column, row = np.floor(np.stack(assets.occupancy.world_to_cell(x, y)) + 0.5).astype(int)
    saved = assets.occupancy.grey[row.min() : row.max() + 1, column.min() : column.max() + 1]
    saved = cv2.cvtColor(cv2.resize(saved, game.shape[1::-1], interpolation=cv2.INTER_NEAREST), cv2.COLOR_GRAY2RGB)
    return sheet(theme, [saved, game], 2, ("the image of the map", "what is played on"))


def draw_houses(theme: Theme) -> Image:
    levels = [*range(8), *range(TEST_LEVEL, TEST_LEVEL + 4)]
    assets = [prepare_level(level, make_config()) for level in levels]
    captions = [f"{'test' if level >= TEST_LEVEL else 'train'}: level {level:,}" for level in levels]
    return sheet(theme, [tile(theme, one) for one in assets], 4, captions)


def draw_observations(theme: Theme) -> Image:
    """Draw one instant as a picture for people, as the lidar scan, and as the grid."""
    env = play(5, 24, map="open_plan", ghosts=2, observation=("features", "scan", "grid"))
    stepped = env.step(int(env.batch.hold))[0]
    frame = render_frame(env.batch, 0, height=420, theme=theme)
    pictures = frame, _scan_picture(theme, env, stepped["scan"], len(frame)), _grid_picture(theme, stepped["grid"])
    captions = "the game", "scan: 360 ranges, heading up", "grid: walls, pellets, ghosts, robot"
    return sheet(theme, pictures, 3, captions)


def _scan_picture(theme: Theme, env: PacManBotEnv, ranges: NDArray[np.float32], size: int) -> Image:
    """Draw the ends of the rays around the robot, its heading up, with rings every metre."""
    walls, *_, robot, page, seen, rings = _SEEN[theme]
    limit_m = 6.5
    image = np.full((size, size, 3), page, dtype=np.uint8)
    middle, scale = (size - 1) / 2, size / (2 * limit_m)
    angle = 2 * np.pi * np.arange(len(ranges)) / len(ranges)
    points = np.stack([middle - scale * ranges * np.sin(angle), middle - scale * ranges * np.cos(angle)], axis=1)
    cv2.fillPoly(image, [np.rint(points * 16).astype(np.int32)], seen, cv2.LINE_AA, 4)
    centre = (round(middle), round(middle))
    for ring in range(1, 7):
        cv2.circle(image, centre, round(ring * scale), rings, 1, cv2.LINE_AA)
    for x, y in points[ranges < env.config.observation.scan_maximum_m]:
        cv2.circle(image, (round(x * 16), round(y * 16)), 30, walls, -1, cv2.LINE_AA, 4)
    cv2.line(image, centre, (centre[0], round(middle - scale * ranges[0])), robot, 1, cv2.LINE_AA)
    cv2.circle(image, centre, round(env.config.robot.radius_m * scale), robot, -1, cv2.LINE_AA)
    paste(image, middle + 6, middle - 0.5 * scale, text("ray 0", 9, False, robot, seen))
    paste(image, middle + scale * 3 + 3, middle, text("3 m", 8, False, THEMES[theme].muted, page))
    return image


def _grid_picture(theme: Theme, grid: NDArray[np.uint8], times: int = 6) -> Image:
    walls, floor, *others = _SEEN[theme][:5]
    image = np.full((*grid.shape[:2], 3), floor, dtype=np.uint8)
    for channel, colour in enumerate((walls, *others)):
        image[grid[:, :, channel] > 0] = colour
    return np.repeat(np.repeat(image, times, axis=0), times, axis=1)


#: Functions that draw the pictures, by file name in docs/images.
_DRAWN = draw_replay, draw_story, draw_ghosts, draw_power, draw_observations, draw_maps, draw_reading, draw_houses
PICTURES: dict[str, Callable[[Theme], Image]] = {draw.__name__.removeprefix("draw_"): draw for draw in _DRAWN}
NAMES = (*PICTURES, "round", "round-dark", "baselines")


def save(name: str, path: Path, theme: Theme = "light") -> None:
    with replaced(prepare(path)) as temporary:
        cv2.imwrite(str(temporary), PICTURES[name](theme)[:, :, ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 9])


def _draw(arguments: argparse.Namespace) -> None:
    for name in arguments.names or NAMES:
        if name == "baselines":
            learning_curves.draw(arguments.out / "baselines.svg")
        elif name in PICTURES:
            save(name, arguments.out / f"{name}.png")
        else:
            save_round(prepare(arguments.out / f"{name}.webp"), "dark" if name == "round-dark" else "light")


if __name__ == "__main__":
    parser = Parser(prog="python -m tools.gallery", description="Draw the pictures of the documentation.")
    add_images(parser, NAMES)
    sys.exit(run_command(parser, None, _draw))
