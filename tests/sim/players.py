"""Games played by random choices that depend on a game's number alone, and all that there is to know of a game."""

from typing import Any

import numpy as np

from pacman_env.config import Config
from pacman_env.game.ends import RUNNING
from pacman_env.levels.assets import map_assets
from pacman_env.levels.level_source import GeneratedMaps
from pacman_env.observations.situation_writer import situation_of
from pacman_env.sim.batch import GameBatch


def new_batch(config: Config, n: int = 1, source: Any = "house", first_seed: int = 0, levels: int = 4) -> GameBatch:
    """Return games at the beginning of rounds with the seeds ``first_seed`` and following."""
    maps = GeneratedMaps(config, 0, levels) if source == "generated" else map_assets(source, config)
    batch = GameBatch(maps, config, n)
    batch.reset(np.arange(n), first_seed + np.arange(n, dtype=np.uint64))
    return batch


def played(config: Config, n: int = 12, source: Any = "house", steps: int = 30, keep: int = 1) -> GameBatch:
    """Return games that have gone on for a while, each in another way: by random choices, each kept for some ticks."""
    batch, rng = new_batch(config, n, source), np.random.default_rng(0)
    for k in range(steps):
        if k % keep == 0:
            choices = rng.integers(batch.candidates, size=n)
        batch.step(choices)
    return batch


def everything(batch: GameBatch, game: int) -> dict[str, bytes]:
    """Return all that there is to know of a game, except for the slot that its map is in."""
    found = {name: batch.games[name][game].tobytes() for name in batch.games.dtype.names or () if name != "level"}
    found["level"] = batch.level_numbers()[game].tobytes()
    found |= {f"ghosts.{name}": batch.ghosts[name][game].tobytes() for name in batch.ghosts.dtype.names or ()}
    seats = [-1, *range(batch.ghosts.shape[1] if "policy" in batch.config.clyde.ghosts else 0)]
    for seat in seats:
        row = situation_of(batch, seat).rows(np.array([game]))
        seen = {name: value for name, value in vars(row).items() if name not in ("maps", "threads", "level")}
        found |= {f"seen{seat}.{name}": value.tobytes() for name, value in seen.items()}
    results = ("reward", "elapsed_s", "terminated", "truncated", "alive", "paths", "completed_s", "obstacles")
    return found | {name: getattr(batch, name)[game].tobytes() for name in results}


def differences(a: dict[str, bytes], b: dict[str, bytes]) -> list[str]:
    return [name for name in a if a[name] != b[name]]


class Players:
    """Random allowed choices, kept for a while, and a new round after each end: by the game's number alone."""

    def __init__(self, config: Config, numbers: list[int], source: str = "house", levels: int = 4) -> None:
        self.batch = new_batch(config, len(numbers), source, levels=levels)
        self.rngs = [np.random.default_rng(number) for number in numbers]
        self.rounds = 1000 * np.array(numbers, dtype=np.uint64)
        self.chosen = np.zeros((self.batch.n, 2) if config.action == "velocity" else self.batch.n)
        self.ghosts = np.zeros((self.batch.n, self.batch.ghosts.shape[1]), dtype=np.int64)
        self.begin(np.arange(self.batch.n))

    def begin(self, games: np.ndarray) -> None:
        self.rounds[games] += np.uint64(1)
        self.batch.reset(games, self.rounds[games])

    def step(self) -> None:
        over = np.flatnonzero(self.batch.games["end"] != RUNNING)
        if len(over):
            self.begin(over)
        mask = situation_of(self.batch).mask
        velocity = self.batch.config.action == "velocity"
        for i, rng in enumerate(self.rngs):
            if rng.random() < 0.1 or (not velocity and not mask[i, int(self.chosen[i])]):
                self.chosen[i] = rng.uniform((0, -1), (0.3, 1)) if velocity else rng.choice(np.flatnonzero(mask[i]))
                self.ghosts[i] = rng.integers(0, self.batch.candidates, self.ghosts.shape[1])
        self.batch.step(self.chosen if velocity else self.chosen.astype(np.int64), self.ghosts)
