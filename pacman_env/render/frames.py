"""Draw images of games (map, everything on it, and score) as RGB arrays with OpenCV.

Everything that does not move is drawn once per map, configuration and size, and cached.
"""

import functools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ..config import Config
from ..game.ends import ENDS
from ..game.ghosts import GHOST_NAMES
from ..game.power import BLINKING, FRIGHTENED, HARMLESS_UNTIL, frightened_colour, is_away, is_harmless
from ..levels.assets import MapAssets
from ..sim.batch import GameBatch
from ..world.navigation.paths import AT_GOAL, NO_STEP
from . import symbols
from .palette import THEMES, Colour, Theme
from .symbols import Image

_KEPT_VIEWS, _KEPT_LAYERS = 8, 4
_POWER = 1.8  # size of a power pellet relative to a pellet

_Draw = Callable[[Image, NDArray], None]


class _Item(NamedTuple):
    half: float  # half of the symbol's width, px
    draw: _Draw
    text: Image
    gap: float  # to the next item, px

    @property
    def text_left(self) -> float:
        return 2 * self.half + 0.35 * self.gap

    @property
    def width(self) -> float:
        return self.text_left + self.text.shape[1] + self.gap


def _wrap(items: list[_Item], room: float) -> list[list[_Item]]:
    """Wrap items into lines of at most ``room`` px; a wider item has its own line, and no items give one empty line."""
    lines: list[list[_Item]] = [[]]
    for item in items:
        if lines[-1] and sum(i.width for i in lines[-1]) + item.width > room:
            lines.append([])
        lines[-1].append(item)
    return lines


class MapView:
    """Common part of all frames of one map, configuration and height; ``wide`` makes it 16:9 for every map.

    Widths and heights are in px (``height`` even, at least 120), ``scale`` in px per m. ``enlarged`` is the factor by
    which robot and ghosts are drawn larger than their real size to be visible.
    """

    def __init__(
        self, assets: MapAssets, config: Config, height: int, wide: bool = False, theme: Theme = "light"
    ) -> None:
        if height < 120 or height % 2:
            raise ValueError(f"height = {height!r}: must be an even number of at least 120")
        if theme not in THEMES:
            raise ValueError(f"theme = {theme!r}: must be {' or '.join(THEMES)}")
        self.colours = THEMES[theme]
        self.assets, self.config, self.height, self._wide = assets, config, height, wide
        self.unit = height / 720
        self.line = max(1.5 * self.unit, 0.9)  # width of lines
        self._power = assets.power_pellets(config.power.pellets)
        self._corner, self._cells = _crop(assets)
        self._arrange()
        self.goals = self.pixels(assets.goal_xy)
        self.sizes = np.where(self._power, _POWER, 1.0) * self.pellet_px
        self.background = self._background()
        self._drawn = functools.lru_cache(maxsize=_KEPT_LAYERS)(self._draw_layer)

    @property
    def enlarged(self) -> float:
        return self.body_px / (self.config.robot.radius_m * self.scale)

    def pixels(self, xy: NDArray[np.floating]) -> NDArray[np.float64]:
        """Convert positions (..., 2) in m to pixels (..., 2), whole numbers at pixel centres."""
        cell = np.stack(self.assets.occupancy.world_to_cell(xy[..., 0], xy[..., 1]), axis=-1)
        return (cell + 0.5 - self._corner) * (self._map / self._cells) + self._left_top - 0.5

    def angle(self, heading: float) -> float:
        """Convert a heading in the map frame to an angle in the image, where y points down."""
        return self.assets.occupancy.origin[2] - heading

    def layer(self, alive: NDArray[np.bool_]) -> Image:
        """Return the cached image of the map with its pellets, remaining if ``alive`` (P,); it must not be changed."""
        return self._drawn(alive.tobytes())

    def _draw_layer(self, alive: bytes) -> Image:
        picture = self.background.copy()
        for centre, exists, size in zip(self.goals, alive, self.sizes, strict=False):
            symbols.pellet(picture, self.colours, centre, size, bool(exists))
        return picture

    def _arrange(self) -> None:
        """Arrange header, map and legend: the largest possible map, and no legend if it needs too many lines."""
        height, unit = self.height, self.unit
        columns, rows = self._cells.tolist()
        margin = math.ceil(10 * unit)
        widest = int(height * 16 / 9) // 2 * 2
        narrowest = widest if self._wide else min(max(round(0.85 * height), 300), widest)
        row, self.header = math.ceil(max(24 * unit, 13)), math.ceil(max(70 * unit, 36))
        for count in (1, 2, 3, 4, 0):
            legend = count * row + (margin if count else 0)
            room = height - self.header - legend - 2 * margin
            factor = min(room / rows, (widest - 2 * margin) / columns)
            self._map = np.maximum(np.rint(factor * self._cells).astype(int), 1)
            self.width = min(max(int(self._map[0]) + 2 * margin, narrowest) + 1, widest) // 2 * 2
            self._set_scale(self._map[1] / rows / self.assets.occupancy.resolution)
            items, across = self._legend_items(), self.width - 2 * margin
            if len(_wrap(items, across)) <= count and legend <= 0.16 * height:
                break
        while count and len(_wrap(items, across - 4)) == count:  # balance the lengths of the lines
            across -= 4
        self._legend = _wrap(items, across) if count else []
        self._legend_top = height - legend
        self._legend_rows = [self._legend_top + margin / 2 + (k + 0.5) * row for k in range(count)]
        free = np.array([self.width, height - self.header - legend]) - self._map
        self._left_top = free // 2 + (0, self.header)

    def _set_scale(self, scale: float) -> None:
        unit, radius = self.unit, self.config.robot.radius_m
        self.scale = scale
        self.body_px = max(radius * scale, 8.0 * unit, 4.5)
        self.pellet_px = min(max(0.08 * scale, 4.0 * unit, 2.2), max(6.5 * unit, 2.2))
        self.mark_px = min(max(0.11 * scale, 6.0 * unit, 3.5), max(9.0 * unit, 3.5))

    def _legend_items(self) -> list[_Item]:
        r, cap, line = max(8 * self.unit, 4.5), max(9.5 * self.unit, 5.5), self.line
        bar_m = next(m for m in (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000) if m * self.scale >= 28 * self.unit)
        bar, aside, colours = 0.5 * bar_m * self.scale, np.array([1.0, 0.0]), self.colours

        def goal(image: Image, at: NDArray) -> None:
            symbols.plan(image, colours, np.array([at - 1.7 * r * aside, at + 0.3 * r * aside]), 1.6 * line)
            symbols.pellet(image, colours, at + r * aside, 0.4 * r, True)
            symbols.goal_ring(image, colours, at + r * aside, 0.7 * r, line)

        def ghost(colour: Colour | None) -> _Draw:
            return lambda image, at: symbols.ghost(image, colours, at, r, aside, colour)

        times = f" ({self.enlarged:.1f}x)" if self.enlarged > 1.05 else ""
        entries: list[tuple[str, float, _Draw]] = [
            (f"{bar_m} m", bar, lambda i, at: symbols.scale_bar(i, at, bar, 0.5 * r, colours.ink)),
            (f"robot{times}", r, lambda i, at: symbols.pac_man(i, colours, at, r, 0.0)),
        ]
        if not self.config.localization.perfect:
            shift, radius = 0.25 * r * aside, 0.85 * r
            outline: _Draw = lambda i, at: symbols.believed_pose(i, colours, at - shift, radius, 0.0, line)  # noqa: E731
            entries.append(("believed pose", 1.2 * r, outline))
        for name, behaviour, colour in zip(GHOST_NAMES, self.config.clyde.ghosts, symbols.GHOSTS, strict=False):
            does = "" if behaviour == "wander" else f" ({behaviour})"
            entries.append((f"{name.capitalize()}{does}{times}", r, ghost(colour)))
        states = {"frightened": FRIGHTENED, "about to recover": BLINKING, "caught": None}
        power: list[tuple[str, float, _Draw]] = [
            ("power pellet", r, lambda i, at: symbols.pellet(i, colours, at, r, True)),
            *((state, r, ghost(colour)) for state, colour in states.items()),
        ]
        entries += [
            ("catch radius", r, lambda i, at: symbols.catch_circle(i, colours, at, r, line)),
            ("pellet", 0.6 * r, lambda i, at: symbols.pellet(i, colours, at, 0.6 * r, True)),
            ("collected", 0.6 * r, lambda i, at: symbols.pellet(i, colours, at, 0.6 * r, False)),
            *(power if self._power.any() else ()),
            ("goal, plan", 1.7 * r, goal),
            ("home", r, lambda i, at: symbols.home(i, colours, at, 0.95 * r)),
            ("refuge", 0.8 * r, lambda i, at: symbols.refuge(i, colours, at, 0.9 * r)),
        ]
        gap = max(21 * self.unit, 11)
        return [
            _Item(half, draw, symbols.text(name, cap, False, colours.ink, colours.page), gap)
            for name, half, draw in entries
        ]

    def _background(self) -> Image:
        image = np.full((self.height, self.width, 3), self.colours.unknown, dtype=np.uint8)
        image[: self.header] = self.colours.header
        image[self._legend_top :] = self.colours.page
        (left, top), (width, height) = self._left_top, self._map
        image[top : top + height, left : left + width] = self._draw_map()
        home, places = self.goals[self.assets.pellets], self.goals[self.assets.pellets + 1 :]
        for centre in places:
            symbols.refuge(image, self.colours, centre, self.mark_px)
        symbols.home(image, self.colours, home, 1.15 * self.mark_px)
        for line, y in zip(self._legend, self._legend_rows, strict=True):
            x = (self.width - sum(item.width for item in line) + line[-1].gap) / 2
            for item in line:
                item.draw(image, np.array([x + item.half, y]))
                symbols.paste(image, x + item.text_left, y, item.text)
                x += item.width
        return image

    def _draw_map(self) -> Image:
        """Draw the shown part of the map: floor, free area out of the robot's reach, walls and unknown."""
        occupancy, grid, config = self.assets.occupancy, self.assets.grid, self.config
        free = occupancy.game_free(config.pellets.free_grey)
        wall = (occupancy.occupancy >= 65) & ~free
        reach = 2 * math.ceil(config.robot.inscribed_radius_m / occupancy.resolution) + 1
        around = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (reach, reach))
        covered = cv2.dilate(np.flipud(grid.cell_id >= 0).astype(np.uint8), around)
        # Crop and grid may both extend beyond the image.
        columns, rows = (first + np.arange(count) for first, count in zip(self._corner, self._cells, strict=True))
        rows = rows[:, None]
        inside = (columns >= 0) & (columns < occupancy.width) & (rows >= 0) & (rows < occupancy.height)
        at = rows.clip(0, occupancy.height - 1), columns.clip(0, occupancy.width - 1)
        free, wall = free[at] & inside, wall[at] & inside
        reachable = np.zeros(free.shape, dtype=np.bool_)
        left, top = np.array([grid.offset[0], occupancy.height - grid.offset[1] - grid.shape[0]]) - self._corner
        reachable[top : top + grid.shape[0], left : left + grid.shape[1]] = covered > 0
        factor = (self._map / self._cells).max()
        if factor < 1:  # otherwise thin walls would fade
            wall = cv2.dilate(wall.astype(np.uint8), np.ones((2, 2), np.uint8)) > 0
        colours = np.full((*free.shape, 3), self.colours.unknown, dtype=np.uint8)
        colours[free] = self.colours.out_of_reach
        colours[free & reachable] = self.colours.floor
        colours[wall] = self.colours.wall
        if factor > 1:  # repeat cells first, so that their edges stay sharp at every scale
            k = math.ceil(factor)
            colours = np.repeat(np.repeat(colours, k, axis=0), k, axis=1)
        return cv2.resize(colours, self._map.tolist(), interpolation=cv2.INTER_AREA)


def _crop(assets: MapAssets) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return first column and row (from the top) and size (columns, rows) of the cells that a game needs, (2,) each."""
    occupancy, grid = assets.occupancy, assets.grid
    rows, columns = grid.shape
    seen = np.concatenate([assets.goal_xy, assets.clyde.position[assets.spawn_cells]])
    cells = np.stack(occupancy.world_to_cell(seen[:, 0], seen[:, 1]), axis=-1)
    reach = math.ceil(0.5 / occupancy.resolution)
    first = np.array([grid.offset[0], occupancy.height - grid.offset[1] - rows])
    corner = np.minimum(first, np.floor(cells.min(axis=0)).astype(int) - reach)
    end = np.maximum(first + np.array([columns, rows]), np.ceil(cells.max(axis=0)).astype(int) + reach)
    return corner, end - corner


map_view = functools.lru_cache(maxsize=_KEPT_VIEWS)(MapView)


def render_frame(
    batch: GameBatch, game: int, *, height: int = 720, title: str | None = None, theme: Theme = "light"
) -> Image:
    """Draw the present state of one game of a batch.

    The map has the orientation of its image: x to the right and y up if the map's origin has no yaw. The robot is at
    its true pose; an outline shows its believed pose. Width and height are even. The width follows the map, up to 16:9;
    it is always 16:9 if maps change.

    Args:
        batch: the games, which do not change.
        game: index of the game.
        height: height in px, an even number of at least 120.
        title: text at the upper left, such as the policy's name; None: only the map's name.
        theme: "light" or "dark": the colours.

    Returns:
        A new array (height, width, 3), uint8, RGB.

    Raises:
        ValueError: ``height`` is odd or below 120, or there is no such ``theme``.
        IndexError: there is no such game.
    """
    if not 0 <= game < batch.n:
        raise IndexError(f"game = {game}: the batch has games 0..{batch.n - 1}")
    view = map_view(batch.assets_of(game), batch.config, height, len(batch.levels) > 1, theme)
    g, ghosts = batch.games[game], batch.ghosts[game]
    image = view.layer(batch.alive[game, : view.assets.pellets]).copy()
    places = view.pixels(np.stack([ghosts["x"], ghosts["y"]], axis=1))
    danger = batch.config.execution.death_radius_m * view.scale * view.enlarged
    states, step = batch.obstacles[game], int(g["step"])
    for place, state in zip(places, states, strict=True):
        if not is_harmless(state, step):
            symbols.catch_circle(image, view.colours, place, danger, view.line)
    _draw_goal(image, view, batch, game)
    robot = view.pixels(np.array([g["x"], g["y"]]))
    symbols.pac_man(image, view.colours, robot, view.body_px, view.angle(float(g["heading"])))
    if not batch.config.localization.perfect:
        x, y, heading = _believed(g, batch.config)
        believed = view.pixels(np.array([x, y]))
        symbols.believed_pose(image, view.colours, believed, view.body_px, view.angle(heading), view.line)
    for place, vx, vy, state, own in zip(places, ghosts["vx"], ghosts["vy"], states, symbols.GHOSTS, strict=False):
        colour: Colour | None = own
        if is_away(state, step):
            colour = None
        elif is_harmless(state, step):
            left_s = float(state[HARMLESS_UNTIL] - step) * batch.config.physics_step_s
            colour = frightened_colour(left_s, batch.config.power.warning_s)
        angle = view.angle(math.atan2(vy, vx))
        eyes = np.array([math.cos(angle), math.sin(angle)]) if vx or vy else np.zeros(2)
        symbols.ghost(image, view.colours, place, view.body_px, eyes, colour)
    _draw_header(image, view, batch, game, title)
    return image


def _believed(g: Any, config: Config) -> tuple[float, float, float]:
    if config.execution.pose_source == "amcl":
        return float(g["amcl_x"]), float(g["amcl_y"]), float(g["amcl_heading"])
    x, y, heading = (float(g[name] + g[f"error_{name}"]) for name in ("x", "y", "heading"))
    return x, y, heading


def _draw_goal(image: Image, view: MapView, batch: GameBatch, game: int) -> None:
    g, assets = batch.games[game], batch.assets_of(game)
    points, at, goal = int(g["nav_points"]), int(g["nav_at"]), int(g["nav_goal"])
    if goal >= 0 and points > 0:
        written = batch.paths[game, at:points].astype(np.float64)
        rest = _rest_of_plan(assets, int(g["nav_tail"]), goal, written[-1])
        robot, *path = view.pixels(np.concatenate([[(g["x"], g["y"])], written[1:], rest]))
        symbols.plan(image, view.colours, _outside(np.array(path).reshape(-1, 2), robot, view.body_px), 1.6 * view.line)
    pursued = int(g["pursued"])
    if pursued >= 0:
        if pursued < batch.pellet_slots:
            centre = view.goals[pursued]
            symbols.pellet(image, view.colours, centre, view.sizes[pursued], True)
        else:
            centre = view.goals[assets.pellets + pursued - batch.pellet_slots]
        symbols.goal_ring(image, view.colours, centre, max(1.9 * view.pellet_px, 1.4 * view.mark_px), 1.3 * view.line)


def _outside(path: NDArray, centre: NDArray, radius: float) -> NDArray[np.float64]:
    """Return the part of a path (P, 2), px, outside of a disc, so that the path does not fill Pac-Man's mouth."""
    outside = np.hypot(*(path - centre).T) > radius
    if not outside.any():
        return path[:0]
    first = int(outside.argmax())
    edge = centre + (path[first] - centre) * (radius / math.dist(path[first], centre))
    return np.concatenate([[edge], path[first:]])


def _rest_of_plan(assets: MapAssets, cell: int, goal: int, end: NDArray) -> NDArray[np.float64]:
    """Return the static path (M, 2), m, from ``end``, the end of the navigator's plan at ``cell``, to the goal."""
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
    state = ENDS[g["end"]]
    chip = symbols.text(state.name.upper(), max(11 * unit, 6), True, state.ink, state.badge)
    pad, high = max(9 * unit, 4), max(11 * unit, 7)
    upper, lower = 0.31 * view.header, 0.73 * view.header
    x = right - chip.shape[1] - 2 * pad
    cv2.rectangle(image, (round(x), round(upper - high)), (round(right), round(upper + high)), state.badge, -1)
    symbols.paste(image, x + pad, upper, chip)

    def write(words: list[tuple[str, Colour, float]], row: float, cap: float, end: float) -> None:
        """Write words, each with its colour and the gap after it (px), up to the column ``end``."""
        at = left
        for word, colour, gap in words:
            picture = symbols.text(word, cap, colour == view.colours.text, colour, view.colours.header)
            symbols.paste(image[:, : round(end)], at, row, picture)
            at += picture.shape[1] + gap

    name, text, muted = batch.assets_of(game).occupancy.name, view.colours.text, view.colours.muted
    gap = max(12 * unit, 5)
    write([(title, text, gap), (name, muted, gap)] if title else [(name, text, gap)], upper, max(15 * unit, 7), x - pad)
    seconds = int(g["step"] * batch.config.physics_step_s)
    values = {
        "time": f"{seconds // 60:02d}:{seconds % 60:02d}",
        "pellets": f"{g['collected']}/{g['spawned']}" + (f" ({g['lost']} lost)" if g["lost"] else ""),
        "Clyde" if batch.ghosts.shape[1] == 1 else "ghosts": f"{g['clyde_speed']:.2f} m/s",
    }
    power, endless = batch.config.power.pellets > 0, batch.config.endless
    shown = {"caught": power, "round": endless, "score": endless or power}
    values |= {name: str(g[name]) for name, is_shown in shown.items() if is_shown}
    gaps = [max(gap * unit, gap / 3) for gap in (6, 26)]
    pairs = [((label, muted, gaps[0]), (value, text, gaps[1])) for label, value in values.items()]
    write([word for pair in pairs for word in pair], lower, max(12.5 * unit, 6), view.width)
