"""The child process that runs the policies of robot and ghosts: ``python -m ... PIPE``. Does not import ROS.

Policies are users' code: they may raise, hang, end the process or use up the memory. The parent (``policy_process.py``)
asks questions, and ends this process if anything goes wrong or an answer is late.
"""

import contextlib
import math
import os
import resource
import sys
import time
from multiprocessing.connection import Connection
from pathlib import Path
from signal import SIGKILL
from typing import Any

import msgspec
import numpy as np

from pacman_env.config import Config, ConfigError, make_config, parse_settings
from pacman_env.game.behaviour_belief import CHASES
from pacman_env.game.ghosts import POLICY
from pacman_env.levels.assets import map_assets
from pacman_env.observations.robot_view import RobotView
from pacman_env.observations.situation import Situation
from pacman_env.policies.base import Policy, reach
from pacman_env.policies.policy_calls import PolicyError, choose, name_of, reset, scores, what_users_raise
from pacman_env.policies.registry import behaviours_of, make_policy
from pacman_env.ros.end_with_parent import end_with_parent
from pacman_env.ros.memory import release_memory
from pacman_env.sim.ghost_state import choices_of
from pacman_env.world.maps.occupancy import MapError, load_map

ROBOT = -1  # player; others are numbers of ghosts
SLOW_S = 1.0  # a slower choice is discarded, because robot and ghosts have moved
UNUSABLE = (ValueError, TypeError, ModuleNotFoundError, MapError, ConfigError, OSError)
_MOST_MEMORY = 4 * 2**30  # bytes that a policy may allocate


class PolicySetup(msgspec.Struct):
    """Policies to load: the robot's is ``policy``, the ghosts' are in the configuration."""

    policy: str
    map: str
    preset: str
    execution: str
    settings: list[str]

    def config(self) -> Config:
        return make_config(self.preset, self.execution, **parse_settings(self.settings))


class Question(msgspec.Struct):
    """A situation of one player, as the bytes of its arrays; ``begins`` is True for the first of a round."""

    number: int
    player: int
    begins: bool
    arrays: list[bytes]
    scores: bool = False  # also return the scores
    why: bool = False  # also return the terms of the scores


class Answer(msgspec.Struct):
    """A choice: a candidate of the robot, or kind and value of a ghost's; or the reason why there is none."""

    number: int = -1  # of the question
    player: int = ROBOT
    choice: tuple[int, int] = (0, 0)
    error: str = ""
    scores: list[float] | None = None
    why: str | None = None  # JSON
    elapsed_ms: float = 0.0
    version: str = ""  # of the robot's policy, in the first message
    unexplained: str = ""  # why scores and terms are missing


class Policies:
    """The policies of one game, rehearsed; raises one of ``UNUSABLE`` if one cannot be used."""

    def __init__(self, setup: PolicySetup) -> None:
        self._config = setup.config()
        names = {ROBOT: setup.policy} if setup.policy else {}
        ghosts = self._config.clyde.ghosts
        names |= {k: ghosts[k] for k, one in enumerate(behaviours_of(ghosts)) if one == POLICY}
        policies = {player: make_policy(name) for player, name in names.items()}  # before anything is compiled
        view = RobotView(map_assets(load_map(setup.map), self._config), self._config)
        self._situations = {player: view.sample_situation(player) for player in policies}
        self._policies = {
            player: rehearse(policy, view, self._config) if player == ROBOT else policy
            for player, policy in policies.items()
        }

    @property
    def version(self) -> str:
        """Version of the robot's policy, if it was trained."""
        metadata = getattr(self._policies.get(ROBOT), "metadata", None)
        return "" if metadata is None else f"{metadata.package_version} {metadata.commit}"

    def answer(self, question: Question) -> Answer:
        """Choose; an error of a policy becomes the answer's ``error``."""
        player = question.player
        situation, policy = self._situations[player], self._policies[player]
        for array, data in zip(situation.arrays(), question.arrays, strict=True):
            array[...] = np.frombuffer(data, array.dtype).reshape(array.shape)
        start_s = time.perf_counter()
        try:
            if question.begins:
                reset(policy, np.ones(1, np.bool_), self._config)
            chosen = choose(policy, situation)
        except PolicyError as error:
            return Answer(question.number, player, error=str(error))
        if player == ROBOT:
            choice = int(chosen[0]), 0
        else:
            kind, value = choices_of(chosen)[0].tolist()
            choice = kind, value
        answer = Answer(question.number, player, choice, elapsed_ms=1000 * (time.perf_counter() - start_s))
        try:
            self._explain(policy, situation, question, answer)
        except PolicyError as error:  # the choice remains valid without an explanation
            answer.unexplained = f"{error}; its scores are not shown"
        return answer

    def _explain(self, policy: Policy, situation: Situation, question: Question, answer: Answer) -> None:
        if question.scores:
            answer.scores = scores(policy, situation)[0].tolist()
        if question.why:
            with what_users_raise(type(policy), policy.name):
                answer.why = as_json(_reasons(policy, situation, answer.choice[0], self._config.robot.speed_mps))


def rehearse(policy: Policy, view: RobotView, config: Config) -> Policy:
    """Run the policy, so that everything that it needs is loaded and compiled, and return it.

    Raises ValueError or TypeError if the policy fails, or needs more than ``SLOW_S``. It chooses against a wandering
    ghost and a chasing ghost, because other code and data predict a chase.
    """
    situation, first = view.sample_situation(), np.ones(1, np.bool_)
    chased = situation.copy()
    chased.belief[...] = np.eye(chased.belief.shape[-1])[CHASES]
    reset(policy, first, config)
    fastest_s = math.inf
    for seen in (situation, chased, situation):  # the first calls may compile
        scores(policy, seen)
        start_s = time.perf_counter()
        choose(policy, seen)
        fastest_s = min(fastest_s, time.perf_counter() - start_s)
    if fastest_s > SLOW_S:
        raise ValueError(f"policy {name_of(policy)!r}: needs {fastest_s:.1f} s to choose, must be at most {SLOW_S:g} s")
    reset(policy, first, config)
    return policy


def _reasons(policy: Policy, situation: Situation, chosen: int, robot_mps: float) -> dict[str, Any]:
    """Explain a choice: terms and distances of the chosen and of all allowed candidates."""
    rows = []
    for candidate, terms in enumerate(policy.explain(situation)[0]):
        if situation.mask[0, candidate] or candidate == chosen:
            values = {name: value for name, value in terms.items() if name != "kind"}
            distances = reach(situation, candidate, robot_mps)
            rows.append({"candidate": candidate, "kind": terms["kind"], "terms": {policy.name: values}, **distances})
    chosen_by = {"policies": [policy.name], "chosen": {policy.name: chosen}}
    return {"time_s": round(float(situation.time_s[0]), 2), "goal": chosen, **chosen_by, "rows": rows}


def encode(message: Any) -> bytes:
    return msgspec.msgpack.encode(message, enc_hook=lambda value: value.tolist())


def as_json(condition: dict[str, Any]) -> str:
    """Encode as JSON in one line; numbers that are not finite become null."""
    return msgspec.json.encode(condition, enc_hook=lambda value: value.tolist()).decode()


def _limit_memory() -> None:
    """Let this process, not the game, end if memory runs out."""
    resource.setrlimit(resource.RLIMIT_DATA, (_MOST_MEMORY, _MOST_MEMORY))
    with contextlib.suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text("1000")


def serve(pipe: Connection) -> int:
    """Load the policies of the setup that comes first, then answer questions; return the exit status."""
    end_with_parent(SIGKILL)
    _limit_memory()
    with contextlib.suppress(EOFError, ConnectionError):
        try:
            policies = Policies(msgspec.msgpack.decode(pipe.recv_bytes(), type=PolicySetup))
        except UNUSABLE as error:
            pipe.send_bytes(encode(Answer(error=" ".join(str(error).split()))))
            return 2
        release_memory()
        pipe.send_bytes(encode(Answer(version=policies.version)))
        while True:
            question = msgspec.msgpack.decode(pipe.recv_bytes(), type=Question)
            pipe.send_bytes(encode(policies.answer(question)))
    return 0


if __name__ == "__main__":
    # A second descriptor of the pipe, which only the kernel closes: the game hears of the end when the status is known.
    os.dup(int(sys.argv[1]))
    sys.exit(serve(Connection(int(sys.argv[1]))))
