"""Train a planner and a Clyde against each other: ``python docs/examples/adversary.py --quick``.

In each round a Clyde learns by PPO against the newest planner, then the planner against a pool: the original Clyde in
a share of the games, the other behaviours and all learned Clydes in the rest. Then both play validation rounds, also
against the rules. The folder `--out` contains ``planner-K.onnx``, ``clyde-K.onnx`` and ``table.json``. It needs the
extra `train`.
"""

import argparse
import dataclasses
import json
from pathlib import Path

import msgspec
import numpy as np
import torch
from tqdm import tqdm

from pacman_env import BehaviourOpponent, Opponents, make_policy, wilson
from pacman_env.policies.metadata import read_planner
from pacman_env.sim.ghost_state import BEHAVIOUR_NAMES
from pacman_env.training.arguments import FOLDER, Arguments, load_hyperparameters
from pacman_env.training.checkpoint import facts_of
from pacman_env.training.export import export_planner, network_of
from pacman_env.training.games import make_ghost_parts, make_parts
from pacman_env.training.held_out import HeldOut
from pacman_env.training.labels import imitate
from pacman_env.training.lineups import LEARNED
from pacman_env.training.ppo import PPO

RULES = ("lookahead", "clyde_aware")
PLANNER, CLYDE = 0, 1
#: Of planner and Clyde: games at the same time, and learning rate at the start and at the end of a round.
GAMES, RATES = (128, 32), ((3e-4, 5e-5), (1e-3, 1e-4))


class Adversaries:
    """Both learners with their files, and the shares of rounds that each pair completed."""

    def __init__(self, options: argparse.Namespace) -> None:
        self.options = options
        self.hyper = load_hyperparameters(FOLDER / "PacManBot-v2.yaml", "headline")
        self.decisions, self.files = [0, 0], dict[str, Path]()
        self.completed: dict[str, dict[str, np.ndarray]] = {}
        planner, path = self.arguments(PLANNER), options.start
        network = None if path is None else network_of(path)
        sizes = {} if network is None else {"width": network.width, "dropped_kinds": network.dropped_kinds}
        if network is not None:
            sizes["dropped_features"] = tuple(np.flatnonzero(network.shown.numpy() == 0).tolist())
            self.decisions[PLANNER] = read_planner(path)[0].training.decisions
        self.models = [
            PPO(planner.hyper, options.seed, threads=2, **sizes),
            PPO(self.arguments(CLYDE).hyper, options.seed + 1, threads=2),
        ]
        if network is not None:
            self.models[PLANNER].network.load_state_dict(network.state_dict())
        elif options.imitation > 0:
            seeds = self.seeds(PLANNER, 0)
            imitate(self.models[PLANNER], make_parts(planner, 0), options.imitation, games_seed=seeds[0], seed=seeds[1])

    def arguments(self, side: int, ghost: str = "wander") -> Arguments:
        """Return the arguments of a side's games; ``ghost`` plays Clyde when the planner learns."""
        options, games = self.options, min(GAMES[side], self.options.games)
        rollout = games * self.hyper.n_steps
        decisions = max((options.planner_decisions, options.clyde_decisions)[side], 1)
        changes = {"games": games, "decisions": decisions, "segment": rollout, "batch_size": rollout // 2}
        changes |= {"learning_rate": RATES[side], "levels": options.levels, "ghosts": (ghost,)}
        if options.clyde_speed is not None:
            changes["clyde_speed"] = tuple(options.clyde_speed)
        return Arguments(dataclasses.replace(self.hyper, **changes), seed=options.seed)

    def seeds(self, side: int, number: int) -> list[int]:
        """Return two seeds of a side in a round."""
        return np.random.SeedSequence(self.options.seed, spawn_key=(number, side)).generate_state(2).tolist()

    def learn(self, side: int, number: int, parts: list) -> None:
        """Train one side by PPO in its games, with learning rates from their beginning."""
        model, (torch_seed, games_seed) = self.models[side], self.seeds(side, number)
        torch.manual_seed(torch_seed)
        model.decisions = 0
        with tqdm(total=model.hyper.decisions) as bar:
            model.learn(parts, model.hyper.decisions, games_seed, bar)
        self.decisions[side] += model.decisions

    def export(self, side: int, number: int) -> str:
        """Write the network of a side and return its name."""
        name = f"{('planner', 'clyde')[side]}-{number}"
        facts = facts_of(self.arguments(side), self.decisions[side], {})
        if number > 0:
            ghosts = ("policy",) if side == CLYDE else (*BEHAVIOUR_NAMES, "policy")
            facts = msgspec.structs.replace(facts, training=msgspec.structs.replace(facts.training, ghosts=ghosts))
        self.files[name] = self.options.out / f"{name}.onnx"
        export_planner(self.models[side].network, self.files[name], facts)
        return name

    def play(self, policy: str, *clydes: str) -> None:
        """Play the validation rounds of the pairs that have not played."""
        row = self.completed.setdefault(policy, {})
        for clyde in clydes:
            if clyde not in row:
                learned = make_policy(str(self.files[clyde])) if clyde in self.files else None
                ghosts = (clyde if learned is None else LEARNED,)
                rounds = HeldOut(self.arguments(PLANNER), self.options.evaluation, ghosts=ghosts)
                row[clyde] = rounds.completed(make_policy(str(self.files.get(policy, policy))), learned)

    def round(self, number: int) -> None:
        """Train Clyde, then the planner, and measure both."""
        before = f"planner-{number - 1}"
        robot = make_policy(str(self.files[before]))
        self.learn(CLYDE, number, make_ghost_parts(self.arguments(CLYDE), number - 1, robot))
        clyde = self.export(CLYDE, number)
        if self.options.planner_decisions > 0:
            others = [BehaviourOpponent("chase"), BehaviourOpponent("arcade")]
            others += [make_policy(str(path)) for name, path in self.files.items() if name.startswith("clyde")]
            shares = [self.options.wander, *[(1 - self.options.wander) / len(others)] * len(others)]
            pool = Opponents([BehaviourOpponent("wander"), *others], shares)
            self.learn(PLANNER, number, make_parts(self.arguments(PLANNER, LEARNED), number, pool))
        self.play(before, clyde)
        for policy in (self.export(PLANNER, number), *RULES):
            self.play(policy, *BEHAVIOUR_NAMES, clyde)


def main() -> None:
    """Train in turns, and print and write the table of completed rounds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="two minutes on two cores")
    quick = parser.parse_known_args()[0].quick
    add = parser.add_argument
    add("--start", type=Path, metavar="FILE.onnx", help="planner to start with; without: imitation of lookahead")
    add("--out", type=Path, default=Path("results/adversary"), help="folder of the run (results/adversary)")
    add("--seed", type=int, default=0, help="seed of everything random (0)")
    add("--clyde-speed", type=float, nargs=2, help="range of Clyde's speed, m/s (as in the section headline)")
    add("--wander", type=float, default=0.4, help="share of the planner's games with the original Clyde (0.4)")
    for name, long, short in (
        *(("rounds", 3, 1), ("clyde-decisions", 196608, 32768), ("planner-decisions", 524288, 65536)),
        *(("imitation", 131072, 32768), ("games", 128, 64), ("levels", 96, 32), ("evaluation", 256, 64)),
    ):
        add(f"--{name}", type=int, default=short if quick else long, help=f"({long}; with --quick {short})")
    options = parser.parse_args()
    options.out.mkdir(parents=True)
    run = Adversaries(options)
    run.play(run.export(PLANNER, 0), *BEHAVIOUR_NAMES)
    for number in range(1, options.rounds + 1):
        run.round(number)
        print(f"round {number}, completed of {options.evaluation} [95 %]:")
        for policy, row in run.completed.items():
            for clyde, ended in row.items():
                low, high = wilson(int(ended.sum()), len(ended))
                print(f"  {policy} against {clyde}: {ended.mean():.1%} [{low:.0%}, {high:.0%}]")
        table = {policy: {clyde: float(x.mean()) for clyde, x in row.items()} for policy, row in run.completed.items()}
        (options.out / "table.json").write_text(json.dumps(table, indent=2))


if __name__ == "__main__":
    main()
