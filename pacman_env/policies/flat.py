"""Policy that learned in a flat environment such as PacManBotFlat: an ONNX file of ``pacman_env.sb3.export``.

The file contains the settings of its observation and of its decisions. A game may ask the policy at each tick: it keeps
its choice until its own settings demand a new one.
"""

import hashlib
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from pacman_env.config import Config
from pacman_env.config.validation import located, require
from pacman_env.game.decisions import HOLD, LastDecision, Moment
from pacman_env.observations.kinds import FLAT
from pacman_env.observations.learner_layout import MISSING
from pacman_env.observations.observer import Observer
from pacman_env.observations.planner_features import VERSION
from pacman_env.observations.situation import Situation
from pacman_env.policies.learned import OnnxPolicy, open_session
from pacman_env.policies.metadata import content_of, parse
from pacman_env.policies.policy_calls import PolicyError

KEY = "pacman_env.flat_policy"  # of the metadata in the ONNX file
GROUPS = ("observation.", "decisions.")
_FAR_M = 1000.0  # in place of the distance of a ghost that is frightened or away


class FlatMetadata(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Metadata in the ONNX file of a flat policy."""

    format: Literal[1]
    feature_version: int  # version of pacman_env.observations.planner_features
    settings: dict[str, Any]  # fields of ``GROUPS`` by dotted name
    package_version: str
    commit: str  # commit of the exporting sources, "unknown" outside a repository


def is_flat_policy(path: str | os.PathLike[str]) -> bool:
    """Return True if an ONNX file contains the metadata of a flat policy; raises ValueError if it cannot be read."""
    return KEY.encode() in content_of(Path(path))


class FlatPolicy(OnnxPolicy):
    """Chooses the allowed action with the highest score of a network that reads flat observations."""

    _last: Sequence[LastDecision] = ()  # of each game
    _returns_s: Any = None  # (N,) latest time at which a caught ghost starts again; it grows if a ghost is caught

    def __init__(self, path: str | os.PathLike[str], threads: int = 1) -> None:
        self.path = Path(path).absolute()
        self.name = self.path.stem
        self._model, self._threads = content_of(self.path), threads
        self.sha256 = hashlib.sha256(self._model).hexdigest()
        self._open()
        self.reset(np.zeros(0, dtype=np.bool_), self.config)

    def _open(self) -> None:
        self._session = session = open_session(self.path, self._model, self._threads)
        self.metadata = parse(FlatMetadata, session.get_modelmeta().custom_metadata_map.get(KEY, ""), self.path)
        with located(self.path, ValueError):
            version = self.metadata.feature_version
            require(version == VERSION, "feature_version", version, f"must be {VERSION}: export the model again")
            for name in self.metadata.settings:
                require(name.startswith(GROUPS), "settings", name, f"must begin with {' or '.join(GROUPS)}")
        nodes = [(node.name, node.type, node.shape) for node in (*session.get_inputs(), *session.get_outputs())]
        expected = [(name, "tensor(float)", [1, nodes[-1][2][-1]]) for name in ("observation", "scores")]
        self._inputs = expected[0][2][1] = nodes[0][2][-1]
        if nodes != expected:
            raise ValueError(f"{self.path}: inputs and outputs: found {nodes}, expected {expected}")

    def reset(self, games: NDArray[np.bool_], config: Config) -> None:
        """Forget the choices in the games (N,) that are True; raises ConfigError if the file's settings do not fit."""
        super().reset(games, config)
        settings = self.metadata.settings.items()
        self._own = config.with_fields(**{name: tuple(v) if isinstance(v, list) else v for name, v in settings})
        keeps = len(self._last) == len(games)
        self._last = [self._last[i] if keeps and not new else LastDecision(self._own) for i, new in enumerate(games)]
        self._returns_s = np.where(games, 0.0, self._returns_s if keeps else 0.0)

    def select(self, situation: Situation) -> NDArray[np.int64]:
        """Return the candidate (N,) of each game: the last choice, or a new one if the file's settings demand it."""
        if len(self._last) != len(situation):
            self.reset(np.ones(len(situation), dtype=np.bool_), self.config)
        ghosts_m = np.hypot(*np.moveaxis(situation.ghosts[:, :, :2] - situation.robot[:, None, :2], -1, 0))
        ghosts_m[(situation.frightened_s > 0) | (situation.away_s > 0)] = _FAR_M
        returns_s = np.where(situation.away_s > 0, situation.time_s[:, None] + situation.away_s, 0.0).max(axis=1)
        self._returns_s = np.maximum(self._returns_s, returns_s.round(2))
        news = zip(situation.pellets_left.tolist(), self._returns_s.tolist(), strict=True)
        columns = situation.time_s.tolist(), situation.current.tolist(), news, ghosts_m.min(axis=1).tolist()
        moments = [Moment(*values) for values in zip(*columns, strict=True)]
        hold = situation.mask.shape[1] - 1
        due = [i for i, now in enumerate(moments) if self._last[i].due(now)]
        if due:
            chosen = super().select(situation.rows(np.array(due)))
            for i, choice in zip(due, chosen.tolist(), strict=True):
                self._last[i].decide(HOLD if choice == hold else choice, moments[i])
        return np.array([hold if last.choice == HOLD else last.choice for last in self._last], dtype=np.int64)

    def scores(self, situation: Situation) -> NDArray[np.float64]:
        """Return the network's scores (N, C), -inf for candidates that are no action; raises ValueError without maps.

        Raises PolicyError if the games have other ghosts or power pellets than the observations in training.
        """
        observer = Observer.of(situation, self._own)
        rows, order = observer.result[FLAT], observer.order
        if rows.shape[1] != self._inputs:
            learned = f"learned from {self._inputs}, give it the ghosts and power pellets of its training"
            raise PolicyError(f"policy {self.name!r}: observes {rows.shape[1]} numbers, {learned}")
        scores = np.full(situation.mask.shape, -np.inf)
        game, place = np.nonzero(order != MISSING)
        scores[game, order[game, place]] = self.run(rows)[game, place]
        return scores

    def run(self, rows: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the network's scores (N, A) of all actions for observations (N, F)."""
        # One game at a time, because sums over a batch round differently.
        return np.concatenate([self._session.run(None, {"observation": row[None]})[0] for row in rows])
