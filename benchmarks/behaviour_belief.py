"""How soon the belief of what a ghost does is right: ``python -m benchmarks.behaviour_belief``.

Rounds against one ghost of each behaviour, whose death radius is 0 so that they go on; printed are, over time, the mean
probabilities and the share of games in which the ghost is taken to come for the robot.
"""

import argparse
import sys
from typing import Any

import numpy as np

from benchmarks.harness import Option, benchmark, count
from pacman_env.config import make_config
from pacman_env.game.behaviour_belief import BELIEVED, comes
from pacman_env.game.execution import RUNNING
from pacman_env.policies.registry import make_policy
from pacman_env.sim.core.batch import GameBatch
from pacman_env.sim.maps.assets import map_assets

_TIMES_S = (2.0, 4.0, 8.0, 15.0, 30.0, 60.0)
_TOUCHED_M = 0.5  # a game counts until the ghost has come so near


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    figures: dict[str, Any] = {}
    print(
        f"{arguments.map}, ghosts of {arguments.speed} m/s, {arguments.games} games each, robot by {arguments.policy}"
    )
    print(f"{'ghost':<8}{'after s':>8}{'games':>7}" + "".join(f"{name:>9}" for name in BELIEVED) + "    comes")
    for name in BELIEVED[:-1]:
        settings = {"clyde.speed_mps": arguments.speed, "execution.death_radius_m": 1e-6, "nav2.clyde_keepout_m": 1e-6}
        config = make_config("robot", **{"clyde.ghosts": (name,), **settings})
        batch = GameBatch(map_assets(arguments.map, config), config, arguments.games)
        batch.reset(np.arange(batch.n), arguments.seed + np.arange(batch.n, dtype=np.uint64))
        policy = make_policy(arguments.policy)
        policy.reset(np.ones(batch.n, np.bool_), config)
        apart = np.ones(batch.n, np.bool_)
        tick_s = config.execution.tick_s
        for tick in range(round(_TIMES_S[-1] / tick_s) + 1):
            situation = batch.situation()
            apart &= batch.games["distance"] > _TOUCHED_M
            going = apart & (batch.games["end"] == RUNNING)
            if tick * tick_s in _TIMES_S and going.any():
                belief = situation.belief[going, 0]
                coming = float(comes(belief.T).mean())
                mean = belief.mean(axis=0).tolist()
                print(f"{name:<8}{tick * tick_s:8.0f}{going.sum():7d}", end="")
                print("".join(f"{share:9.2f}" for share in mean) + f"{coming:9.0%}")
                figures[f"{name}, {tick * tick_s:.0f} s"] = {"games": int(going.sum()), "mean": mean, "comes": coming}
            batch.step(policy.select(situation))
    return figures


SPEED: Option = ("--speed", {"type": float, "default": 0.25, "metavar": "M_PER_S", "help": "(%(default)s)"})
POLICY: Option = ("--policy", {"default": "lookahead", "help": "of the robot (%(default)s)"})
main = benchmark("behaviour_belief", __doc__, run, "--seed", count("--games", 200), SPEED, POLICY)

if __name__ == "__main__":
    sys.exit(main())
