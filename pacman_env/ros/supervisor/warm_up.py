"""Compiles what nodes of a game need, before any of them is started: ``python -m pacman_env.ros.supervisor.warm_up``.

Compiled kernels are kept on disk (``kernel_cache.py``), so this is work for the first start on a machine and after an
update. What is done already is marked beside them. ROS is not imported.
"""

from __future__ import annotations

import contextlib
import io
import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pacman_env.config import Config, make_config, parse_settings
from pacman_env.engine import jit
from pacman_env.policies.registry import split_ghosts
from pacman_env.ros.selector.rehearsal import rehearsed
from pacman_env.ros.supervisor.game_nodes import SELECTOR, SIMULATOR, GameSetup
from pacman_env.sim.core.map_ghosts import MapGhosts
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
        """The file that says that it is done; None: nothing is kept."""
        kind = Path(self.policy).suffix.lstrip(".") or self.policy
        return jit.mark(f"warm-{'-'.join(self.nodes)}-{kind or 'none'}")


def parts(setup: GameSetup) -> list[Part]:
    """The parts that have yet to be compiled, none where nothing can be kept."""
    ghosts = (GHOSTS, SIMULATOR) if setup.sim else (GHOSTS,)
    wanted = [Part((SELECTOR,), setup.policy), Part(ghosts)]
    return [part for part in wanted if part.mark is not None and not part.mark.exists()]


def start(part: Part, setup: GameSetup) -> subprocess.Popen[str]:
    """A process that compiles that part; it ends with 0, or with 2 after one line on stderr."""
    words = [setup.map, setup.preset, setup.execution, *setup.settings]
    command = [sys.executable, "-m", __name__, json.dumps([part.nodes, part.policy, words])]
    quiet = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL}
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True, **quiet)  # type: ignore[call-overload]


def rehearse(part: Part, map_yaml: str, config: Config) -> None:
    """Do once what the part's nodes do.

    Raises:
        ValueError: a map, policy or configuration that cannot be played.
    """
    if SELECTOR in part.nodes:
        rehearsed(part.policy, RobotView(map_assets(map_yaml, config), config), config)
    if SIMULATOR in part.nodes:  # before the ghosts: another process compiles meanwhile what both need of a map
        SimulatedRobot(load_map(map_yaml), config, 0).rehearse()
    if GHOSTS in part.nodes:
        behaviours, _ = split_ghosts(config.clyde.ghosts)
        ghosts = MapGhosts(map_assets(map_yaml, config), config.with_fields(**{"clyde.ghosts": behaviours}), 0)
        ghosts.rehearse(np.zeros(len(behaviours), dtype=np.int64))


def main() -> int:
    """Compile the part that the only argument names."""
    nodes, policy, (map_yaml, preset, execution, *settings) = json.loads(sys.argv[1])
    part = Part(tuple(nodes), policy)
    try:
        with contextlib.redirect_stderr(io.StringIO()):  # that it waits for another part's kernels is no error
            rehearse(part, map_yaml, make_config(preset, execution, **parse_settings(settings)))
    except (ValueError, OSError, TypeError, ModuleNotFoundError) as error:
        print(" ".join(str(error).split()), file=sys.stderr)
        return BAD_SETUP
    if part.mark is not None:
        part.mark.touch()
    return 0


if __name__ == "__main__":
    sys.exit(main())
