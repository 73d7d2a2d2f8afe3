"""Pictures of a game: the map, what is on it, and the score, as RGB arrays drawn with OpenCV.

What does not move is drawn once per map, configuration and size, and kept. The symbols are in
:mod:`pacman_env.render.symbols`; windows and video files are made elsewhere.
"""

from __future__ import annotations

import functools
import math
from collections import OrderedDict
from collections.abc import Callable
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pacman_env.game.execution import CLEARED, COMPLETE, DEAD, RUNNING, TIMEOUT

from ..config import Config
from ..game.ghosts import GHOST_NAMES
from ..sim.core.batch import GameBatch
from ..sim.maps.assets import MapAssets
from ..world.navigation.paths import AT_GOAL, NO_STEP
from . import symbols
from .symbols import Colour, Image

FLOOR, WALL, UNKNOWN, OUT_OF_REACH = (253, 253, 250), (44, 50, 66), (197, 202, 209), (226, 228, 231)
HEADER, TEXT, MUTED, PAGE, INK = (27, 31, 43), (245, 246, 248), (164, 172, 186), (241, 242, 244), (38, 42, 54)
#: Text, background and colour of the text for each way a game can stand.
STATES: dict[int, tuple[str, Colour, Colour]] = {
    RUNNING: ("RUNNING", (46, 125, 50), (255, 255, 255)),
    DEAD: ("CAUGHT", (200, 32, 32), (255, 255, 255)),
    COMPLETE: ("COMPLETE", (255, 214, 0), (30, 30, 30)),
    CLEARED: ("CLEARED", (240, 200, 120), (30, 30, 30)),
    TIMEOUT: ("TIME-OUT", (112, 118, 132), (255, 255, 255)),
}
_KEPT_VIEWS, _KEPT_LAYERS = 8, 4

_Draw = Callable[[Image, NDArray], None]


class _Item(NamedTuple):
    """A symbol of the legend with its text."""

    half: float  # of the symbol's width, px
    draw: _Draw
    text: Image
    gap: float  # to the next item, px

    @property
    def width(self) -> float:
        return 2 * self.half + 0.35 * self.gap + self.text.shape[1] + self.gap


def _wrap(items: list[_Item], room: float) -> list[list[_Item]]:
    """The items in lines of at most ``room`` px, one at least in each."""
    lines: list[list[_Item]] = [[]]
    for item in items:
        if lines[-1] and sum(i.width for i in lines[-1]) + item.width > room:
            lines.append([])
        lines[-1].append(item)
    return lines


class MapView:
    """The common part of all frames of one map, configuration and height.

    Attributes:
        width: of a frame, px; ``height`` likewise.
        scale: px per m.
        enlarged: how many times larger than life the robot and Clyde are drawn so that they can be seen.
        background: (height, width, 3) RGB, everything that never changes.
    """

    def __init__(self, assets: MapAssets, config: Config, height: int, wide: bool = False) -> None:
        """Lay out and draw everything that stands still; ``wide``: 16:9 whatever the map, so that many are alike.

        Raises:
            ValueError: ``height`` is not an even number of at least 120.
        """
        if height < 120 or height % 2:
            raise ValueError(f"height = {height!r}: must be an even number of at least 120")
        self.assets, self.config, self.height, self._wide = assets, config, height, wide
        self.unit = height / 720
        self.line = max(1.5 * self.unit, 0.9)  # width, px
        self._crop = _crop(assets)
        self._arrange()
        self.goals = self.pixels(assets.goal_xy)
        self.background = self._background()
        self._layers: OrderedDict[bytes, Image] = OrderedDict()

    def pixels(self, xy: NDArray[np.floating]) -> NDArray[np.float64]:
        """Positions (..., 2) in m as pixels (..., 2), whole at pixel centres."""
        column, row = self.assets.occupancy.world_to_cell(xy[..., 0], xy[..., 1])
        c0, r0, c1, r1 = self._crop
        x = (column + 0.5 - c0) * self._map[0] / (c1 - c0) + self._left - 0.5
        y = (row + 0.5 - r0) * self._map[1] / (r1 - r0) + self._top - 0.5
        return np.stack([x, y], axis=-1)

    def metres(self, pixels: NDArray[np.floating]) -> NDArray[np.float64]:
        """Pixels (..., 2) as positions (..., 2) in m: the inverse of :meth:`pixels`."""
        c0, r0, c1, r1 = self._crop
        column = (pixels[..., 0] + 0.5 - self._left) * (c1 - c0) / self._map[0] + c0 - 0.5
        row = (pixels[..., 1] + 0.5 - self._top) * (r1 - r0) / self._map[1] + r0 - 0.5
        return np.stack(self.assets.occupancy.cell_to_world(column, row), axis=-1)

    def angle(self, heading: float) -> float:
        """A heading of the map frame as an angle in the picture, where y points down."""
        return self.assets.occupancy.origin[2] - heading

    def layer(self, alive: NDArray[np.bool_]) -> Image:
        """The background with the pellets (P,) as they are now; kept, not to be written to."""
        key = alive.tobytes()
        picture = self._layers.get(key)
        if picture is None:
            picture = self.background.copy()
            for centre, there in zip(self.goals, alive.tolist(), strict=False):
                symbols.pellet(picture, centre, self.pellet_px, there)
            self._layers[key] = picture
            while len(self._layers) > _KEPT_LAYERS:
                self._layers.popitem(last=False)
        return picture

    def _arrange(self) -> None:
        """The largest map beside a header and a legend of as many lines as it needs; no legend if too many."""
        height, unit = self.height, self.unit
        c0, r0, c1, r1 = self._crop
        columns, rows = c1 - c0, r1 - r0
        margin = math.ceil(10 * unit)
        widest = int(height * 16 / 9) // 2 * 2
        narrowest = widest if self._wide else min(max(round(0.85 * height), 300), widest)
        row, self.header = math.ceil(max(24 * unit, 13)), math.ceil(max(70 * unit, 36))
        for count in (1, 2, 3, 4, 0):
            legend = count * row + (margin if count else 0)
            room = height - self.header - legend - 2 * margin
            factor = min(room / rows, (widest - 2 * margin) / columns)
            self._map = max(round(factor * columns), 1), max(round(factor * rows), 1)
            self.width = min(max(self._map[0] + 2 * margin, narrowest) + 1, widest) // 2 * 2
            self._set_scale(self._map[1] / rows / self.assets.occupancy.resolution)
            items, across = self._legend_items(), self.width - 2 * margin
            if len(_wrap(items, across)) <= count and legend <= 0.16 * height:
                break
        while count and len(_wrap(items, across - 4)) == count:  # lines of about the same length
            across -= 4
        self._legend = _wrap(items, across) if count else []
        self._legend_top = height - legend
        self._legend_rows = [self._legend_top + margin / 2 + (k + 0.5) * row for k in range(count)]
        self._left = (self.width - self._map[0]) // 2
        self._top = self.header + (height - self.header - legend - self._map[1]) // 2

    def _set_scale(self, scale: float) -> None:
        unit, radius = self.unit, self.config.robot.radius_m
        self.scale = scale
        self.body_px = max(radius * scale, 8.0 * unit, 4.5)
        self.enlarged = self.body_px / (radius * scale)
        self.pellet_px = min(max(0.08 * scale, 4.0 * unit, 2.2), max(6.5 * unit, 2.2))
        self.mark_px = min(max(0.11 * scale, 6.0 * unit, 3.5), max(9.0 * unit, 3.5))

    def _legend_items(self) -> list[_Item]:
        r, cap, line = max(8 * self.unit, 4.5), max(9.5 * self.unit, 5.5), self.line
        bar_m = next(m for m in (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000) if m * self.scale >= 28 * self.unit)
        bar, aside = 0.5 * bar_m * self.scale, np.array([1.0, 0.0])

        def goal(image: Image, at: NDArray) -> None:
            symbols.plan(image, np.array([at - 1.7 * r * aside, at + 0.3 * r * aside]), 1.6 * line)
            symbols.pellet(image, at + r * aside, 0.4 * r, True)
            symbols.goal_ring(image, at + r * aside, 0.7 * r, line)

        times = f" ({self.enlarged:.1f}x)" if self.enlarged > 1.05 else ""
        entries: list[tuple[str, float, _Draw]] = [
            (f"{bar_m} m", bar, lambda i, at: symbols.scale_bar(i, at, bar, 0.5 * r, INK)),
            (f"robot{times}", r, lambda i, at: symbols.pac_man(i, at, r, 0.0)),
            (
                "believed pose",
                1.2 * r,
                lambda i, at: symbols.believed_pose(i, at - 0.25 * r * aside, 0.85 * r, 0.0, line),
            ),
            *(self._ghost_entry(number, times, r) for number in range(len(self.config.clyde.ghosts))),
            ("catch radius", r, lambda i, at: symbols.catch_circle(i, at, r, line)),
            ("pellet", 0.6 * r, lambda i, at: symbols.pellet(i, at, 0.6 * r, True)),
            ("collected", 0.6 * r, lambda i, at: symbols.pellet(i, at, 0.6 * r, False)),
            ("goal, plan", 1.7 * r, goal),
            ("home", r, lambda i, at: symbols.home(i, at, 0.95 * r)),
            ("refuge", 0.8 * r, lambda i, at: symbols.refuge(i, at, 0.9 * r)),
        ]
        if self.config.localization.perfect:
            del entries[2]
        gap = max(21 * self.unit, 11)
        return [_Item(half, draw, symbols.text(name, cap, False, INK, PAGE), gap) for name, half, draw in entries]

    def _ghost_entry(self, number: int, times: str, radius: float) -> tuple[str, float, _Draw]:
        """A ghost in the legend, with what he does unless he wanders."""
        behaviour = self.config.clyde.ghosts[number]
        does = "" if behaviour == "wander" else f" ({behaviour})"
        colour, aside = symbols.GHOSTS[number], np.array([1.0, 0.0])
        name = f"{GHOST_NAMES[number].capitalize()}{does}{times}"
        return name, radius, lambda image, at: symbols.ghost(image, at, radius, aside, colour)

    def _background(self) -> Image:
        image = np.empty((self.height, self.width, 3), dtype=np.uint8)
        image[:] = UNKNOWN
        image[: self.header] = HEADER
        image[self._legend_top :] = PAGE
        width, height = self._map
        image[self._top : self._top + height, self._left : self._left + width] = _draw_map(
            self.assets, self.config, self._crop, (width, height)
        )
        home, places = self.goals[self.assets.pellets], self.goals[self.assets.pellets + 1 :]
        for centre in places:
            symbols.refuge(image, centre, self.mark_px)
        symbols.home(image, home, 1.15 * self.mark_px)
        for line, y in zip(self._legend, self._legend_rows, strict=True):
            x = (self.width - sum(item.width for item in line) + line[-1].gap) / 2
            for item in line:
                item.draw(image, np.array([x + item.half, y]))
                symbols.paste(image, x + 2 * item.half + 0.35 * item.gap, y, item.text)
                x += item.width
        return image


def _crop(assets: MapAssets) -> tuple[int, int, int, int]:
    """First and last (exclusive) column and row, from the top, of the cells that a game can be seen on."""
    occupancy, grid = assets.occupancy, assets.grid
    rows, columns = grid.shape
    seen = np.concatenate([assets.goal_xy, assets.clyde.position[assets.spawn_cells]])
    column, row = occupancy.world_to_cell(seen[:, 0], seen[:, 1])
    reach = math.ceil(0.5 / occupancy.resolution)
    top = occupancy.height - grid.offset[1] - rows
    return (
        min(grid.offset[0], math.floor(column.min()) - reach),
        min(top, math.floor(row.min()) - reach),
        max(grid.offset[0] + columns, math.ceil(column.max()) + reach),
        max(top + rows, math.ceil(row.max()) + reach),
    )


def _draw_map(assets: MapAssets, config: Config, crop: tuple[int, int, int, int], size: tuple[int, int]) -> Image:
    occupancy, grid = assets.occupancy, assets.grid
    free = occupancy.game_free(config.pellets.free_grey)
    wall = (occupancy.occupancy >= 65) & ~free
    reach = 2 * math.ceil(config.robot.inscribed_radius_m / occupancy.resolution) + 1
    around = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (reach, reach))
    played = cv2.dilate(np.flipud(grid.cell_id >= 0).astype(np.uint8), around)
    c0, r0, c1, r1 = crop
    # The crop and the grid can both reach beyond the image.
    columns, rows = np.arange(c0, c1), np.arange(r0, r1)[:, None]
    inside = (columns >= 0) & (columns < occupancy.width) & (rows >= 0) & (rows < occupancy.height)
    at = rows.clip(0, occupancy.height - 1), columns.clip(0, occupancy.width - 1)
    free, wall = free[at] & inside, wall[at] & inside
    reachable = np.zeros(free.shape, dtype=np.bool_)
    top, left = occupancy.height - grid.offset[1] - grid.shape[0] - r0, grid.offset[0] - c0
    reachable[top : top + grid.shape[0], left : left + grid.shape[1]] = played > 0
    factor = max(size[0] / (c1 - c0), size[1] / (r1 - r0))
    if factor < 1:  # thin walls would fade
        wall = cv2.dilate(wall.astype(np.uint8), np.ones((2, 2), np.uint8)) > 0
    colours = np.full((*free.shape, 3), UNKNOWN, dtype=np.uint8)
    colours[free] = OUT_OF_REACH
    colours[free & reachable] = FLOOR
    colours[wall] = WALL
    if factor > 1:  # whole blocks first: edges of cells stay sharp, whatever the scale
        k = math.ceil(factor)
        colours = np.repeat(np.repeat(colours, k, axis=0), k, axis=1)
    return cv2.resize(colours, size, interpolation=cv2.INTER_AREA)


@functools.lru_cache(maxsize=_KEPT_VIEWS)
def map_view(assets: MapAssets, config: Config, height: int, wide: bool = False) -> MapView:
    """The view of a map, kept for the next frame."""
    return MapView(assets, config, height, wide)


def game_view(batch: GameBatch, game: int, height: int) -> MapView:
    """The view of the map that a game is played on; all views of one batch have the same size."""
    return map_view(batch.assets_of(game), batch.config, height, len(batch.levels) > 1)


def render_frame(batch: GameBatch, game: int, *, height: int = 720, title: str | None = None) -> Image:
    """Draw one game of a batch as it is now.

    The map lies as its image does: x to the right and y up where the map's origin has no yaw. The robot is where it
    truly is; its believed pose is an outline. Width and height are even; the width follows the map, up to 16:9, which
    it always is where maps come and go.

    Args:
        batch: the games; not changed.
        game: index of the game.
        height: px, even.
        title: text at the upper left, such as the policy's name; None: the map's name alone.

    Returns:
        A new array (height, width, 3), uint8, RGB.

    Raises:
        ValueError: ``height`` is odd or below 120.
        IndexError: there is no such game.
    """
    if not 0 <= game < batch.n:
        raise IndexError(f"game = {game}: the batch has games 0..{batch.n - 1}")
    view = game_view(batch, game, height)
    assets = view.assets
    g = batch.games[game]
    image = view.layer(batch.alive[game, : assets.pellets]).copy()
    ghosts = batch.ghosts[game]
    places = view.pixels(np.stack([ghosts["x"], ghosts["y"]], axis=1))
    danger = batch.config.execution.death_radius_m * view.scale * view.enlarged
    for place in places:
        symbols.catch_circle(image, place, danger, view.line)
    _draw_goal(image, view, batch, game)
    robot = view.pixels(np.array([g["x"], g["y"]]))
    symbols.pac_man(image, robot, view.body_px, view.angle(float(g["heading"])))
    if not batch.config.localization.perfect:
        x, y, heading = _believed(g, batch.config)
        believed = view.pixels(np.array([x, y]))
        symbols.believed_pose(image, believed, view.body_px, view.angle(heading), view.line)
    for number, (ghost, place) in enumerate(zip(ghosts, places, strict=True)):
        look = _look(view, float(ghost["vx"]), float(ghost["vy"]))
        symbols.ghost(image, place, view.body_px, look, symbols.GHOSTS[number])
    _draw_header(image, view, batch, game, title)
    return image


def _believed(g: Any, config: Config) -> tuple[float, float, float]:
    """The pose that the executor acts on."""
    if config.execution.pose_source == "amcl":
        return float(g["amcl_x"]), float(g["amcl_y"]), float(g["amcl_heading"])
    x, y, heading = (float(g[name] + g[f"error_{name}"]) for name in ("x", "y", "heading"))
    return x, y, heading


def _look(view: MapView, vx: float, vy: float) -> NDArray[np.float64]:
    """Direction in the picture of a velocity, (2,); ahead of the viewer where there is none."""
    if vx == 0 and vy == 0:
        return np.zeros(2)
    angle = view.angle(math.atan2(vy, vx))
    return np.array([math.cos(angle), math.sin(angle)])


def _draw_goal(image: Image, view: MapView, batch: GameBatch, game: int) -> None:
    """The plan being driven, from the robot on, and the candidate pursued."""
    g, assets = batch.games[game], batch.assets_of(game)
    points, at, goal = int(g["nav_points"]), int(g["nav_at"]), int(g["nav_goal"])
    if goal >= 0 and points > 0:
        written = batch.paths[game, at:points].astype(np.float64)
        rest = _rest_of_plan(assets, int(g["nav_tail"]), goal, written[-1])
        robot, *way = view.pixels(np.concatenate([[(g["x"], g["y"])], written[1:], rest]))
        symbols.plan(image, _outside(np.array(way).reshape(-1, 2), robot, view.body_px), 1.6 * view.line)
    pursued = int(g["pursued"])
    if pursued >= 0:
        if pursued < batch.pellet_slots:
            centre = view.goals[pursued]
            symbols.pellet(image, centre, view.pellet_px, True)
        else:
            centre = view.goals[assets.pellets + pursued - batch.pellet_slots]
        symbols.goal_ring(image, centre, max(1.9 * view.pellet_px, 1.4 * view.mark_px), 1.3 * view.line)


def _outside(way: NDArray, centre: NDArray, radius: float) -> NDArray[np.float64]:
    """The way (P, 2) from the edge of a disc on: within it, it would fill Pac-Man's mouth."""
    away = np.hypot(way[:, 0] - centre[0], way[:, 1] - centre[1])
    if not (away > radius).any():
        return way[:0]
    first = int((away > radius).argmax())
    edge = centre + (way[first] - centre) * (radius / away[first])
    return np.concatenate([[edge], way[first:]])


def _rest_of_plan(assets: MapAssets, cell: int, goal: int, end: NDArray) -> NDArray[np.float64]:
    """The static path from the end of the plan that the navigator has written out to the goal, (M, 2)."""
    places: list[NDArray] = []
    if cell >= 0 and np.array_equal(assets.cell_xy[cell], end.astype(np.float32)):
        step = assets.next_step[goal]
        while step[cell] not in (AT_GOAL, NO_STEP):
            cell += int(step[cell])
            places.append(assets.cell_xy[cell])
        places.append(assets.goal_xy[goal])
    return np.array(places, dtype=np.float64).reshape(-1, 2)


def _draw_header(image: Image, view: MapView, batch: GameBatch, game: int, title: str | None) -> None:
    g, unit = batch.games[game], view.unit
    left, right = max(14 * unit, 6), view.width - max(14 * unit, 6)
    state, back, front = STATES[int(g["end"])]
    chip = symbols.text(state, max(11 * unit, 6), True, front, back)
    pad, high = max(9 * unit, 4), max(11 * unit, 7)
    upper, lower = 0.31 * view.header, 0.73 * view.header
    x = right - chip.shape[1] - 2 * pad
    cv2.rectangle(image, (round(x), round(upper - high)), (round(right), round(upper + high)), back, -1)
    symbols.paste(image, x + pad, upper, chip)
    name = batch.assets_of(game).occupancy.name
    pieces = [(title, TEXT), (name, MUTED)] if title else [(name, TEXT)]
    at = left
    for text, colour in pieces:
        picture = symbols.text(text, max(15 * unit, 7), colour == TEXT, colour, HEADER)
        symbols.paste(image[:, : round(x - pad)], at, upper, picture)
        at += picture.shape[1] + max(12 * unit, 5)
    seconds = int(g["step"] * batch.config.physics_step_s)
    lost = f" ({g['lost']} lost)" if g["lost"] else ""
    endless = [("round", str(g["round"])), ("score", str(g["score"]))] if batch.config.endless else []
    at = left
    for label, value in (
        ("time", f"{seconds // 60:02d}:{seconds % 60:02d}"),
        ("pellets", f"{g['collected']}/{g['spawned']}{lost}"),
        ("Clyde" if batch.ghosts.shape[1] == 1 else "ghosts", f"{g['clyde_speed']:.2f} m/s"),
        *endless,
    ):
        for text, colour, gap in ((label, MUTED, 6), (value, TEXT, 26)):
            picture = symbols.text(text, max(12.5 * unit, 6), colour == TEXT, colour, HEADER)
            symbols.paste(image, at, lower, picture)
            at += picture.shape[1] + max(gap * unit, gap / 3)
