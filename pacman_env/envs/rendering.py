"""Pictures of a game: the map, what is on it, and the score, as RGB arrays drawn with OpenCV.

Everything that does not move is drawn once per map, configuration and size, and kept. Windows and video files are
made elsewhere.
"""

from __future__ import annotations

import functools
import math
from collections import OrderedDict
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..config import Config
from ..sim.assets import MapAssets
from ..sim.batch import GameBatch
from ..sim.kernels import CLEARED, COMPLETE, DEAD, RUNNING, TIMEOUT
from ..world.paths import AT_GOAL, NO_STEP

Image = NDArray[np.uint8]
Colour = tuple[int, int, int]  # RGB

FLOOR, WALL, UNKNOWN, OUT_OF_PLAY = (252, 252, 249), (44, 50, 66), (198, 202, 208), (228, 230, 232)
HEADER, TEXT, MUTED, PAGE, INK = (27, 31, 43), (245, 246, 248), (160, 168, 182), (240, 241, 243), (38, 42, 54)
PAC, OUTLINE, GHOST, DANGER = (255, 214, 0), (48, 42, 24), (255, 140, 26), (214, 40, 40)
PLAN, BELIEF, REFUGE, RING = (25, 103, 210), (142, 36, 170), (0, 128, 110), (176, 180, 186)
STATES: dict[int, tuple[str, Colour, Colour]] = {  # text, background, text's colour
    RUNNING: ("RUNNING", (46, 125, 50), (255, 255, 255)),
    DEAD: ("CAUGHT", (200, 32, 32), (255, 255, 255)),
    COMPLETE: ("COMPLETE", (255, 214, 0), (30, 30, 30)),
    CLEARED: ("CLEARED", (240, 200, 120), (30, 30, 30)),
    TIMEOUT: ("TIME-OUT", (120, 126, 140), (255, 255, 255)),
}

_SHIFT = 4  # fractional bits of the coordinates given to OpenCV
_OVERSAMPLE = 4
_KEPT_VIEWS, _KEPT_LAYERS = 8, 4
_MOUTH = math.radians(36)  # half of Pac-Man's mouth
_OPENCV_5 = int(cv2.__version__.split(".")[0]) >= 5  # from there on fonts have weights instead of strokes


def _fixed(points: Any) -> NDArray[np.int32]:
    return np.rint(np.asarray(points, dtype=np.float64) * (1 << _SHIFT)).astype(np.int32)


def _disc(image: Image, centre: Any, radius: float, colour: Colour, thickness: int = -1) -> None:
    x, y = _fixed(centre).tolist()
    cv2.circle(image, (x, y), round(radius * (1 << _SHIFT)), colour, thickness, cv2.LINE_AA, _SHIFT)


def _polygon(image: Image, points: Any, fill: Colour, outline: Colour | None = None, thickness: int = 1) -> None:
    fixed = [_fixed(points)]
    cv2.fillPoly(image, fixed, fill, cv2.LINE_AA, _SHIFT)
    if outline is not None:
        cv2.polylines(image, fixed, True, outline, thickness, cv2.LINE_AA, _SHIFT)


def _line(image: Image, points: Any, colour: Colour, thickness: int) -> None:
    cv2.polylines(image, [_fixed(points)], False, colour, thickness, cv2.LINE_AA, _SHIFT)


def _arc(start: float, end: float, count: int) -> NDArray[np.float64]:
    angle = np.linspace(start, end, count)
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


_PAC_SHAPE = np.concatenate([_arc(_MOUTH, 2 * math.pi - _MOUTH, 40), [(-0.12, 0.0)]])
_SKIRT = [(x, 1.0 - 0.28 * abs(math.sin(1.5 * math.pi * (x + 1)))) for x in np.linspace(1, -1, 25)]
_GHOST_SHAPE = np.concatenate([_arc(math.pi, 2 * math.pi, 24) * (1, 1) + (0, -0.05), _SKIRT]) * (0.92, 1.0)
_DASHES = [_arc(k * math.pi / 9, (k + 0.55) * math.pi / 9, 4) for k in range(18)]
_HOUSE_SHAPE = np.array([(0, -1.05), (1.1, -0.05), (0.8, -0.05), (0.8, 0.9), (-0.8, 0.9), (-0.8, -0.05), (-1.1, -0.05)])
_DOOR_SHAPE = np.array([(-0.25, 0.9), (-0.25, 0.2), (0.25, 0.2), (0.25, 0.9)])
_DIAMOND_SHAPE = np.array([(0, -1.0), (0.8, 0), (0, 1.0), (-0.8, 0)])


def _pac_man(image: Image, centre: NDArray, radius: float, angle: float, thickness: int) -> None:
    c, s = math.cos(angle), math.sin(angle)
    _polygon(image, centre + radius * _PAC_SHAPE @ np.array([(c, s), (-s, c)]), PAC, OUTLINE, thickness)


def _ghost(image: Image, centre: NDArray, radius: float, look: NDArray, thickness: int) -> None:
    _polygon(image, centre + radius * _GHOST_SHAPE, GHOST, OUTLINE, thickness)
    for side in (-0.37, 0.37):
        eye = centre + radius * (np.array([side, -0.22]) + 0.10 * look)
        _disc(image, eye, 0.29 * radius, (255, 255, 255))
        _disc(image, eye + 0.13 * radius * look, 0.16 * radius, (22, 40, 110))


def _dashed_circle(image: Image, centre: NDArray, radius: float, colour: Colour, thickness: int) -> None:
    cv2.polylines(image, [_fixed(centre + radius * d) for d in _DASHES], False, colour, thickness, cv2.LINE_AA, _SHIFT)


def _belief(image: Image, centre: NDArray, radius: float, angle: float, thickness: int) -> None:
    _disc(image, centre, radius, BELIEF, thickness)
    direction = np.array([math.cos(angle), math.sin(angle)])
    _line(image, [centre + 0.55 * radius * direction, centre + 1.45 * radius * direction], BELIEF, thickness)


def _pellet(image: Image, centre: NDArray, radius: float, alive: bool, thickness: int) -> None:
    if alive:
        _disc(image, centre, radius + 0.5 * thickness, OUTLINE)
        _disc(image, centre, radius - 0.5 * thickness, PAC)
    else:
        _disc(image, centre, radius, RING, 1)


def _house(image: Image, centre: NDArray, radius: float) -> None:
    _polygon(image, centre + radius * _HOUSE_SHAPE, REFUGE, REFUGE)
    _polygon(image, centre + radius * _DOOR_SHAPE, FLOOR)


def _diamond(image: Image, centre: NDArray, radius: float, thickness: int) -> None:
    _polygon(image, centre + radius * _DIAMOND_SHAPE, (214, 240, 234), REFUGE, thickness)


@functools.lru_cache(maxsize=512)
def _text(text: str, cap: float, bold: bool, colour: Colour, background: Colour) -> Image:
    """The text as a picture, ``cap`` px high capitals, base line at the same row for the same ``cap``."""
    size = cap * _OVERSAMPLE
    stroke = max(1, round(size * (0.2 if bold else 0.11)))
    if _OPENCV_5 and not bold:
        stroke = 1
    plain = text.encode("ascii", "replace").decode()  # OpenCV 4 draws nothing else
    scale = size / 22
    width = cv2.getTextSize(plain, cv2.FONT_HERSHEY_SIMPLEX, scale, stroke)[0][0]
    rows, columns = math.ceil(1.7 * cap), math.ceil(width / _OVERSAMPLE) + 2
    canvas = np.zeros((rows * _OVERSAMPLE, columns * _OVERSAMPLE), dtype=np.uint8)
    origin = (_OVERSAMPLE, round(1.3 * size))
    cv2.putText(canvas, plain, origin, cv2.FONT_HERSHEY_SIMPLEX, scale, 255, stroke, cv2.LINE_AA)
    share = cv2.resize(canvas, (columns, rows), interpolation=cv2.INTER_AREA)[:, :, None] / 255.0
    return np.rint((1 - share) * background + share * np.array(colour)).astype(np.uint8)


def _put(image: Image, x: float, middle: float, picture: Image) -> None:
    """Paste at column ``x``, centred on row ``middle``, cut where it does not fit."""
    left, top = max(round(x), 0), max(round(middle - 0.47 * picture.shape[0]), 0)
    height, width = image.shape[0] - top, image.shape[1] - left
    if height > 0 and width > 0:
        picture = picture[:height, :width]
        image[top : top + picture.shape[0], left : left + picture.shape[1]] = picture


class MapView:
    """What all frames of one map, configuration and height share.

    Attributes:
        width: of a frame, px; ``height`` likewise.
        scale: px per m.
        enlarged: how many times larger than life the robot and Clyde are drawn so that they can be seen.
        background: (height, width, 3) RGB, everything that never changes.
    """

    def __init__(self, assets: MapAssets, config: Config, height: int) -> None:
        """Lay out and draw everything that stands still.

        Raises:
            ValueError: ``height`` is not an even number of at least 120.
        """
        if height < 120 or height % 2:
            raise ValueError(f"height = {height!r}: must be an even number of at least 120")
        self.assets, self.config, self.height = assets, config, height
        self.unit = height / 720
        self.stroke = max(1, round(1.5 * self.unit))
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
                _pellet(picture, centre, self.pellet_px, there, self.stroke)
            self._layers[key] = picture
            while len(self._layers) > _KEPT_LAYERS:
                self._layers.popitem(last=False)
        return picture

    def _arrange(self) -> None:
        """The largest map beside a header and a legend of as many lines as they need; no legend if too many."""
        height, unit = self.height, self.unit
        c0, r0, c1, r1 = self._crop
        margin = math.ceil(10 * unit)
        widest = int(height * 16 / 9) // 2 * 2
        narrowest = min(max(round(0.75 * height), 300), widest)
        line = math.ceil(max(24 * unit, 13))
        for count in (1, 2, 3, 4, 0):
            legend = count * line + (margin if count else 0)
            header = math.ceil(max(70 * unit, 36))
            factor = min((height - header - legend - 2 * margin) / (r1 - r0), (widest - 2 * margin) / (c1 - c0))
            self._map = max(round(factor * (c1 - c0)), 1), max(round(factor * (r1 - r0)), 1)
            self.width = min(max(self._map[0] + 2 * margin, narrowest) + 1, widest) // 2 * 2
            self._set_scale(self._map[1] / (r1 - r0) / self.assets.occupancy.resolution)
            lines = self._legend_lines(self.width - 2 * margin)
            if len(lines) <= count and legend <= 0.16 * height:
                break
        self._legend = lines if count else []
        self.header, self._legend_top, self._line, self._margin = header, height - legend, line, margin
        self._left = (self.width - self._map[0]) // 2
        self._top = header + (height - header - legend - self._map[1]) // 2

    def _set_scale(self, scale: float) -> None:
        unit, radius = self.unit, self.config.robot.radius_m
        self.scale = scale
        self.body_px = max(radius * scale, 7.0 * unit, 4.0)
        self.enlarged = self.body_px / (radius * scale)
        self.pellet_px = min(max(0.075 * scale, 3.2 * unit, 2.0), max(6.0 * unit, 2.0))
        self.mark_px = min(max(0.11 * scale, 5.5 * unit, 3.5), max(9.0 * unit, 3.5))

    def _legend_items(self) -> list[tuple[float, Callable[[Image, NDArray], None], Image]]:
        """Half-width of the symbol, how it is drawn, text."""
        r, t, cap = max(7.5 * self.unit, 4.0), self.stroke, max(9.5 * self.unit, 5.5)
        bar_m = next(m for m in (1, 2, 5, 10, 20, 50, 100, 1000) if m * self.scale >= 40 * self.unit)
        bar, away = bar_m * self.scale / 2, np.array([0.3, 0.1])

        def scale_bar(image: Image, at: NDArray) -> None:
            for x in (-bar, bar):
                _line(image, [at + (x, -0.5 * r), at + (x, 0.5 * r)], INK, t)
            _line(image, [at - (bar, 0), at + (bar, 0)], INK, t)

        def plan(image: Image, at: NDArray) -> None:
            _line(image, [at - (1.6 * r, 0), at + (0.9 * r, 0)], PLAN, 2 * t)
            _pursued(image, at + (0.9 * r, 0), 0.75 * r, 2 * t)

        times = f" ({self.enlarged:.1f}x)" if self.enlarged > 1.05 else ""
        entries: list[tuple[str, float, Callable[[Image, NDArray], None]]] = [
            (f"{bar_m} m", bar, scale_bar),
            (f"robot{times}", r, lambda i, at: _pac_man(i, at, r, 0.0, t)),
            ("its belief", r, lambda i, at: _belief(i, at, 0.8 * r, 0.0, t)),
            (f"Clyde{times}", r, lambda i, at: _ghost(i, at, r, away, t)),
            ("he catches within", r, lambda i, at: _dashed_circle(i, at, r, DANGER, t)),
            ("pellet", 0.6 * r, lambda i, at: _pellet(i, at, 0.6 * r, True, t)),
            ("collected", 0.6 * r, lambda i, at: _pellet(i, at, 0.6 * r, False, t)),
            ("goal and plan", 1.6 * r, plan),
            ("home", r, lambda i, at: _house(i, at, r)),
            ("refuge", r, lambda i, at: _diamond(i, at, r, t)),
        ]
        if self.config.localization.perfect:
            del entries[2]
        return [(half, draw, _text(label, cap, False, INK, PAGE)) for label, half, draw in entries]

    def _legend_lines(self, room: int) -> list[list[tuple[float, Callable[[Image, NDArray], None], Image]]]:
        """The items, broken into lines of at most ``room`` px."""
        lines: list[list[tuple[float, Callable[[Image, NDArray], None], Image]]] = [[]]
        used = 0.0
        for item in self._legend_items():
            width = self._item_width(item)
            if lines[-1] and used + width > room:
                lines.append([])
                used = 0.0
            lines[-1].append(item)
            used += width
        return lines

    def _item_width(self, item: tuple[float, Any, Image]) -> float:
        return 2 * item[0] + item[2].shape[1] + max(22 * self.unit, 11)

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
            _diamond(image, centre, self.mark_px, self.stroke)
        _house(image, home, 1.15 * self.mark_px)
        for k, line in enumerate(self._legend):
            spare = self.width - 2 * self._margin - sum(map(self._item_width, line))
            gap = max(22 * self.unit, 11)
            x = self._margin + (spare + gap) / 2
            y = self._legend_top + self._margin / 2 + (k + 0.5) * self._line
            for half, draw, text in line:
                draw(image, np.array([x + half, y]))
                _put(image, x + 2 * half + 0.35 * gap, y, text)
                x += self._item_width((half, draw, text))
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
    colours = np.empty((r1 - r0, c1 - c0, 3), dtype=np.uint8)
    colours[:] = UNKNOWN
    # The crop and the grid can both reach beyond the image.
    top, left = max(r0, 0), max(c0, 0)
    bottom, right = min(r1, occupancy.height), min(c1, occupancy.width)
    inner = colours[top - r0 : bottom - r0, left - c0 : right - c0]
    free, wall = free[top:bottom, left:right], wall[top:bottom, left:right]
    reachable = np.zeros((r1 - r0, c1 - c0), dtype=np.uint8)
    grid_top = occupancy.height - grid.offset[1] - grid.shape[0] - r0
    grid_left = grid.offset[0] - c0
    reachable[grid_top : grid_top + grid.shape[0], grid_left : grid_left + grid.shape[1]] = played
    reachable = reachable[top - r0 : bottom - r0, left - c0 : right - c0]
    width, height = size
    factor = max(width / (c1 - c0), height / (r1 - r0))
    if factor < 1:  # thin walls would fade
        wall = cv2.dilate(wall.astype(np.uint8), np.ones((2, 2), np.uint8)) > 0
    inner[free] = OUT_OF_PLAY
    inner[free & (reachable > 0)] = FLOOR
    inner[wall] = WALL
    if factor > 1:  # whole blocks first: edges of cells stay sharp, whatever the scale
        k = math.ceil(factor)
        colours = np.repeat(np.repeat(colours, k, axis=0), k, axis=1)
    return cv2.resize(colours, size, interpolation=cv2.INTER_AREA)


@functools.lru_cache(maxsize=_KEPT_VIEWS)
def map_view(assets: MapAssets, config: Config, height: int) -> MapView:
    """The view of a map, kept for the next frame."""
    return MapView(assets, config, height)


def render_frame(batch: GameBatch, game: int, *, height: int = 720, title: str | None = None) -> Image:
    """Draw one game of a batch as it is now.

    The map lies as its image does: x to the right and y up where the map's origin has no yaw. The robot is where it
    truly is; its believed pose is an outline. Width and height are even; the width follows the map, up to 16:9.

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
    view = map_view(batch.assets, batch.config, height)
    g = batch.games[game]
    image = view.layer(batch.alive[game, : batch.assets.pellets]).copy()
    clyde = view.pixels(np.array([g["clyde_x"], g["clyde_y"]]))
    danger = batch.config.execution.death_radius_m * view.scale * view.enlarged
    _shade(image, clyde, danger)
    _draw_goal(image, view, batch, game)
    robot = view.pixels(np.array([g["x"], g["y"]]))
    _pac_man(image, robot, view.body_px, view.angle(float(g["heading"])), view.stroke)
    if not batch.config.localization.perfect:
        x, y, heading = _believed(g, batch.config)
        centre = view.pixels(np.array([x, y]))
        _belief(image, centre, view.body_px, view.angle(heading), view.stroke)
    _dashed_circle(image, clyde, danger, DANGER, view.stroke)
    _ghost(image, clyde, view.body_px, _look(view, float(g["clyde_vx"]), float(g["clyde_vy"])), view.stroke)
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


def _shade(image: Image, centre: NDArray, radius: float) -> None:
    """A transparent disc."""
    x0, y0 = (np.maximum(np.floor(centre - radius - 2), 0)).astype(int)
    x1, y1 = np.ceil(centre + radius + 3).astype(int)
    patch = image[y0:y1, x0:x1]
    if patch.size:
        tinted = patch.copy()
        _disc(tinted, centre - (x0, y0), radius, DANGER)
        patch[:] = cv2.addWeighted(patch, 0.86, tinted, 0.14, 0)


def _pursued(image: Image, centre: NDArray, radius: float, thickness: int) -> None:
    _disc(image, centre, radius, PLAN, thickness)


def _draw_goal(image: Image, view: MapView, batch: GameBatch, game: int) -> None:
    """The plan being driven, from the robot on, and the candidate pursued."""
    g, assets = batch.games[game], batch.assets
    points, at, goal = int(g["nav_points"]), int(g["nav_at"]), int(g["nav_goal"])
    thickness = 2 * view.stroke
    if goal >= 0 and points > 0:
        rest = [batch.paths[game, at:points].astype(np.float64)]
        rest.append(_rest_of_plan(assets, int(g["nav_tail"]), goal, rest[0][-1]))
        robot = np.array([[g["x"], g["y"]]])
        _line(image, view.pixels(np.concatenate([robot, rest[0][1:], rest[1]])), PLAN, thickness)
    pursued = int(g["pursued"])
    if pursued >= 0:
        slot = pursued if pursued < batch.pellet_slots else assets.pellets + pursued - batch.pellet_slots
        if slot < assets.pellets:
            _pellet(image, view.goals[slot], 1.25 * view.pellet_px, True, view.stroke)
        _pursued(image, view.goals[slot], 2.2 * max(view.pellet_px, 0.7 * view.mark_px), thickness)


def _rest_of_plan(assets: MapAssets, cell: int, goal: int, end: NDArray) -> NDArray[np.float64]:
    """What the navigator has not written out yet: the static path from the end of the plan to the goal, (M, 2)."""
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
    chip = _text(state, max(11 * unit, 6), True, front, back)
    pad, high = max(9 * unit, 4), max(11 * unit, 7)
    upper, lower = 0.31 * view.header, 0.73 * view.header
    x = right - chip.shape[1] - 2 * pad
    cv2.rectangle(image, (round(x), round(upper - high)), (round(right), round(upper + high)), back, -1)
    _put(image, x + pad, upper, chip)
    name = batch.assets.occupancy.name
    pieces = [(title, TEXT), (name, MUTED)] if title else [(name, TEXT)]
    at = left
    for text, colour in pieces:
        picture = _text(text, max(15 * unit, 7), colour == TEXT, colour, HEADER)
        _put(image[:, : round(x - pad)], at, upper, picture)
        at += picture.shape[1] + max(12 * unit, 5)
    seconds = int(g["step"] * batch.config.physics_step_s)
    lost = f" ({g['lost']} lost)" if g["lost"] else ""
    at = left
    for label, value in (
        ("time", f"{seconds // 60:02d}:{seconds % 60:02d}"),
        ("pellets", f"{g['collected']}/{g['spawned']}{lost}"),
        ("Clyde", f"{g['clyde_speed']:.2f} m/s"),
    ):
        for text, colour, gap in ((label, MUTED, 6), (value, TEXT, 26)):
            picture = _text(text, max(12.5 * unit, 6), colour == TEXT, colour, HEADER)
            _put(image, at, lower, picture)
            at += picture.shape[1] + max(gap * unit, gap / 3)
