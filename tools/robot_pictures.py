"""Pictures of the robot guide: screenshots of a simulated game, and drawings of what RViz shows from its messages."""

import html
import math
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from numpy.typing import NDArray
from PIL import Image

from pacman_env.files import write_text
from pacman_env.ros import topics
from pacman_env.ros.message_conversion import points_of, pose_of, transform_of, uncertain_pose_message
from pacman_env.world.navigation.localization import compose
from tests.ros.costmap_model import LETHAL, UNKNOWN, Grid, ObstacleLayer, Pose
from tests.ros.nav2_chain import nav2_yaml
from tests.ros.session import Session, game
from tests.ros.supervisor.terminal import COLUMNS, Terminal

_ROS, _PORT = [sys.executable, "-m", "pacman_env.cli.main", "ros"], "8098"
_UP = ("up", "--map", "house", "--policy", "ppo", "--sim", "--speed", "4")
_WINDOWS = {"the game": (*_UP, "--start"), "its state": ("status", "--sim")}
_WINDOWS["is everything ready?"] = ("doctor", "--sim", "--map", "house")
_LINE_PX, _WINDOW_PX, _FRAME = 17, 24 + 8 * COLUMNS, 'fill="#f6f8fa" stroke="#d0d7de"'
# Colours of RViz: a map from free to occupied, with unknown cells; a costmap from low cost to inscribed and lethal.
_MAP = ListedColormap([(v, v, v) for v in np.linspace(0.98, 0.0, 101)]).with_extremes(under=(0.62, 0.67, 0.67))
_COSTS = ListedColormap([*((v, 0.0, 1 - v) for v in np.linspace(0, 1, 98)), (0, 1, 1), (1, 0, 1)])
_INSCRIBED_M = 0.186  # radius inside the footprint of config/nav2.yaml
_CLOUDS = {topics.CLYDE_OBSTACLE.name: "clyde", topics.CLYDE_TRAIL.name: "clyde_trail"}  # sources of the layer


def save(browser: Any, out: Path) -> None:
    """Write all pictures; ``browser`` is playwright's."""
    with _session() as session:
        for name, draw in (("pose", _initial_pose), ("costmap", _costmap)):
            draw(session).savefig(drawn := BytesIO(), dpi=110)
            _store(drawn.getvalue(), out / f"robot-{name}.webp", lossless=True)
    write_text(out / "robot-terminals.svg", _draw_terminals())
    _shoot_page(browser, out)


@contextmanager
def _session() -> Iterator[Session]:
    exact = ("localization.sigma_xy_m=0", "localization.sigma_yaw_rad=0")
    with (
        tempfile.TemporaryDirectory() as folder,
        game(Path(folder), "house", "ppo", 3, Session, settings=exact) as session,
    ):
        session.record(topics.MAP, topics.SCAN, topics.TF, topics.CLYDE_POSE)
        session.record(topics.CLYDE_OBSTACLE, topics.CLYDE_TRAIL)
        session.advance(1.0)
        yield session


def _believed(session: Session) -> tuple[float, float, float]:
    transforms = [transform_of(one) for message in session.messages(topics.TF)[-8:] for one in message.transforms]
    frames = {parent: pose for parent, _, pose in transforms}
    return compose(frames["map"], frames["odom"])


def _cells(session: Session) -> tuple[NDArray[np.int8], Grid]:
    message = session.latest(topics.MAP)
    cells = np.array(message.data, dtype=np.int8).reshape(message.info.height, message.info.width)
    corner = message.info.origin.position
    return cells, Grid(0, message.info.resolution, corner.x, corner.y)


def _view(axes: Any, session: Session, title: str, middle: Any, half_m: float) -> None:
    """Draw the map and the points of the lidar, as the believed pose places them."""
    (cells, grid), scan = _cells(session), session.latest(topics.SCAN)
    right, top = np.array([grid.x, grid.y]) + grid.resolution * np.array(cells.shape[::-1])
    axes.imshow(cells, _MAP, vmin=0, vmax=100, origin="lower", extent=(grid.x, right, grid.y, top))
    angles, ranges = scan.angle_min + scan.angle_increment * np.arange(len(scan.ranges)), np.array(scan.ranges)
    ends = Pose(*_believed(session))((ranges * [np.cos(angles), np.sin(angles)]).T[np.isfinite(ranges)])
    axes.scatter(*ends.T, s=9, color="#e01020", linewidths=0, zorder=3)
    axes.set(xlim=middle[0] + half_m * np.array([-1, 1]), ylim=middle[1] + half_m * np.array([-1, 1]))
    axes.set(xticks=[], yticks=[])
    axes.set_title(title, fontsize=11, loc="left")


def _initial_pose(session: Session) -> Figure:
    """Draw a wrong initial pose next to a right one, and leave the robot with the right one."""
    figure = Figure(figsize=(9, 4.8), layout="constrained")
    right = Pose(*_believed(session))
    wrong = Pose(right.x + 1.0, right.y - 0.8, right.heading + 0.6)
    titles = "Wrong: the points lie beside the walls. Repeat it.", "Right: the points lie on the walls."
    for axes, title, pose in zip(figure.subplots(1, 2), titles, (wrong, right), strict=True):
        message = uncertain_pose_message(pose.x, pose.y, pose.heading, session.stamp(), (0.25, 0.25, 0.07))
        session.publish(topics.INITIAL_POSE, message)
        session.advance(1.0)
        _view(axes, session, title, (right.x + 1.2, right.y), 4.0)
        end = pose(np.array([[1.2, 0.0]]))[0]
        arrow = {"color": "#00c800", "width": 4, "headwidth": 14, "headlength": 14}
        axes.annotate("", end, (pose.x, pose.y), arrowprops=arrow, zorder=4)
    return figure


def _costmap(session: Session) -> Figure:
    """Play until Clyde is near the robot, and draw the global costmap."""
    session.call(topics.START_GAME)
    session.advance(30.0)
    session.wait_for(lambda: math.dist(_clyde(session), _believed(session)[:2]) < 1.6)
    robot, clyde = np.array(_believed(session)), _clyde(session)
    figure = Figure(figsize=(6.4, 6.6), layout="constrained")
    axes = figure.subplots()
    middle = (clyde + robot[:2]) / 2
    _view(axes, session, "Global costmap: Clyde is an obstacle, and his way behind him is free", middle, 2.4)
    costs, edges = _costs(session, middle, robot)
    axes.imshow(np.ma.masked_equal(costs, 0), _COSTS, vmin=1, vmax=100, origin="lower", extent=edges, alpha=0.8)
    last = [pose_of(one.message)[:2] for one in session.on(topics.CLYDE_POSE) if one.at > session.now_s - 3.0]
    axes.plot(*np.array(last).T, "--", color="#ff8c1a", linewidth=2)
    for name, place, radius_m, colour in (("robot", robot, 0.171, "#ffd500"), ("Clyde", clyde, 0.05, "#ff8c1a")):
        axes.add_patch(Circle((place[0], place[1]), radius_m, facecolor=colour, edgecolor="black", zorder=4))
        axes.annotate(name, (place[0], place[1]), (8, 12), textcoords="offset points", weight="bold", zorder=5)
    return figure


def _clyde(session: Session) -> NDArray[np.float64]:
    return np.array(pose_of(session.latest(topics.CLYDE_POSE))[:2])


def _costs(session: Session, middle: Any, robot: Any) -> tuple[NDArray[np.float64], tuple[float, float, float, float]]:
    """Return costs as RViz shows them (1 to 100; 0: free or unknown) and the edges, with config/nav2.yaml's layers."""
    parameters = nav2_yaml()["global_costmap"]
    cells, grid = _cells(session)
    side = 120
    column, row = grid.cell_of(middle) - side // 2
    part = cells[row : row + side, column : column + side]
    x, y, resolution = grid.x + column * grid.resolution, grid.y + row * grid.resolution, grid.resolution
    layer = ObstacleLayer(
        {**parameters["clyde_layer"], "observation_sources": "clyde clyde_trail"},
        Grid(side, resolution, x, y),
        unknown=parameters["track_unknown_space"],
    )
    for cloud in session.on(topics.CLYDE_OBSTACLE, topics.CLYDE_TRAIL):
        if cloud.at > session.now_s - 5.0:
            layer.seen[_CLOUDS[cloud.topic]].insert(0, (cloud.at, robot[:2], points_of(cloud.message)))
            layer.update(cloud.at)
    costs = layer.laid_over(np.select([part > 0, part < 0], [LETHAL, UNKNOWN], 0))
    inflation = parameters["inflation_layer"]
    away = cv2.distanceTransform((costs != LETHAL).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * resolution
    near = 252 * np.exp(-inflation["cost_scaling_factor"] * (away - _INSCRIBED_M))
    shown = np.select([away == 0, away <= _INSCRIBED_M], [100, 99], 1 + 97 * (near - 1) / 251)
    shown[(away > inflation["inflation_radius"]) | ((costs == UNKNOWN) & (shown < 99))] = 0
    return shown, (x, x + side * resolution, y, y + side * resolution)


def _draw_terminals() -> str:
    """Return an SVG with the output of ``ros up``, and of two commands during its round; ``tools.site`` darkens it."""
    with _up("--start") as (terminal, logs):
        terminal.wait_for(lambda: terminal.shows("pellets 3/"), "a round")
        ask = [[*_ROS, *words] for words in [*_WINDOWS.values()][1:]]
        answers = [subprocess.run(one, capture_output=True, text=True, check=True).stdout for one in ask]
        lines = [line for line in terminal.lines if not re.match("starting|menu|running", line)] + terminal.lines[-1:]
    texts = ["\n".join(lines).replace(logs, "/home/you/.local/state/pacman_env/log/robot_15"), *answers]
    parts, x, y = [], 8, 8
    for k, ((title, words), text) in enumerate(zip(_WINDOWS.items(), texts, strict=True)):
        shown = [f"Terminal {k + 1}: {title}", f"$ pacman-env ros {' '.join(words)}", *text.splitlines()]
        x, y = (x, y) if k < 2 else (_WINDOW_PX + 16, 8)  # the third window has a column of its own
        height = (len(shown) + 1) * _LINE_PX
        parts.append(f'<rect x="{x}" y="{y}" width="{_WINDOW_PX}" height="{height}" rx="8" {_FRAME}/>')
        for n, line in enumerate(shown, start=1):
            style = "xml:space='preserve'" if n > 1 else "font-weight='bold' fill='#57606a'"
            parts.append(f'<text x="{x + 12}" y="{y + n * _LINE_PX + 2}" {style}>{html.escape(line)}</text>')
        y += height + _LINE_PX
    size = f'viewBox="0 0 {2 * _WINDOW_PX + 24} {y}" font-family="monospace" font-size="13" fill="#1b1f24"'
    return "\n".join([f'<svg xmlns="http://www.w3.org/2000/svg" {size}>', *parts, "</svg>\n"])


@contextmanager
def _up(*options: str) -> Iterator[tuple[Terminal, str]]:
    with tempfile.TemporaryDirectory() as logs:
        terminal = Terminal([*_ROS, *_UP, *options, "--logs", logs])
        try:
            yield terminal, logs
        finally:
            terminal.press("q")
            terminal.end()


def _shoot_page(browser: Any, out: Path) -> None:
    """Show the operator's page in the menu, while the robot drives, and at the end of the round."""
    size = {"width": 1200, "height": 760}
    with _up("--web", _PORT) as (terminal, _), browser.new_context(viewport=size, bypass_csp=True) as context:
        terminal.wait_for(lambda: terminal.shows("^menu"), "the menu")
        page = context.new_page()
        page.goto(f"http://127.0.0.1:{_PORT}/")

        def shoot(name: str, state: str) -> None:
            page.wait_for_function(f"(({{frame, scene}}) => {state})(window.pacman?.state ?? {{}})", timeout=240_000)
            page.evaluate("document.activeElement.blur()")
            page.wait_for_timeout(1500)
            _store(page.screenshot(), out / f"robot-{name}.webp")

        page.wait_for_function("window.pacman?.state?.frame && window.pacman.state.scene.map")
        page.dispatch_event("#welcome-close", "click")
        shoot("menu", "frame?.state === 'menu' && Object.values(scene.processes).every((why) => !why)")
        page.click("#start")
        shoot("running", "frame?.collected === 6")
        shoot("end", "!document.getElementById('end').hidden")


def _store(picture: bytes, path: Path, **options: Any) -> None:
    Image.open(BytesIO(picture)).convert("RGB").save(path, quality=60, method=6, **options)
