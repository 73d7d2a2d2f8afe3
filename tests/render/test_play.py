"""What a human's clicks and keys do, without a window and in one on SDL's dummy screen."""

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces

from pacman_env.cli.main import main
from pacman_env.render.frames import MapView, map_view
from pacman_env.render.palette import LIGHT
from pacman_env.render.play import SPEEDS, Controls, Player, play
from pacman_env.render.window import HumanWindow, Input
from tests.envs.helpers import QUICK, make, same

LIMIT = np.array([0.3, 1.9], dtype=np.float32)  # v in m/s, omega in rad/s


def player(seed: int = 3, **arguments: Any) -> Player:
    return Player(make(render_mode="rgb_array", **arguments), seed=seed)


def view(one: Player) -> MapView:
    return map_view(one.batch.assets, one.batch.config, 720)


def pixel_of(one: Player, candidate: int) -> tuple[int, ...]:
    return tuple(np.rint(view(one).pixels(one.situation.position[0, candidate])).astype(int).tolist())


def press(one: Player, *keys: str) -> None:
    for key in keys:
        one.handle(Input("press", key))


def by_path(one: Player) -> list[int]:
    """Pellets, nearest first."""
    return np.argsort(one.situation.path_robot[0, : one.batch.assets.pellets], kind="stable").tolist()


def driven(env: gym.Env[Any, Any]) -> gym.Env[Any, Any]:
    """The environment behind an action space of (v, omega); the robot holds whatever comes."""
    hold = int(env.action_space.n) - 1  # type: ignore[attr-defined]
    return gym.wrappers.TransformAction(env, lambda action: hold, spaces.Box(-LIMIT, LIMIT))


def test_click_names_the_candidate_there() -> None:
    one = player()
    for candidate in np.flatnonzero(one.situation.mask[0])[:-1].tolist():
        column, row = pixel_of(one, candidate)
        one.handle(Input("click", at=(column + 3, row - 4)))
        assert one.controls.goal == candidate
        assert one.controls.action(one.situation) == candidate
    assert one.controls.goal is not None
    assert one.controls.goal >= one.batch.pellet_slots  # the last one is a refuge


def test_click_on_nothing_changes_nothing() -> None:
    one = player()
    press(one, "1")
    goal = one.controls.goal
    kinds = one.situation.position[0, :-1]
    cells = one.batch.assets.cell_xy
    lonely = cells[np.hypot(*(cells[:, None] - kinds).T).min(axis=0).argmax()]
    for at in (tuple(np.rint(view(one).pixels(lonely)).astype(int).tolist()), (0, 0), (400, 30)):
        one.handle(Input("click", at=at))
        assert one.controls.goal == goal


def test_digits_name_pellets_by_path_length() -> None:
    one = player()
    order = by_path(one)
    for k in range(9):
        press(one, str(k + 1))
        assert one.controls.goal == order[k]
    press(one, "0", "x", "f5")
    assert one.controls.goal == order[8]
    few = player(settings=QUICK)
    assert few.batch.assets.pellets < 9
    press(few, "1", "9")
    assert few.controls.goal == by_path(few)[0]


def test_robot_holds_at_first_and_on_request() -> None:
    one = player()
    hold = one.env.action_space.n - 1  # type: ignore[attr-defined]
    assert one.controls.action(one.situation) == hold
    for key in ("space", "h"):
        press(one, "2")
        assert one.controls.action(one.situation) != hold
        press(one, key)
        assert one.controls.action(one.situation) == hold


def test_goal_is_pursued_until_reached_and_then_forbidden() -> None:
    one = player(settings={**QUICK, "execution.death_radius_m": 0.01})
    press(one, "1")
    goal = one.controls.goal
    assert goal is not None
    actions, at = [], pixel_of(one, goal)
    while not one.batch.games[0]["collected"]:
        actions.append(one.controls.action(one.situation))
        assert one.advance()
    assert set(actions) == {goal}
    assert one.controls.action(one.situation) == one.situation.mask.shape[1] - 1
    assert one.score == pytest.approx(1 - 0.002 * len(actions))
    one.handle(Input("click", at=at))
    assert one.controls.goal != goal


def test_playing_is_stepping_the_environment() -> None:
    one, env = player(seed=5), make()
    env.reset(seed=5)
    press(one, "3")
    for _ in range(20):
        action = one.controls.action(one.situation)
        one.picture(0.5)
        one.advance()
        env.step(action)
        assert same(one.situation.arrays(), env.situation.arrays())


@pytest.mark.parametrize(
    ("held", "action"),
    [
        *(((), (0.0, 0.0)), (("w", "a"), (1.0, 1.0)), (("up", "w", "right"), (1.0, -1.0))),
        *((("down", "d"), (-1.0, -1.0)), (("left", "up", "s"), (0.0, 1.0))),
    ],
)
def test_keys_held_drive_at_full_speed(held: tuple[str, ...], action: tuple[float, float]) -> None:
    one = Player(driven(make(render_mode="rgb_array")), seed=0)
    press(one, *held)
    chosen = one.controls.action(one.situation)
    assert one.env.action_space.contains(chosen)
    np.testing.assert_array_equal(chosen, np.array(action, dtype=np.float32) * LIMIT)
    assert one.advance()
    for key in held:
        one.handle(Input("release", key))
    np.testing.assert_array_equal(one.controls.action(one.situation), [0, 0])


def test_driving_ignores_clicks_and_never_reverses() -> None:
    one = Player(driven(make(render_mode="rgb_array")), seed=0)
    one.handle(Input("click", at=(300, 300)))
    press(one, "s", "space", "1")
    assert one.controls.goal is None
    assert not one.paused
    press(one, "p")
    assert one.paused
    controls = Controls(spaces.Box(np.array([0.0, -1.0]), np.array([0.3, 1.0]), dtype=np.float64))  # forward only
    one = player()
    controls.press("down", one.situation)
    assert controls.action(one.situation).tolist() == [0.0, 0.0]


def test_pause_stops_and_s_takes_one_decision() -> None:
    one, plain = player(), player().caption
    press(one, "?")
    assert "q: quit" in one.caption
    press(one, "f1")
    assert one.caption == plain
    press(one, "p")
    assert not one.advance()
    assert "paused" in one.caption
    press(one, "s")
    assert one.advance()
    assert not one.advance()
    press(one, "p")
    assert one.advance()
    assert one.batch.games[0]["tick"] == 2


def test_speed_doubles_and_halves_within_limits() -> None:
    one = player()
    press(one, "+")
    assert one.speed == 2
    press(one, *["="] * 20)
    assert one.speed == SPEEDS[1]
    press(one, *["-"] * 20)
    assert one.speed == SPEEDS[0]


def test_outcome_stays_until_r_starts_a_round() -> None:
    one = player(settings={"time_limit_s": 2.0})
    first = one.batch.games[0]["seed"]
    press(one, "1")
    assert [one.advance() for _ in range(6)] == [True] * 4 + [False] * 2
    assert one.over
    assert one.score == pytest.approx(-5 - 4 * 0.002)
    assert "score -5.0   timeout, r: new round" in one.caption
    press(one, "r")
    assert not one.over
    assert one.batch.games[0]["seed"] != first
    assert (one.score, one.controls.goal) == (0.0, None)
    assert one.advance()


def test_pictures_interpolate_between_decisions() -> None:
    one = player()
    press(one, "5")
    for _ in range(8):
        one.advance()
    before = one.picture()
    xy = np.array(one.batch.games[0][["x", "y"]].tolist())
    one.advance()
    state = [array.tobytes() for array in (one.batch.games, one.batch.alive, one.batch.paths)]
    np.testing.assert_array_equal(one.picture(0.0), before)
    middle, after = one.picture(0.5), one.picture()
    np.testing.assert_array_equal(after, one.env.render())
    assert [array.tobytes() for array in (one.batch.games, one.batch.alive, one.batch.paths)] == state
    at: list[np.ndarray] = []
    left, top = view(one).pixels(xy)
    for frame in (before, middle, after):
        rows, columns = np.nonzero((abs(frame[70:600].astype(int) - LIGHT.pac) <= 12).all(axis=-1))
        near = np.hypot(columns - left, rows + 70 - top) < 25
        at.append(np.array([columns[near].mean(), rows[near].mean()]))
    assert np.hypot(*(at[2] - at[0])) > 3
    np.testing.assert_allclose(at[1], (at[0] + at[2]) / 2, atol=1)


def test_bad_speeds_and_environments_are_refused() -> None:
    for speed in (0.0, -1.0, 1000.0, float("nan")):
        with pytest.raises(ValueError, match="speed = "):
            Player(make(render_mode="rgb_array"), speed=speed)
    with pytest.raises(ValueError, match="render_mode = None"):
        Player(make())
    with pytest.raises(ValueError, match="must be Discrete or a Box"):
        Controls(spaces.MultiBinary(3))


class Script(HumanWindow):
    """A window in which something happens at certain pictures: real events, in pygame's own queue."""

    def __init__(self, events: dict[int, list[Any]]) -> None:
        super().__init__()
        self.events, self.shown = events, 0
        self.captions: list[str] = []

    def show(self, frame: np.ndarray, fps: float) -> bool:
        pygame = pytest.importorskip("pygame")
        for event in self.events.get(self.shown, []):
            pygame.event.post(event)
        self.shown += 1
        self.captions.append(self.caption)
        return super().show(frame, 0)


def test_game_is_played_in_a_window(pygame: Any) -> None:
    actions: list[int] = []
    env = make(render_mode="rgb_array")
    one = Player(gym.wrappers.TransformAction(env, lambda a: actions.append(a) or a, env.action_space), seed=3)  # type: ignore[func-returns-value]
    goal = by_path(one)[1]

    def key(code: int, text: str = "") -> Any:
        return pygame.event.Event(pygame.KEYDOWN, key=code, unicode=text)

    window = Script(
        {
            1: [pygame.event.Event(pygame.MOUSEBUTTONDOWN, button=1, pos=pixel_of(one, goal))],
            100: [key(pygame.K_SPACE, " ")],
            150: [key(pygame.K_SLASH, "?"), key(pygame.K_p, "p"), key(pygame.K_KP_PLUS, "+")],
            155: [key(pygame.K_ESCAPE)],
        }
    )
    play(one, window)
    hold = one.situation.mask.shape[1] - 1
    assert actions == [hold] + [goal] * 10 + [hold] * 5  # ten pictures each; the next decision heeds what was done
    assert one.paused
    assert one.speed == 2
    assert window.shown == 156
    assert "n-th nearest" in window.captions[-1]
    window.close()


def test_closing_window_or_q_ends_the_game(pygame: Any) -> None:
    for event in (pygame.event.Event(pygame.QUIT), pygame.event.Event(pygame.KEYDOWN, key=pygame.K_q, unicode="q")):
        window = Script({3: [event]})
        play(player(), window)
        assert window.shown == 4
        assert window.closed == (event.type == pygame.QUIT)
        window.close()


def test_command_plays_and_closes_its_window(pygame: Any, capsys: pytest.CaptureFixture[str]) -> None:
    pygame.display.init()
    pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=pygame.K_q, unicode="q"))
    options = ["--seed", "1", "--preset", "ideal", "--clyde-speed", "0.4", "--time-limit", "9", "--speed", "8"]
    assert main(["play", "--map", "loop", *options]) == 0
    assert not pygame.display.get_init()
    assert capsys.readouterr().err == ""
