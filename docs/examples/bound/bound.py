"""Bound and estimate the share of rounds that can be completed: ``python docs/examples/bound/bound.py --map house``.

A start is the beginning of a round. It is lost if the robot is caught, or the time limit ends, before it can collect
all pellets. The share of the other starts is an upper bound for every policy. A wide beam search that foresees every
move of the ghosts plays the same starts in the coarse model; the share that it wins is an estimate.
"""

import argparse
from typing import Any

import numpy as np
from blocks import SQUARES, Graph, build_graph
from numpy.typing import NDArray
from pursuit import FOR_EVER, LATTICE, from_start, pace, survival

from pacman_env import Config, Situation, load_map, make_config, wilson
from pacman_env.engine.jit import kernel
from pacman_env.episodes.rollout import episode_seeds
from pacman_env.game.ghosts import find_behaviour
from pacman_env.heuristics.search.beam import NODE, new_memory, search
from pacman_env.heuristics.search.search import SearchParameters
from pacman_env.levels.assets import MapAssets, map_assets
from pacman_env.observations.coarse_start import start
from pacman_env.observations.situation_writer import situation_of
from pacman_env.sim.batch import GameBatch
from pacman_env.sim.coarse_model import MOST_PELLETS, NOWHERE, Behaviours, Lags, play

SEARCH = SearchParameters()


def least_collection_s(graph: Graph, places: list[int], config: Config) -> float:
    """Return a lower bound of the time to collect all pellets, s; ``places`` are blocks, the home pose first.

    A path through all places contains a spanning tree, so it is at least as long as a minimum spanning tree. A straight
    path is at most ``LATTICE`` times shorter than the path on the lattice. The bound subtracts the radius in which a
    pellet is collected, and a diagonal for the places inside blocks.
    """
    paths, before = np.full((len(places), len(graph.robot_xy)), np.inf), None
    paths[np.arange(len(places)), places] = 0.0
    cost = SQUARES[graph.move_kind] * graph.edge_m
    while not np.array_equal(paths, before):  # Bellman-Ford; moves are the same in both directions
        before = paths
        paths = np.minimum(paths, np.minimum.reduceat(paths[:, graph.move_to] + cost, graph.first_move[:-1], axis=1))
    reached_m = config.nav2.goal_tolerance_m + config.execution.success_margin_m
    radius = max(config.execution.pickup_radius_m, reached_m)
    off = 2.0 * radius + float(SQUARES[1]) * graph.edge_m
    least = np.maximum(paths[:, places] / LATTICE - off, 0.0)
    joined = np.zeros(len(places), dtype=np.bool_)
    nearest, total, k = least[0], 0.0, 0
    for _ in range(len(places) - 1):  # Prim's algorithm
        joined[k] = True
        nearest = np.minimum(nearest, least[k])
        k = int(np.where(joined, np.inf, nearest).argmin())
        total += float(nearest[k])
    return total / config.robot.speed_mps


@kernel
def _play(begin, goal, until_s):
    play(begin.robot[0], begin.ghosts, goal, until_s, begin.model)


def estimate(situation: Situation, config: Config, width: int) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Play the starts (N,) by a beam search with the coarse model's lags; return which it wins, and the ends, s."""
    ghosts = [find_behaviour(name) for name in config.clyde.ghosts]
    behaviours, lags = Behaviours(ghosts, config), Lags(step_s=config.execution.check_period_s, death_margin_m=0.0)
    settings = SEARCH.settings()
    settings["width"] = width
    memory = new_memory(width, len(ghosts), settings)
    won, ends = np.zeros(len(situation.mask), dtype=np.bool_), np.zeros(len(situation.mask))
    for i in range(len(won)):
        begin = start(situation, i, config, behaviours, lags, NODE)
        robot, model = begin.robot[0], begin.model
        while robot["pellets"] and not robot["dead"] and robot["time_s"] < config.time_limit_s:
            length = model.map.robot_length[robot["block"]]
            order = np.argsort(length, kind="stable")
            order = order[np.isfinite(length[order])]
            left = (model.bit >= 0) & (
                np.uint64(robot["pellets"]) >> np.maximum(model.bit, 0).astype(np.uint64) & 1 == 1
            )
            refuges = order[order >= begin.pellets][: int(settings["refuges"][0])]
            goals = np.r_[order[left[order]][: int(settings["pellets"][0])], refuges, NOWHERE].astype(np.int64)
            worths = np.empty(len(goals))
            copy = begin._replace(robot=begin.robot.copy(), ghosts=begin.ghosts.copy())
            copy.robot["collected"], copy.robot["collected_s"], copy.robot["closest_m"] = 0, 0, np.inf
            search(copy, goals, settings, memory, worths)
            worths += SEARCH.keep_worth * ((goals == robot["goal"]) & (goals != NOWHERE))  # prefer the current goal
            _play(begin, goals[worths.argmax()], float(robot["time_s"]) + SEARCH.segment_s)
        won[i], ends[i] = not robot["pellets"], robot["time_s"]
    return won, ends


def blocks_at(assets: MapAssets, blocks: NDArray[np.int32], xy: NDArray[np.float64]) -> NDArray[np.int32]:
    """Return the blocks (N,) nearest to points (N, 2)."""
    column, row, _ = assets.grid.locate(xy.astype(np.float64))
    rows, columns = blocks.shape
    return blocks[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)]


def bound(graph: Graph, assets: MapAssets, config: Config, seeds: NDArray[np.uint64], width: int) -> dict[str, Any]:
    """Return the bounds of the starts with these seeds (N,) against chasers, and the estimate for a search width."""
    batch = GameBatch(assets, config, len(seeds))
    batch.reset(np.arange(len(seeds)), seeds)
    starts = situation_of(batch)  # drawn as in the game
    home, *pellets = blocks_at(assets, graph.robot_at, np.vstack([assets.grid.home[:2], assets.goal_xy]))
    least = least_collection_s(graph, [home, *pellets[: assets.pellets]], config)
    step = pace(graph, config.robot.speed_mps, config.clyde.speed_mps)
    left = survival(graph, step, config.execution.death_radius_m)
    caught = np.full(len(seeds), np.inf)
    for number in range(len(config.clyde.ghosts)):
        ghosts = blocks_at(assets, graph.ghost_at, starts.ghosts[:, number, :2])
        caught = np.minimum(caught, from_start(graph, left, step, int(home), ghosts))
    won, ends = estimate(starts, config, width)
    lost = (caught < least) | (least > config.time_limit_s)
    safe = np.mean(left[:, :, 0] == FOR_EVER)
    return {"least_s": least, "caught_s": caught, "safe": safe, "lost": lost, "won": won, "ends_s": ends}


def main() -> None:
    """Print a row for each speed of the ghosts."""
    parser = argparse.ArgumentParser(description=__doc__)
    add = parser.add_argument
    add("--map", default="house", help="name or file (house)")
    add("--speeds", nargs="+", type=float, default=[0.15, 0.25, 0.35, 0.45], help="of the ghosts, m/s (0.15 to 0.45)")
    add("--ghosts", type=int, default=1, help="number of chasing ghosts (1)")
    add("--starts", type=int, default=50, help="number of starts (50)")
    add("--seed", type=int, default=0, help="seed of the starts (0)")
    add("--width", type=int, default=64, help="width of the search (64)")
    options = parser.parse_args()
    ghosts = {"localization.perfect": True, "clyde.ghosts": ("chase",) * options.ghosts}
    assets = map_assets(load_map(options.map), make_config(**ghosts))
    if assets.pellets > MOST_PELLETS:
        parser.error(f"--map {options.map}: {assets.pellets} pellets, must be at most {MOST_PELLETS}")
    seeds = episode_seeds(options.seed, options.starts)
    graph = build_graph(assets)
    print(f"{options.map}: {assets.pellets} pellets, {len(seeds)} starts, blocks of {graph.edge_m:.2f} m")
    print("  m/s  safe pairs  survive <=  win <=     win about  in s  at least s  contradictions")
    for speed in options.speeds:
        row = bound(graph, assets, make_config(**ghosts, **{"clyde.speed_mps": speed}), seeds, options.width)
        won, seconds = row["won"], row["ends_s"][row["won"]]
        low, high = (100 * end for end in wilson(int(won.sum()), len(won)))
        about = f"{100 * won.mean():.0f} [{low:.0f}, {high:.0f}]"
        mean = f"{seconds.mean():.0f}" if len(seconds) else "-"
        survive, win = 100 * np.isinf(row["caught_s"]).mean(), 100 * (~row["lost"]).mean()
        text = f"{speed:5g}{100 * row['safe']:12.1f}{survive:12.1f}{win:8.1f}{about:>14}{mean:>6}"
        print(f"{text}{row['least_s']:12.0f}{(won & row['lost']).sum():16}")


if __name__ == "__main__":
    main()
