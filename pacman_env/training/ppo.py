"""PPO (Schulman et al., 2017) over candidates with action masks: ``pacman-env train``, from arguments to update.

A training consists of segments. A segment starts with new games and its own random numbers, drawn from the run's seed
and the segment's number, and ends with a checkpoint. An interrupted run therefore continues from its last checkpoint
with the same curve, bit for bit. Its loop is: collect a rollout, compute advantages, update in minibatches.

Threads play the parts of the games and share the chunks of a minibatch, each small enough for a processor's cache.
Gradients are added in the order of the chunks, so the number of threads does not change the result.
"""

import copy
import itertools
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import torch
from torch.utils.tensorboard import SummaryWriter
from tqdm import tqdm

from ..command_line.command import guarded
from ..engine.cores import cores
from ..observations.planner_features import CANDIDATE_FEATURES, GLOBAL_FEATURES
from ..policies.base import Policy
from .arguments import Arguments, Hyperparameters, parse
from .arguments import make_parser as make_parser
from .checkpoint import Run, TorchPlanner, facts_path, read_facts, restore
from .export import export_planner, start_from
from .games import Ending, Games, clyde_limit, dropped, game_config, make_ghost_parts, make_parts, start, to_repeat
from .held_out import HeldOut, report
from .labels import imitate
from .league import League
from .lineups import make_teacher
from .network import EntityNetwork, PackedSituations, check, choose, joined, use_device

#: Returns, for the rows of a chunk, the chunk's part of the minibatch's loss and metrics.
ChunkLoss = Callable[[torch.Tensor], tuple[torch.Tensor, torch.Tensor]]
Numbers = dict[str, float]  # logged numbers by their names in TensorBoard
_CHUNK = 256  # situations of a minibatch that go through the network at once
_METRICS = ("policy_gradient_loss", "value_loss", "entropy_loss", "approx_kl", "clip_fraction")


def main(argv: Sequence[str] | None = None) -> int:
    return guarded("pacman-env train", lambda: run(parse(sys.argv[1:] if argv is None else argv)), "train")


def run(arguments: Arguments) -> None:
    """Train a planner, compare it with rules in test rounds, and write it as ONNX file."""
    began = time.perf_counter()
    folder, model = train(arguments)
    pool = League(arguments).pool(arguments.hyper.segments - 1, folder.against_league())
    print(report(arguments, planner_of(arguments, model), pool, time.perf_counter() - began))
    out = arguments.out / "planner.onnx"
    export_planner(model.network, out, read_facts(facts_path(folder.last)))
    print(f"written: {out} (as a policy: pacman-env compare --policies {out})")


def train(
    arguments: Arguments, after_segment: Callable[[dict[str, Any]], None] = lambda record: None
) -> tuple[Run, "PPO"]:
    """Train all remaining segments; return the run's folder and the final model.

    ``after_segment`` is called with the record of each segment, earlier ones included; its exceptions end the training.
    """
    hyper, sizes = arguments.hyper, dropped(arguments)
    model = PPO(hyper, arguments.seed, arguments.device, arguments.threads, arguments.value_decisions, **sizes)
    folder = Run(arguments)
    first = len(folder.segments)
    if first > 0:
        restore(folder.checkpoint(first - 1), model.network, model.optimizer)
    elif arguments.start is not None:
        start_from(arguments.start, model.network)
    for record in folder.segments:
        after_segment(record)
    shown: dict[str, Any] = {"unit": "decision", "unit_scale": True, "mininterval": 1.0, "file": sys.stderr}
    shown |= {"total": hyper.segments * hyper.segment, "initial": first * hyper.segment}
    validation = HeldOut(arguments, arguments.evaluation)
    with tqdm(**shown, disable=not arguments.progress) as bar, SummaryWriter(arguments.out, flush_secs=10) as writer:
        for segment in range(first, hyper.segments):
            train_segment(folder, segment, model, validation, bar, writer)
            after_segment(folder.segments[-1])
    return folder, model


def train_segment(
    folder: Run, segment: int, model: "PPO", validation: HeldOut, bar: Any, writer: SummaryWriter
) -> None:
    """Train a segment, play validation rounds and write checkpoints."""
    arguments, hyper, league = folder.arguments, model.hyper, League(folder.arguments)
    seeds = np.random.SeedSequence(arguments.seed, spawn_key=(segment,)).generate_state(3).tolist()
    began = time.perf_counter()
    if league.is_due(segment):
        train_clyde(league, segment, planner_of(arguments, model))
    pool = league.pool(segment, folder.against_league())
    repeats = folder.segments[-1]["again"] if folder.segments else {}
    parts = make_parts(arguments, segment, pool, repeats)
    torch.manual_seed(seeds[0])
    result: dict[str, Any] = {"segment": segment}
    if segment == 0 and hyper.imitation > 0:
        result["agreement"] = imitate(model, parts, hyper.imitation, games_seed=seeds[1], seed=seeds[2])
        result["imitated"] = validation.shares(validation.completed(planner_of(arguments, model), pool))[0]
        rules = " and ".join(dict.fromkeys(make_teacher(one, hyper.teacher_nodes).name for one in hyper.lineups))
        told = f": {result['imitated']:.1%} of validation rounds completed" if arguments.evaluation else ""
        bar.write(f"{rules} imitated{told}")
    model.decisions = segment * hyper.segment
    learning = time.perf_counter()
    endings = model.learn(parts, hyper.segment, seeds[1], bar, partial(_log, writer))
    ended = time.perf_counter()
    completed = validation.completed(planner_of(arguments, model), pool)
    share, each = validation.shares(completed)
    of_league = validation.learned()
    speed = hyper.segment / (ended - learning)
    result |= {
        "decisions": model.decisions,
        "completed": share,
        "completed_against": each,
        "against_league": league.record(segment, validation.seeds[of_league], completed[of_league], pool),
        "again": to_repeat(endings),
        "clyde_limit_mps": clyde_limit(arguments, segment),
        "seconds": round(ended - began, 1),
        "decisions_per_s": round(speed),
    }
    folder.write(model.network, model.optimizer, result)
    told = f"{model.decisions} decisions, {speed:.0f}/s"
    if len(completed) > 0:
        each = each if len(each) > 1 else {}
        names = {f"validation/completed_{lineup.replace(',', '_')}": part for lineup, part in each.items()}
        _log(writer, {"validation/completed": share, **names}, model.decisions)
        told += f": {share:.1%} of validation rounds completed"
        told += f" ({'; '.join(f'{lineup} {part:.1%}' for lineup, part in each.items())})" if each else ""
    bar.write(told)


def _log(writer: SummaryWriter, numbers: Numbers, decisions: int) -> None:
    for name, value in numbers.items():
        writer.add_scalar(name, value, decisions)


def train_clyde(league: League, segment: int, planner: Policy) -> None:
    """Train the due member of the league against the current planner."""
    arguments, weights, seeds = league.training(segment)
    learner = PPO(arguments.hyper, seeds[0], threads=arguments.threads)
    if weights is not None:
        start_from(weights, learner.network)
    torch.manual_seed(seeds[0])
    parts = make_ghost_parts(arguments, segment, planner)
    learner.learn(parts, arguments.hyper.decisions, seeds[1], tqdm(disable=True))
    league.add(segment, learner.network, learner.decisions)


def planner_of(arguments: Arguments, model: "PPO") -> TorchPlanner:
    """Return a copy of the current network as a policy."""
    return TorchPlanner("ppo", model.copy(), game_config(arguments).robot.speed_mps)


class Rollout(NamedTuple):
    """Decisions of games; the B = T N decisions of N games in T steps are ordered by step, then by game."""

    situations: PackedSituations  # (B, ...)
    slots: torch.Tensor  # (B,) places of the chosen candidates in ``situations``
    log_probs: torch.Tensor  # (B,)
    values: torch.Tensor  # (B,)
    advantages: torch.Tensor  # (B,)
    returns: torch.Tensor  # (B,)


class PPO:
    """A network with its optimizer and training; ``seed`` decides the weights, ``sizes`` go to EntityNetwork."""

    def __init__(
        self,
        hyper: Hyperparameters,
        seed: int,
        device: str = "cpu",
        threads: int = 1,  # 0: one per core
        value_decisions: int = 0,  # first decisions, in which only the values are fitted
        **sizes: Any,
    ) -> None:
        self.hyper, self.device = hyper, use_device(device)
        torch.manual_seed(seed)
        network = EntityNetwork(len(CANDIDATE_FEATURES), len(GLOBAL_FEATURES), **({"width": hyper.width} | sizes))
        self.network = network.to(device)
        self.optimizer = torch.optim.Adam(network.parameters(), hyper.learning_rate[0], eps=1e-5)
        self.value_decisions = value_decisions
        self.decisions = 0  # decisions that PPO has learned from so far
        self.pool = ThreadPoolExecutor(threads or cores(), "learner")

    def copy(self) -> EntityNetwork:
        """Return a copy of the network on the CPU."""
        return copy.deepcopy(self.network).cpu()

    def learn(
        self,
        parts: Sequence[Games],
        decisions: int,
        seed: int,
        bar: Any,
        log: Callable[[Numbers, int], object] = lambda numbers, decisions: None,
    ) -> list[Ending]:
        """Run PPO for at least ``decisions`` more decisions, in new rounds that ``seed`` decides; return their ends."""
        first, began = self.decisions, time.perf_counter()
        endings: list[Ending] = []
        start(parts, seed, self.pool)
        for number in itertools.count():
            if self.decisions >= first + decisions:
                break
            rollout, ended = self.collect(parts, (seed, number), bar)
            self.decisions += len(rollout.returns)
            endings += ended
            numbers = {"time/fps": (self.decisions - first) / (time.perf_counter() - began)}
            log(numbers | _summary(endings) | self.update(rollout), self.decisions)
        return endings

    def collect(self, parts: Sequence[Games], seeds: tuple[int, int], bar: Any) -> tuple[Rollout, list[Ending]]:
        """Play ``n_steps`` decisions in each game; return the rollout and the rounds that ended.

        What a part draws depends only on the ``seeds`` (of the games, number of the rollout) and on the part's place.
        """
        hyper, network = self.hyper, self.copy()
        rollouts: list[Rollout] = []
        endings: list[Ending] = []

        def play_part(k: int) -> tuple[Rollout, list[Ending]]:
            seed = np.random.SeedSequence(seeds[0], spawn_key=(seeds[1], k)).generate_state(1)[0]
            return play(parts[k], network, hyper, int(seed))

        for rollout, ended in self.pool.map(play_part, range(len(parts))):
            bar.update(len(rollout.returns))
            rollouts.append(rollout)
            endings += ended
        return joined(rollouts, self.device), endings

    def update(self, rollout: Rollout) -> Numbers:
        """Update the network with the rollout for some epochs; raises FloatingPointError if a loss is not finite."""
        hyper, progress = self.hyper, self.hyper.progress(self.decisions)
        pairs = hyper.learning_rate, hyper.ent_coef
        learning_rate, ent_coef = (first + (last - first) * progress for first, last in pairs)
        self.optimizer.param_groups[0]["lr"] = learning_rate
        for name, weight in self.network.named_parameters():
            weight.requires_grad_(self.decisions > self.value_decisions or name.startswith("critic"))
        means = []
        counts = rollout.situations.mask.sum(dim=1)
        for _ in range(hyper.n_epochs):
            for rows in torch.randperm(len(rollout.returns)).to(self.device).split(hyper.batch_size):
                advantages = rollout.advantages[rows]
                normalized = (rollout.advantages - advantages.mean()) / (advantages.std() + 1e-8)
                loss = partial(self.loss, rollout, normalized, ent_coef, len(rows))
                means.append(self.descend(self.optimizer, loss, rows, counts))
        metrics = torch.stack(means).mean(dim=0)
        check(metrics)
        explained = 1 - (rollout.returns - rollout.values).var() / rollout.returns.var()
        numbers = {"explained_variance": float(explained), "learning_rate": learning_rate}
        numbers |= {"clip_range": hyper.clip_range, **dict(zip(_METRICS, metrics.tolist(), strict=True))}
        return {f"train/{name}": number for name, number in numbers.items()}

    def loss(
        self, rollout: Rollout, advantages: torch.Tensor, ent_coef: float, count: int, rows: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the loss of ``rows`` (M,) and their part of ``_METRICS`` (5,).

        The rows belong to a minibatch of ``count`` situations; the sum over all its rows is the loss of the minibatch.
        ``advantages`` (B,) are normalized.
        """
        clip_range = self.hyper.clip_range
        logits, values = self.network(*rollout.situations.of(rows))
        log_probs = logits.log_softmax(dim=1)
        entropy = -(log_probs.exp() * log_probs).sum()
        log_ratio = log_probs.gather(1, rollout.slots[rows, None])[:, 0] - rollout.log_probs[rows]
        ratio, advantage = log_ratio.exp(), advantages[rows]
        surrogate = torch.min(advantage * ratio, advantage * ratio.clamp(1 - clip_range, 1 + clip_range)).sum()
        value_loss = (values - rollout.returns[rows]).square().sum()
        with torch.no_grad():
            clip_fraction, approx_kl = ((ratio - 1).abs() > clip_range).sum(), (ratio - 1 - log_ratio).sum()
            metrics = torch.stack([-surrogate, value_loss, -entropy, approx_kl, clip_fraction]) / count
        return (self.hyper.vf_coef * value_loss - surrogate - ent_coef * entropy) / count, metrics

    def descend(
        self, optimizer: torch.optim.Optimizer, loss: ChunkLoss, rows: torch.Tensor, counts: torch.Tensor
    ) -> torch.Tensor:
        """Step the optimizer once with the minibatch ``rows`` (M,), and return the sum of the chunks' metrics.

        ``counts`` (B,) are the numbers of allowed candidates. Situations with similar numbers share a chunk, which is
        cut to the largest: an update takes 37 % less time than with all candidates, and than with one chunk.
        """
        weights = [weight for weight in self.network.parameters() if weight.requires_grad]

        def gradients(chunk: torch.Tensor) -> tuple[tuple[torch.Tensor, ...], torch.Tensor]:
            total, metrics = loss(chunk)
            return torch.autograd.grad(total, weights), metrics

        chunks = rows[counts[rows].argsort(stable=True)].split(_CHUNK if self.device == "cpu" else len(rows))
        grads, metrics = zip(*self.pool.map(gradients, chunks), strict=True)
        for weight, *parts in zip(weights, *grads, strict=True):
            weight.grad = torch.stack(parts).sum(dim=0)
        torch.nn.utils.clip_grad_norm_(weights, self.hyper.max_grad_norm)
        optimizer.step()
        optimizer.zero_grad()  # with old gradients, the next optimizer would move frozen weights
        return torch.stack(metrics).sum(dim=0)


@torch.inference_mode()
def play(games: Games, network: EntityNetwork, hyper: Hyperparameters, seed: int) -> tuple[Rollout, list[Ending]]:
    """Play ``n_steps`` decisions in each game of a part, drawn with ``seed``; return them and the rounds that ended."""
    generator = torch.Generator().manual_seed(seed)
    choices, steps = [], []
    for _ in range(hyper.n_steps):
        choices.append(choose(network, games.observation, generator))
        steps.append(games.step(choices[-1].actions))
    rewards = torch.from_numpy(np.stack([step.rewards for step in steps]))
    dones = torch.from_numpy(np.stack([step.dones for step in steps])).float()
    values = torch.stack([*(one.values for one in choices), choose(network, games.observation).values])
    gae = advantages(rewards, values, dones, hyper.gamma, hyper.gae_lambda)
    returns = gae + values[:-1]
    situations, _, slots, log_probs, *_ = zip(*choices, strict=True)
    flat = (torch.cat(slots), torch.cat(log_probs), values[:-1].flatten(), gae.flatten(), returns.flatten())
    return Rollout(joined(situations), *flat), [ending for step in steps for ending in step.endings]


def advantages(
    rewards: torch.Tensor, values: torch.Tensor, dones: torch.Tensor, gamma: float, gae_lambda: float
) -> torch.Tensor:
    """Return GAE advantages (T, N; Schulman et al., 2016) of rewards (T, N), values (T + 1, N) and dones (T, N)."""
    result, last_gae = torch.zeros_like(rewards), torch.zeros_like(rewards[0])
    for t in reversed(range(len(rewards))):
        discount = gamma * (1 - dones[t])
        last_gae = rewards[t] + discount * values[t + 1] - values[t] + discount * gae_lambda * last_gae
        result[t] = last_gae
    return result


def _summary(endings: list[Ending]) -> Numbers:
    """Return means over the last rounds, 1,000 for outcomes and 100 for rewards and lengths; nothing without rounds."""
    if not endings:
        return {}
    outcomes, last = [ending.outcome for ending in endings[-1000:]], endings[-100:]
    return {
        "rollout/completed": outcomes.count("complete") / len(outcomes),
        "rollout/timed_out": outcomes.count("timeout") / len(outcomes),
        "rollout/ep_rew_mean": float(np.mean([ending.reward for ending in last])),
        "rollout/ep_len_mean": float(np.mean([ending.length for ending in last])),
    }
