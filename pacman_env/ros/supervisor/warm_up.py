"""``python -m pacman_env.ros.supervisor.warm_up``: compiles what nodes need before any is started, without ROS."""

import contextlib
import io
import json
import sys
from dataclasses import dataclass
from pathlib import Path
from subprocess import DEVNULL, PIPE, Popen

import numpy as np

from pacman_env.engine.cache_folder import mark
from pacman_env.policies.registry import make_policy, split_ghosts
from pacman_env.ros.selector.rehearsal import rehearsed
from pacman_env.ros.supervisor.game_nodes import SELECTOR, SIMULATOR, GameSetup, from_json
from pacman_env.sim.core.ghosts import MapGhosts
from pacman_env.sim.core.robot import SimulatedRobot
from pacman_env.sim.maps.assets import map_assets
from pacman_env.sim.observation.robot_view import RobotView
from pacman_env.world.maps.occupancy import load_map

GHOSTS = "clyde_ghost_node"
BAD_SETUP = 2  # exit status, after one line


@dataclass(frozen=True)
class Part:
    """What one process compiles: for some nodes, with a policy."""

    nodes: tuple[str, ...]
    policy: str = ""

    @property
    def mark(self) -> Path | None:
        """The file that exists once it is done; None where nothing is kept."""
        kind = Path(self.policy).suffix.lstrip(".") or self.policy
        return mark(f"warm-{'-'.join(self.nodes)}-{kind or 'none'}")


def parts(setup: GameSetup) -> list[Part]:
    """The parts that are not compiled yet; none where nothing can be kept."""
    ghosts = (GHOSTS, SIMULATOR) if setup.sim else (GHOSTS,)
    wanted = [Part((SELECTOR,), setup.policy), Part(ghosts)]
    return [part for part in wanted if part.mark is not None and not part.mark.exists()]


def start(part: Part, setup: GameSetup) -> Popen[str]:
    """A process that compiles that part; it ends with 0, or with 2 after one line on stderr."""
    command = [sys.executable, "-m", __name__, json.dumps([part.nodes, part.policy]), setup.as_json()]
    return Popen(command, stdin=DEVNULL, stdout=DEVNULL, stderr=PIPE, text=True, start_new_session=True)


def rehearse(part: Part, setup: GameSetup) -> None:
    config = setup.config()
    if SELECTOR in part.nodes:
        policy = make_policy(part.policy)
        rehearsed(policy, RobotView(map_assets(setup.map, config), config), config)
    if SIMULATOR in part.nodes:  # before the ghosts: another process compiles meanwhile what both need of a map
        SimulatedRobot(load_map(setup.map), config, 0).rehearse()
    if GHOSTS in part.nodes:
        behaviours, _ = split_ghosts(config.clyde.ghosts)
        ghosts = MapGhosts(map_assets(setup.map, config), config.with_fields(**{"clyde.ghosts": behaviours}), 0)
        ghosts.rehearse(np.zeros(len(behaviours), dtype=np.int64))
    if part.mark is not None:
        part.mark.touch()


def main() -> int:
    nodes, policy = json.loads(sys.argv[1])
    try:
        with contextlib.redirect_stderr(io.StringIO()):  # that it waits for another part's kernels is no error
            rehearse(Part(tuple(nodes), policy), from_json(sys.argv[2]))
    except (ValueError, OSError, TypeError, ModuleNotFoundError) as error:
        print(" ".join(str(error).split()), file=sys.stderr)
        return BAD_SETUP
    return 0


if __name__ == "__main__":
    sys.exit(main())
