"""``python -m pacman_env.ros.supervisor.prepare_game``: check a setup, compile for the nodes and prepare the map."""

import contextlib
import io
import json
import os
import sys
from pathlib import Path

from pacman_env.engine.cache_folder import check_kept
from pacman_env.levels.assets import map_assets
from pacman_env.observations.robot_view import RobotView
from pacman_env.policies.registry import make_policy, split_ghosts
from pacman_env.ros.game_nodes import SELECTOR, SIMULATOR, GameSetup, from_json
from pacman_env.ros.selector.rehearsal import rehearse
from pacman_env.ros.supervisor.preparation import CHECKED, GHOSTS, PreparationJob, map_mark
from pacman_env.ros.supervisor.processes import BAD_START
from pacman_env.sim.ghost_state import MapGhosts
from pacman_env.sim.robot_simulation import SimulatedRobot
from pacman_env.world.maps.occupancy import load_map


def prepare(job: PreparationJob, setup: GameSetup) -> None:
    config = setup.config()
    if SELECTOR in job.nodes:
        policy = make_policy(job.policy)
        rehearse(policy, RobotView(map_assets(setup.map, config), config), config)
    if SIMULATOR in job.nodes:
        SimulatedRobot(load_map(setup.map), config, 0).compile_kernels()
    if GHOSTS in job.nodes:
        behaviours, _ = split_ghosts(config.clyde.ghosts)
        MapGhosts(
            map_assets(setup.map, config), config.with_fields(**{"clyde.ghosts": behaviours}), 0
        ).compile_kernels()
    _note(job.mark)


def _note(mark: Path | None) -> None:
    """Create the file ``mark``, which shows that code or the map are prepared, if the cache folder can be written."""
    if mark is not None:
        with contextlib.suppress(OSError):
            check_kept()
            mark.touch()


def main() -> int:
    check, parts = json.loads(sys.argv[1])
    try:
        setup = from_json(sys.argv[2])
        config = setup.config()
        if check:
            make_policy(setup.policy)
            split_ghosts(config.clyde.ghosts)
            print(CHECKED, flush=True)
        with contextlib.redirect_stderr(io.StringIO()):  # hides the notice that this process waits for another process
            for nodes, policy in parts:
                prepare(PreparationJob(tuple(nodes), policy), setup)
            if check and (file := map_mark(setup)) is not None and not file.exists():
                map_assets(setup.map, config)
                _note(file)
    except (ValueError, OSError, TypeError, ModuleNotFoundError) as error:
        print(" ".join(str(error).split()), file=sys.stderr)
        return BAD_START
    return 0


if __name__ == "__main__":
    status = main()
    sys.stderr.flush()
    os._exit(status)  # skips the interpreter's end: it takes a second, for which the game would wait
