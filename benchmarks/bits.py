"""Compare what this version and another play, bit by bit: ``python -m benchmarks.bits ../before``, a checkout.

Every id is played with the same seeds and actions as a single environment, a vector environment and a PettingZoo
environment, and the policies play the rounds of README's table. Each row is a hash of all observations, rewards, ends
and infos, or of how the rounds ended. A pure move, rename or removal keeps every row. With ``--renew`` the figures
that were current in the other checkout become current here if all rows are equal. The other checkout needs this
program's ids with the same numbers.
"""

import argparse
import hashlib
import json
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

import pacman_env
from pacman_env.envs.registration import IDS

POLICIES = ("clyde_aware", "ppo", "lookahead", "nearest", "random_pellet")  # of README's table
_GAMES, _HOLD = 4, 8  # games of a vector environment; decisions for which an action is repeated
_TIMES = ("decision_ms",)  # parts of names whose values depend on the machine
_SPEED = "speed"  # the figure that equal bits do not keep


def main(argv: list[str] | None = None) -> int:
    """Print the hashes of the code on the module path as JSON, or compare them with those of a checkout."""
    if argv is None and sys.argv[1:2] == ["--worker"]:  # runs in the other checkout, whose other modules may differ
        print(json.dumps(_environments(int(sys.argv[2]))))
        return 0
    from benchmarks.harness import benchmark, count

    return benchmark(
        "bits",
        __doc__,
        _run,
        ("checkout", {"type": Path, "help": "folder of the other version"}),
        count("--steps", 300, "decisions of each environment (%(default)s)"),
        count("--episodes", 200, "rounds of each policy (%(default)s)"),
        ("--policies", {"nargs": "+", "default": POLICIES, "metavar": "P", "help": "(those of README's table)"}),
        ("--renew", {"action": "store_true", "help": "renew the inputs of docs/figures.json if all rows are equal"}),
        failed=lambda figures: bool(figures["different"]),
    )(argv)


def _run(arguments: argparse.Namespace) -> dict[str, Any]:
    from benchmarks.harness import ROOT

    there = arguments.checkout.resolve()
    here_rows, there_rows = (
        _in_checkout(root, "-P", __file__, "--worker", str(arguments.steps))
        | dict(zip(arguments.policies, _outcomes(root, arguments), strict=True))
        for root in (ROOT, there)
    )
    different = [name for name, row in here_rows.items() if there_rows.get(name) != row]
    for name, row in here_rows.items():
        print(f"{name:60} {row}  {'DIFFERENT' if name in different else 'equal'}")
    print(f"{len(here_rows) - len(different)} of {len(here_rows)} rows are equal")
    if arguments.renew and not different:
        print("current again:", ", ".join(_renew(there)) or "nothing")
    return {"rows": here_rows, "different": different}


def _renew(there: Path) -> list[str]:
    """Renew the inputs of the figures that are stale here and were current in ``there``; return their names."""
    from tools.figures import inputs, store

    records = store.read()
    names = sorted({one for record in records.values() for one in record["inputs"]})
    program = "import json, sys; from tools.figures.inputs import hashes; print(json.dumps(hashes(sys.argv[1:])))"
    old, new = _in_checkout(there, "-c", program, *names), inputs.hashes(names)
    renewed = []
    for name, record in records.items():
        inputs_here = {one: new[one] for one in record["inputs"]}
        if name != _SPEED and record["inputs"] != inputs_here and record["inputs"].items() <= old.items():
            record["inputs"] = inputs_here
            renewed.append(name)
    store.write(records)
    return renewed


def _in_checkout(root: Path, *arguments: str) -> dict[str, str]:
    from benchmarks.harness import in_checkout

    done = subprocess.run(**in_checkout(root, *arguments), stdout=subprocess.PIPE, check=True)
    return dict(json.loads(done.stdout))


def _outcomes(root: Path, arguments: argparse.Namespace) -> list[str]:
    """Return a hash of the outcomes of each policy's rounds, played with the code of a checkout."""
    from benchmarks.harness import in_checkout

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "rows.json")
        words = ["--map", arguments.map, "--episodes", str(arguments.episodes), "--policies", *arguments.policies]
        program = in_checkout(root, "-m", "pacman_env.cli.main", "compare", *words, "--json", str(file))
        subprocess.run(**program, capture_output=True, check=True)
        rows = json.loads(file.read_text(encoding="utf-8"))["rows"]
    return [_Digest({key: value for key, value in row.items() if key != "policy"}).text() for row in rows]


class _Digest:
    """A hash of nested data: arrays with dtype and shape, numbers, texts."""

    def __init__(self, *values: Any) -> None:
        self._hash = hashlib.sha256()
        self.add(values)

    def add(self, value: Any) -> None:
        if isinstance(value, Mapping):
            for key in sorted(value, key=str):
                if not any(part in str(key) for part in _TIMES):
                    self.add(str(key))
                    self.add(value[key])
        elif isinstance(value, list | tuple):
            for one in value:
                self.add(one)
        elif isinstance(value, np.ndarray | np.generic) and value.dtype != object:
            self._hash.update(f"{value.dtype}{value.shape}".encode() + value.tobytes())
        elif isinstance(value, np.ndarray):
            self.add(value.tolist())
        else:
            self._hash.update(repr(value).encode() + b"\0")

    def text(self) -> str:
        return self._hash.hexdigest()[:16]


def _environments(steps: int) -> dict[str, str]:
    """Return a hash of what each id plays in ``steps`` decisions, by id and interface."""
    rows = {}
    for name, entry in IDS.items():
        short = name.split("/")[1]
        games = gym.make_vec(name, num_envs=_GAMES, vectorization_mode="vector_entry_point")
        rows[f"{short} single"] = _gymnasium(gym.make(name).unwrapped, 0, steps)
        rows[f"{short} vector"] = _gymnasium(games, 1, steps)
        if entry.several is not None:
            rows[f"{short} parallel"] = _parallel(dict(entry.several), steps)
    return rows


def _draw(space: gym.Space[Any], mask: Any, generator: np.random.Generator) -> Any:
    """Return an action that ``mask`` allows, or any action of a box."""
    if isinstance(space, gym.spaces.Box):
        return generator.uniform(space.low, space.high).astype(space.dtype)
    return int(generator.choice(np.flatnonzero(mask)))


def _gymnasium(env: Any, seed: int, steps: int) -> str:
    """Return a hash of what a single or a vector environment plays."""
    digest, generator = _Digest(env.reset(seed=seed)), np.random.default_rng(seed)
    vector = hasattr(env, "num_envs")
    space = env.single_action_space if vector else env.action_space
    games, discrete = env.num_envs if vector else 1, isinstance(space, gym.spaces.Discrete)
    actions = np.zeros(games, np.int64)
    for step in range(steps):
        masks = np.atleast_2d(env.unwrapped.action_masks()) if discrete else np.ones((games, 1))
        if step % _HOLD == 0 or (discrete and not masks[np.arange(games), actions].all()):
            actions = np.array([_draw(space, mask, generator) for mask in masks])
        result = env.step(actions if vector else actions[0])
        digest.add(result)
        if not vector and (result[2] or result[3]):
            digest.add(env.reset())
    env.close()
    return digest.text()


def _parallel(arguments: dict[str, Any], steps: int) -> str:
    env, generator = pacman_env.parallel_env(**arguments), np.random.default_rng(2)
    observations, infos = env.reset(seed=2)
    digest = _Digest(observations, infos)
    for _ in range(steps):
        seen = {agent: observations[agent] for agent in env.agents}
        actions = {agent: _draw(env.action_space(agent), _mask_of(one), generator) for agent, one in seen.items()}
        observations, *rest = env.step(actions)
        digest.add((observations, rest))
        if not env.agents:
            observations, infos = env.reset()
            digest.add((observations, infos))
    env.close()
    return digest.text()


def _mask_of(observation: Any) -> Any:
    return observation.get("action_mask") if isinstance(observation, Mapping) else None


if __name__ == "__main__":
    sys.exit(main())
