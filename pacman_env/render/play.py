"""Let a human play in a window, with clicks and keys as actions.

:class:`Player` handles inputs and returns images and a caption; it needs no window and no screen.
"""

import math
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ..sim.observation.situation import PELLET, Situation
from .frames import game_view
from .window import HumanWindow, Input

SPEEDS = (1 / 8, 16.0)  # range, relative to real time
CLICK_M, CLICK_PX = 0.4, 16.0  # a click selects a goal within the larger one of both distances
GOAL_KEYS = "click: goal, 1-9: n-th nearest pellet, space: hold, s: one decision"
DRIVE_KEYS = "arrows or WASD: drive"
_PICTURED = ("games", "ghosts", "alive", "paths")  # attributes of a batch that images depend on
KEYS = "r: new round, p: pause, + and -: speed, q: quit"
#: Column of the action (v, omega) and sign, for each key.
DRIVE = dict(zip(("up", "down", "left", "right"), ((0, 1), (0, -1), (1, 1), (1, -1)), strict=True))
DRIVE |= {"w": DRIVE["up"], "s": DRIVE["down"], "a": DRIVE["left"], "d": DRIVE["right"]}


class Controls:
    """Converts inputs to actions of an environment.

    In a ``Discrete`` action space the last chosen goal is pursued while it is allowed; then the robot holds. In a
    ``Box`` of (v, omega) the pressed keys drive, each at the bound of the space.
    """

    def __init__(self, action_space: spaces.Space[Any]) -> None:
        self.space = action_space
        self.drives = isinstance(action_space, spaces.Box) and action_space.shape == (2,)
        if not self.drives and not isinstance(action_space, spaces.Discrete):
            raise ValueError(f"action space {action_space}: must be Discrete or a Box of (v, omega)")
        self.goal: int | None = None
        self._held: set[str] = set()

    def click(self, xy: NDArray[np.float64], reach_m: float, situation: Situation) -> None:
        """Choose the allowed pellet or refuge nearest to ``xy`` (2,), m, if it is within reach."""
        distance = np.hypot(*(situation.position[0] - xy).T)
        distance[~situation.mask[0]] = np.inf
        distance[-1] = np.inf  # hold
        if distance.min() <= reach_m:
            self.goal = int(distance.argmin())

    def press(self, key: str, situation: Situation) -> bool:
        """Process a pressed key, and return True if it belongs to an action."""
        if self.drives:
            self._held.add(key)
            return key in DRIVE
        if key in ("space", "h"):
            self.goal = None
            return True
        if len(key) == 1 and key in "123456789":
            length = np.where(situation.mask[0] & (situation.kind[0] == PELLET), situation.path_robot[0], np.inf)
            nearest = np.argsort(length, kind="stable")[int(key) - 1 : int(key)]
            if np.isfinite(length[nearest]).any():
                self.goal = int(nearest[0])
            return True
        return False

    def release(self, key: str) -> None:
        self._held.discard(key)

    def action(self, situation: Situation) -> Any:
        if isinstance(self.space, spaces.Box):
            action = np.zeros(2)
            for column, sign in {DRIVE[key] for key in self._held & DRIVE.keys()}:  # each direction counts once
                action[column] += (self.space.high if sign > 0 else self.space.low)[column]
            return np.clip(action, self.space.low, self.space.high).astype(self.space.dtype)
        if self.goal is not None and not situation.mask[0, self.goal]:
            self.goal = None
        return situation.mask.shape[1] - 1 if self.goal is None else self.goal


class Player:
    """Plays rounds of an environment (wrapped or not, ``render_mode="rgb_array"``) by the inputs of a human."""

    def __init__(self, env: gym.Env[Any, Any], *, seed: int | None = None, speed: float = 1.0) -> None:
        if not SPEEDS[0] <= speed <= SPEEDS[1]:
            raise ValueError(f"speed = {speed}: must be {SPEEDS[0]} to {SPEEDS[1]} times real time")
        if env.render_mode != "rgb_array":
            raise ValueError(f"render_mode = {env.render_mode!r}: must be 'rgb_array'")
        self.env, self.speed = env, speed  # relative to real time
        self.batch: Any = env.unwrapped.batch  # type: ignore[attr-defined]
        self.tick_s: float = self.batch.config.execution.tick_s
        self.controls = Controls(env.action_space)
        self.quit = self.paused = self.help = False
        self.new_round(seed)

    @property
    def situation(self) -> Situation:
        return self.env.unwrapped.situation  # type: ignore[attr-defined]

    def new_round(self, seed: int | None = None) -> None:
        """Start a new round; without a seed the environment's generator continues."""
        _, info = self.env.reset(seed=seed)
        self.controls.goal = None
        self.score = 0.0  # sum of the rewards of this round
        self.over, self.outcome = False, info["outcome"]
        self._before = self._state()
        self._one = False

    def handle(self, event: Input) -> None:
        """Process an input; inputs without a meaning are ignored."""
        if event.kind == "click" and not self.controls.drives:
            view = game_view(self.batch, 0, len(self.picture()))
            xy = view.metres(np.array(event.at, dtype=float))
            self.controls.click(xy, max(CLICK_M, CLICK_PX / view.scale), self.situation)
        elif event.kind == "release":
            self.controls.release(event.key)
        elif event.kind == "press" and not self.controls.press(event.key, self.situation):
            self._command(event.key)

    def _command(self, key: str) -> None:
        match key:
            case "q" | "escape":
                self.quit = True
            case "r":
                self.new_round()
            case "p":
                self.paused = not self.paused
            case "s":
                self.paused = self._one = True
            case "+" | "=":
                self.speed = min(2 * self.speed, SPEEDS[1])
            case "-":
                self.speed = max(self.speed / 2, SPEEDS[0])
            case "?" | "f1":
                self.help = not self.help

    def advance(self) -> bool:
        """Play one decision and return True, unless the round is over or paused."""
        if self.over or (self.paused and not self._one):
            return False
        self._one = False
        self._before = self._state()
        _, reward, terminated, truncated, info = self.env.step(self.controls.action(self.situation))
        self.score += float(reward)
        self.over, self.outcome = terminated or truncated, info["outcome"]
        return True

    def picture(self, share: float = 1.0) -> NDArray[np.uint8]:
        """Return an image (H, W, 3), interpolated between the last decision (0) and now (1)."""
        now = self._state()
        if share < 1.0:
            self._restore(self._before)
            old, new = self._before[0], now[0]
            for k, moving in enumerate((self.batch.games, self.batch.ghosts)):
                for name in ("x", "y"):
                    moving[name] = self._before[k][name] + share * (now[k][name] - self._before[k][name])
            turned = [math.remainder(a, 2 * math.pi) for a in (new["heading"] - old["heading"]).tolist()]
            self.batch.games["heading"] = old["heading"] + share * np.array(turned)
        try:
            frame: Any = self.env.render()
        finally:
            self._restore(now)
        return frame

    @property
    def caption(self) -> str:
        if self.help:
            return f"{DRIVE_KEYS if self.controls.drives else GOAL_KEYS}, {KEYS}"
        if self.over:
            state = f"{self.outcome}, r: new round"
        else:
            state = "paused, p: resume" if self.paused else f"{self.speed:g}x"
        return f"PacManBot   score {self.score:.1f}   {state}   F1: keys"

    def _state(self) -> tuple[NDArray[Any], ...]:
        return tuple(getattr(self.batch, name).copy() for name in _PICTURED)

    def _restore(self, state: tuple[NDArray[Any], ...]) -> None:
        for name, values in zip(_PICTURED, state, strict=True):
            getattr(self.batch, name)[...] = values


def play(player: Player, window: HumanWindow, *, fps: float = 20.0) -> None:
    """Play until the player quits or closes the window; images are interpolated and therefore one decision late."""
    if not 1 <= fps <= 100:
        raise ValueError(f"fps = {fps}: must be 1 to 100")
    while not player.quit and not window.closed:
        real_s = player.tick_s / player.speed
        pictures = max(1, round(fps * real_s))
        moves = player.advance()
        for k in range(1, pictures + 1) if moves else (1,):
            window.caption = player.caption
            shown = window.show(player.picture(k / pictures if moves else 1.0), pictures / real_s)
            for event in window.inputs():
                player.handle(event)
            if player.quit or not shown:
                break
