"""What a picture of a game promises."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pacman_env.config import Config, make_config
from pacman_env.envs.pacmanbot import PacManBotEnv
from pacman_env.game.ends import CAUGHT, CLEARED, COMPLETE, ENDS, RUNNING, TIMEOUT
from pacman_env.game.power import FRIGHTENED
from pacman_env.levels.assets import MapSource, map_assets
from pacman_env.observations.situation_writer import situation_of
from pacman_env.render import symbols
from pacman_env.render.frames import MapView, map_view, render_frame
from pacman_env.render.palette import LIGHT, THEMES, Colour, Theme
from pacman_env.sim.batch import GameBatch
from pacman_env.world.maps.occupancy import OccupancyMap, shipped_maps
from tests.sim.players import new_batch

HEADER = 70  # rows at 720 px


def games(source: MapSource = "house", n: int = 1, config: Config | None = None) -> GameBatch:
    return new_batch(config or make_config(), n, source, first_seed=7)


def corridor(columns: int, rows: int, yaw: float = 0.0) -> OccupancyMap:
    """A room of free cells of 0.05 m with walls around."""
    pixels = np.zeros((rows, columns), dtype=np.uint8)
    pixels[4:-4, 4:-4] = 254
    return OccupancyMap.from_pixels("corridor", pixels, 0.05, (-1.0, -1.0, yaw))


def corridor_view(yaw: float, height: int = 360) -> MapView:
    config = make_config(**{"pellets.spacing_m": 1.0})
    return map_view(map_assets(corridor(120, 100, yaw), config), config, height)


def near(frame: np.ndarray, colour: Colour, within: int = 12) -> np.ndarray:
    """(M, 2) x, y of the map's pixels of about a colour."""
    view = frame[HEADER : -int(0.1 * len(frame))].astype(int)
    rows, columns = np.nonzero((abs(view - colour) <= within).all(axis=-1))
    return np.stack([columns, rows + HEADER], axis=1)


def pixels(batch: GameBatch, x: float, y: float) -> np.ndarray:
    return map_view(batch.assets, batch.config, 720).pixels(np.array([x, y]))


def drivable(batch: GameBatch, share: float) -> tuple[float, float]:
    """A place of the robot's area."""
    cells = batch.assets.cell_xy
    x, y = cells[int(share * (len(cells) - 1))].tolist()
    return x, y


@pytest.mark.parametrize("name", shipped_maps())
def test_every_map_gives_even_picture_of_given_height(name: str) -> None:
    for height in (120, 360):
        frame = render_frame(games(name), 0, height=height, title="nearest")
        assert (frame.dtype, frame.shape[0], frame.shape[2]) == (np.uint8, height, 3)
        assert frame.shape[1] % 2 == 0
        assert frame.shape[1] <= height * 16 / 9
        assert len(np.unique(frame.reshape(-1, 3), axis=0)) > 20


@pytest.mark.parametrize(("columns", "rows"), [(400, 60), (60, 400)])
def test_maps_keep_their_proportions_within_16_to_9(columns: int, rows: int) -> None:
    config = make_config(**{"pellets.spacing_m": 1.0})
    batch = games(corridor(columns, rows), config=config)
    frame = render_frame(batch, 0)
    view = map_view(batch.assets, config, 720)
    assert frame.shape[0] == 720
    assert 0.75 * 720 < frame.shape[1] <= 1280
    across = view.pixels(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
    assert across[1, 0] - across[0, 0] == pytest.approx(across[0, 1] - across[2, 1], rel=0.02)
    assert (view.goals >= [0, HEADER]).all()
    assert (view.goals < [frame.shape[1], 720]).all()


def test_same_state_gives_equal_picture_in_new_array() -> None:
    batch = games()
    first = render_frame(batch, 0)
    kept = first.copy()
    first[:] = 0
    again = render_frame(batch, 0)
    np.testing.assert_array_equal(again, kept)
    assert again.flags.writeable
    assert not np.shares_memory(again, render_frame(batch, 0))


def test_game_of_a_batch_looks_like_single_game() -> None:
    many, one = games(n=3), games()
    one.reset(np.zeros(1, dtype=np.int64), np.array([9], dtype=np.uint64))
    np.testing.assert_array_equal(render_frame(many, 2), render_frame(one, 0))


def test_pac_man_has_place_and_size_of_robot() -> None:
    batch = games(config=make_config("ideal"))
    batch.alive[:] = False
    view = map_view(batch.assets, batch.config, 720)
    for share in (0.1, 0.5, 0.9):
        x, y = drivable(batch, share)
        batch.games["x"], batch.games["y"] = x, y
        batch.ghosts["x"], batch.ghosts["y"] = drivable(batch, (share + 0.4) % 1)
        offset = near(render_frame(batch, 0), LIGHT.pac, 40) - view.pixels(np.array([x, y]))
        assert len(offset) > 100
        assert np.hypot(*offset.T).max() <= 0.171 * view.scale
        assert np.hypot(*offset.T).max() > 0.8 * 0.171 * view.scale


@pytest.mark.parametrize("heading", [1.0, -2.0])
def test_mouth_opens_along_the_heading(heading: float) -> None:
    batch = games(config=make_config("ideal"))
    batch.alive[:] = False
    batch.games["heading"] = heading
    yellow = near(render_frame(batch, 0), LIGHT.pac, 40)
    at = pixels(batch, batch.games[0]["x"], batch.games[0]["y"])
    back = yellow.mean(axis=0) - at
    assert np.hypot(*back) > 0.5
    turned = math.atan2(back[1], -back[0]) - heading
    assert abs(math.remainder(turned, 2 * math.pi)) < 0.35


@settings(max_examples=30, deadline=None)
@given(heading=st.floats(-7, 7), yaw=st.sampled_from([0.0, 0.6, 3.14, -1.9]))
def test_headings_turn_with_a_yawed_map(heading: float, yaw: float) -> None:
    view = corridor_view(yaw)
    step = view.pixels(np.array([math.cos(heading), math.sin(heading)])) - view.pixels(np.zeros(2))
    assert math.remainder(math.atan2(step[1], step[0]) - view.angle(heading), 2 * math.pi) == pytest.approx(0, abs=0.03)


def test_map_looks_the_same_for_any_yaw() -> None:
    straight, turned = (corridor_view(yaw) for yaw in (0.0, 2.0))
    pellets = straight.assets.pellets
    np.testing.assert_allclose(straight.goals[:pellets], turned.goals[:pellets], atol=1e-6)


def test_collected_pellet_becomes_a_faint_ring() -> None:
    batch = games()
    before = render_frame(batch, 0)
    batch.alive[0, 3] = False
    after = render_frame(batch, 0)
    at = pixels(batch, *batch.assets.goal_xy[3])
    x, y = np.rint(at).astype(int)
    assert tuple(before[y, x]) == LIGHT.pac
    assert after[y, x].min() > 200
    rows, columns = np.nonzero((before != after).any(axis=-1))
    assert np.hypot(columns - at[0], rows - at[1]).max() < 12
    assert (abs(after[y - 8 : y + 9, x - 8 : x + 9].astype(int) - LIGHT.collected) < 30).all(axis=-1).any()


def test_ghost_and_its_circle_are_at_its_place() -> None:
    batch = games()
    for share in (0.2, 0.8):
        x, y = drivable(batch, share)
        batch.ghosts["x"], batch.ghosts["y"] = x, y
        frame = render_frame(batch, 0)
        at, scale = pixels(batch, x, y), map_view(batch.assets, batch.config, 720).scale
        assert np.hypot(*(near(frame, symbols.GHOSTS[0]) - at).T).max() < 0.25 * scale
        edge = np.hypot(*(near(frame, LIGHT.danger, 40) - at).T)
        assert len(edge) > 20
        assert edge.mean() == pytest.approx(0.25 * scale, abs=1)


@pytest.mark.parametrize(("execution", "field"), [("robust", "error_x"), ("as_built", "amcl_x")])
def test_frame_shows_the_executors_believed_pose(execution: str, field: str) -> None:
    batch = games(config=make_config("robot", execution))
    plain = near(render_frame(batch, 0), LIGHT.belief)
    batch.games[field] += 1.0
    moved = near(render_frame(batch, 0), LIGHT.belief)
    scale = map_view(batch.assets, batch.config, 720).scale
    shift = moved.max(axis=0) - plain.max(axis=0)
    np.testing.assert_allclose(shift, [scale, 0], atol=1.5)
    assert len(near(render_frame(games(config=make_config("ideal")), 0), LIGHT.belief)) == 0  # perfect localization


def test_plan_leads_from_robot_to_goal() -> None:
    batch = games()
    assert len(near(render_frame(batch, 0), LIGHT.plan)) == 0
    pellets = batch.assets.pellets
    goal = int(situation_of(batch).path_robot[0, :pellets].argmax())
    for _ in range(4):
        batch.step(np.array([goal]))
    assert batch.games[0]["nav_points"] > 0
    blue = near(render_frame(batch, 0), LIGHT.plan, 25)
    robot = pixels(batch, batch.games[0]["x"], batch.games[0]["y"])
    view = map_view(batch.assets, batch.config, 720)
    target = view.goals[goal]
    assert np.hypot(*(blue - robot).T).min() < 2 * view.body_px
    assert np.hypot(*(blue - target).T).min() < 3 * view.pellet_px
    assert len(blue) > np.hypot(*(target - robot))  # an unbroken line has at least that many pixels
    batch = games()  # a refuge pursued
    batch.games["pursued"] = batch.pellet_slots + 2
    blue = near(render_frame(batch, 0), LIGHT.plan, 25)
    at = pixels(batch, *batch.assets.goal_xy[batch.assets.pellets + 2])
    np.testing.assert_allclose(blue.mean(axis=0), at, atol=1)


def test_padded_pellet_slots_do_not_show() -> None:
    padded = games(config=make_config(max_pellets=40))
    padded.games["pursued"] = padded.pellet_slots  # home
    plain = games()
    plain.games["pursued"] = plain.pellet_slots
    np.testing.assert_array_equal(render_frame(padded, 0), render_frame(plain, 0))


def test_header_alone_shows_end_numbers_and_title() -> None:
    batch = games()
    before = render_frame(batch, 0)
    assert (before[:HEADER] == ENDS[RUNNING].badge).all(axis=-1).any()

    def header() -> np.ndarray:
        after = render_frame(batch, 0)
        assert (before[:HEADER] != after[:HEADER]).any()
        np.testing.assert_array_equal(before[HEADER:], after[HEADER:])
        return after[:HEADER]

    for end in (CAUGHT, COMPLETE, CLEARED, TIMEOUT):
        batch.games["end"] = end
        assert (header() == ENDS[end].badge).all(axis=-1).any()
        assert not (header() == ENDS[RUNNING].badge).all(axis=-1).any()
    batch.games["end"] = RUNNING
    for field, value in (("step", 400), ("collected", 3), ("spawned", 99), ("lost", 1), ("clyde_speed", 0.35)):
        kept = batch.games[field].copy()
        batch.games[field] = value
        header()
        batch.games[field] = kept
    for title in ("nearest", "x" * 300, "Räuber → Geist"):
        titled = render_frame(batch, 0, title=title)
        assert (before[:HEADER] != titled[:HEADER]).any()
        np.testing.assert_array_equal(before[HEADER:], titled[HEADER:])
        assert (titled[:HEADER] == ENDS[RUNNING].badge).all(axis=-1).sum() > 500  # the state is not written over


def contrast(*colours: Colour) -> float:
    """Return the contrast of two colours by WCAG 2."""
    linear = np.array(colours) / 255
    linear = np.where(linear <= 0.04045, linear / 12.92, ((linear + 0.055) / 1.055) ** 2.4)
    low, high = sorted(linear @ (0.2126, 0.7152, 0.0722))
    return float((high + 0.05) / (low + 0.05))


@pytest.mark.parametrize("theme", THEMES)
def test_theme_is_readable_and_changes_colours_alone(theme: Theme) -> None:
    chosen = THEMES[theme]
    texts = (chosen.ink, chosen.page), (chosen.text, chosen.header), (chosen.muted, chosen.header)
    assert min(contrast(*pair) for pair in [*texts, *((end.ink, end.badge) for end in ENDS)]) >= 4.5
    outlined = [
        (chosen.pac, chosen.outline),
        *((colour, chosen.ghost_outline) for colour in [*symbols.GHOSTS, FRIGHTENED]),
    ]
    plain = [(colour,) for colour in (chosen.wall, chosen.plan, chosen.belief, chosen.danger, chosen.place)]
    assert min(max(contrast(part, chosen.floor) for part in parts) for parts in [*outlined, *plain]) >= 3
    env = PacManBotEnv(render_mode="rgb_array")
    env.reset(seed=7)
    env.theme = theme
    frame, light = env.render(), render_frame(env.batch, 0)
    assert frame is not None
    np.testing.assert_array_equal(frame, render_frame(env.batch, 0, theme=theme))
    assert frame.shape == light.shape
    floor = [(picture == palette.floor).all(axis=-1) for picture, palette in ((frame, chosen), (light, LIGHT))]
    assert floor[0].sum() > 100_000
    assert (floor[0] != floor[1]).mean() < 0.01
    np.testing.assert_array_equal(frame[:30, -60:], light[:30, -60:])  # the state has the same colours


def test_bad_heights_themes_and_games_are_named() -> None:
    batch = games(n=2)
    for height in (0, 118, 361, -2):
        with pytest.raises(ValueError, match=f"height = {height}"):
            render_frame(batch, 0, height=height)
    with pytest.raises(ValueError, match="theme = 'grey': must be light or dark"):
        render_frame(batch, 0, theme="grey")  # type: ignore[arg-type]
    for game in (-1, 2):
        with pytest.raises(IndexError, match=f"game = {game}"):
            render_frame(batch, game)
