"""PPO (Schulman et al., 2017) over candidates with action masks, and imitation before it.

From random weights, PPO spends its first half million decisions on hiding from Clyde; imitation avoids this.

The loop is: collect a rollout, compute advantages (GAE), update in minibatches. Situations are packed once, when they
are collected (``planner_network.PackedSituations``). Threads share the chunks of a minibatch, each small enough for a
processor's cache. Gradients are added in the order of the chunks, so the number of threads does not change the result.
"""

import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.utils import explained_variance

from pacman_env.engine.cores import cores
from pacman_env.observations.planner_features import CANDIDATE_FEATURES, GLOBAL_FEATURES
from pacman_env.training.collector import Collector
from pacman_env.training.fragments import Fragment, check
from pacman_env.training.planner_network import EntityNetwork, PackedSituations, joined
from pacman_env.training.run_arguments import Hyperparameters
from pacman_env.training.training_games import Ending

#: Returns, for the rows of a chunk, the chunk's part of the minibatch's loss and metrics.
ChunkLoss = Callable[[torch.Tensor], tuple[torch.Tensor, torch.Tensor]]
_CHUNK = 512  # situations of a minibatch that go through the network at once
_METRICS = ("policy_gradient_loss", "value_loss", "entropy_loss", "approx_kl", "clip_fraction")
#: Imitation: number of turns of playing and fitting, epochs of each turn, minibatch size, learning rate.
_ROUNDS, _EPOCHS, _BATCH, _RATE = 4, 2, 2048, 1e-3
_ENTROPY = 0.1  # entropy coefficient of imitation, so that PPO can still explore
_ENDINGS = 1000  # most endings from which the logged shares are computed


class Rollout(NamedTuple):
    situations: PackedSituations
    slots: torch.Tensor  # (B,) places of the chosen candidates in ``situations``
    log_probs: torch.Tensor  # (B,)
    values: torch.Tensor  # (B,)
    advantages: torch.Tensor  # (B,)
    returns: torch.Tensor  # (B,)


class PPO:
    """A network with its optimizer and training; ``seed`` decides the weights, ``sizes`` go to EntityNetwork."""

    def __init__(self, hyper: Hyperparameters, seed: int, device: str = "cpu", threads: int = 1, **sizes: Any) -> None:
        torch.manual_seed(seed)
        network = EntityNetwork(len(CANDIDATE_FEATURES), len(GLOBAL_FEATURES), **({"width": hyper.width} | sizes))
        self.network = network.to(device)
        self.optimizer = torch.optim.Adam(network.parameters(), hyper.learning_rate[0], eps=1e-5)
        self.hyper, self.device, self.threads = hyper, device, threads  # threads = 0: one per core
        self.decisions = 0  # decisions that PPO has learned from so far
        self.logger = Logger(None, [])
        self._last_endings: deque[Ending] = deque(maxlen=100)

    def learn(self, games: Collector, decisions: int, seed: int, bar: Any) -> None:
        """Run PPO for at least ``decisions`` more decisions, in new rounds that ``seed`` decides."""
        first, start_s = self.decisions, time.perf_counter()
        games.reset(seed)
        outcomes: list[str] = []
        while self.decisions < first + decisions:
            rollout, endings = self.collect(games, bar)
            self.decisions += len(rollout.returns)
            self._last_endings.extend(endings)
            outcomes += [ending.outcome for ending in endings]
            if outcomes:
                complete, timeout = (outcomes.count(outcome) / len(outcomes) for outcome in ("complete", "timeout"))
                self.logger.record("rollout/completed", complete)
                self.logger.record("rollout/timed_out", timeout)
                bar.set_postfix(completed=f"{complete:.1%}", timeout=f"{timeout:.1%}", refresh=False)
                del outcomes[:-_ENDINGS]
            if self._last_endings:
                self.logger.record("rollout/ep_rew_mean", np.mean([ending.reward for ending in self._last_endings]))
                self.logger.record("rollout/ep_len_mean", np.mean([ending.length for ending in self._last_endings]))
            self.logger.record("time/fps", int((self.decisions - first) / (time.perf_counter() - start_s)))
            self.logger.dump(self.decisions)
            self.update(rollout)

    def collect(self, games: Collector, bar: Any) -> tuple[Rollout, list[Ending]]:
        """Play ``n_steps`` decisions in each game; return the rollout and the rounds that ended."""
        hyper = self.hyper
        fragments = games.play(self.network, hyper.n_steps, on_fragment=lambda part: bar.update(len(part.slots)))
        rows: list[tuple[torch.Tensor, ...]] = []
        for part in fragments:
            values = torch.from_numpy(part.values)
            gae = advantages(
                torch.from_numpy(part.rewards),
                values,
                torch.from_numpy(part.dones).float(),
                hyper.gamma,
                hyper.gae_lambda,
            )
            flat = (values[:-1], gae, gae + values[:-1])
            rows.append(
                (torch.from_numpy(part.slots), torch.from_numpy(part.log_probs), *(array.flatten() for array in flat))
            )
        whole = (torch.cat(parts).to(self.device) for parts in zip(*rows, strict=True))
        situations = joined(_situations(part, self.device) for part in fragments)
        return Rollout(situations, *whole), [ending for part in fragments for ending in part.endings]

    def update(self, rollout: Rollout) -> None:
        """Update the network with the rollout for some epochs; raises FloatingPointError if a loss is not finite."""
        hyper, progress = self.hyper, self.hyper.progress(self.decisions)
        pairs = hyper.learning_rate, hyper.ent_coef
        learning_rate, ent_coef = (first + (last - first) * progress for first, last in pairs)
        self.optimizer.param_groups[0]["lr"] = learning_rate
        advantages = rollout.advantages

        def make_loss(rows: torch.Tensor) -> ChunkLoss:
            normalized = (advantages - advantages[rows].mean()) / (advantages[rows].std() + 1e-8)
            return partial(self._loss, rollout, normalized, ent_coef, len(rows))

        counts = rollout.situations.counts
        means = self.descend(self.optimizer, make_loss, counts, epochs=hyper.n_epochs, size=hyper.batch_size)
        check(means)
        for name, value in zip(_METRICS, means.tolist(), strict=True):
            self.logger.record(f"train/{name}", value)
        explained = explained_variance(rollout.values.cpu().numpy(), rollout.returns.cpu().numpy())
        self.logger.record("train/explained_variance", explained)
        self.logger.record("train/learning_rate", learning_rate)
        self.logger.record("train/clip_range", hyper.clip_range)

    def _loss(
        self, rollout: Rollout, advantages: torch.Tensor, ent_coef: float, count: int, rows: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the loss of ``rows`` (M,) and their part of ``_METRICS`` (5,).

        The rows belong to a minibatch of ``count`` situations; the sum over all its rows is the loss of the minibatch.
        ``advantages`` (B,) are normalized.
        """
        clip_range = self.hyper.clip_range
        logits, values = self.network.judge_packed(rollout.situations.of(rows))
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
        self,
        optimizer: torch.optim.Optimizer,
        make_loss: Callable[[torch.Tensor], ChunkLoss],
        counts: torch.Tensor,
        *,
        epochs: int,
        size: int,
        generator: torch.Generator | None = None,
    ) -> torch.Tensor:
        """Step the optimizer once per minibatch of ``size`` situations in all epochs; return the mean metrics.

        ``make_loss`` creates the loss of a minibatch from its rows. ``counts`` (B,) are the numbers of allowed
        candidates; situations with similar numbers share a chunk.
        """
        weights = list(self.network.parameters())

        def gradients(loss: ChunkLoss, chunk: torch.Tensor) -> tuple[tuple[torch.Tensor, ...], torch.Tensor]:
            total, metrics = loss(chunk)
            return torch.autograd.grad(total, weights), metrics

        means = []
        with ThreadPoolExecutor(self.threads or cores(), "learner") as pool:
            for _ in range(epochs):
                for rows in torch.randperm(len(counts), generator=generator).to(self.device).split(size):
                    chunks = rows[counts[rows].argsort(stable=True)].split(_CHUNK if self.device == "cpu" else size)
                    grads, metrics = zip(*pool.map(partial(gradients, make_loss(rows)), chunks), strict=True)
                    for weight, *parts in zip(weights, *grads, strict=True):
                        weight.grad = torch.stack(parts).sum(dim=0)
                    torch.nn.utils.clip_grad_norm_(weights, self.hyper.max_grad_norm)
                    optimizer.step()
                    means.append(torch.stack(metrics).sum(dim=0))
        return torch.stack(means).mean(dim=0)


class _Labels(NamedTuple):
    situations: PackedSituations
    slots: torch.Tensor  # (B,) places of the teacher's choices in the situations
    returns: torch.Tensor  # (B,) discounted returns
    valid: torch.Tensor  # (B,) 1 if the return is complete, because the round ended

    def make_loss(self, network: EntityNetwork, rows: torch.Tensor) -> ChunkLoss:
        return partial(self._loss, network, len(rows))

    def _loss(self, network: EntityNetwork, count: int, rows: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the loss of ``rows`` (M,) of a minibatch of ``count`` situations, and no metrics (0,)."""
        situations, slots = self.situations.of(rows), self.slots[rows]
        logits, values = network.judge_packed(situations)
        log_probs = logits.log_softmax(dim=1)
        entropy = -(log_probs.exp() * log_probs).sum()
        value_loss = ((values - self.returns[rows]).square() * self.valid[rows]).sum()
        allowed = slots < situations.counts  # ignore a label that an ablation forbids
        label_log_probs = log_probs.gather(1, torch.where(allowed, slots, 0)[:, None])[:, 0]
        return (0.5 * value_loss - (label_log_probs * allowed).sum() - _ENTROPY * entropy) / count, torch.zeros(0)


def imitate(model: PPO, games: Collector, decisions: int, *, games_seed: int, seed: int) -> dict[str, float]:
    """Fit the network to the teachers' choices in ``decisions`` situations; ``seed`` decides the order of minibatches.

    In the first of four turns the teacher plays. In the others the network plays and the teacher labels the
    situations, so that the network also learns in situations that the teacher avoids (DAgger: Ross, Gordon, Bagnell,
    2011). ``games_seed`` decides the rounds. Returns ``agreement``: the share of choices in the last turn in which
    network and teacher agree.
    """
    steps = max(decisions // games.num_envs // _ROUNDS, 1)
    optimizer = torch.optim.Adam(model.network.parameters(), lr=_RATE)
    generator = torch.Generator().manual_seed(seed)
    parts = list[_Labels]()
    games.reset(games_seed)
    for number in range(_ROUNDS):
        played = games.play(model.network, steps, "labelled" if number > 0 else "taught")
        for fragment in played:
            returns, valid = discounted(fragment.rewards, fragment.dones, model.hyper.gamma)
            arrays = (torch.from_numpy(array.ravel()) for array in (fragment.slots.copy(), returns, valid))
            parts.append(_Labels(_situations(fragment, model.device), *(array.to(model.device) for array in arrays)))
        met, *arrays_of_parts = zip(*parts, strict=True)
        labels = _Labels(joined(met), *map(torch.cat, arrays_of_parts))
        fit = partial(labels.make_loss, model.network)
        model.descend(optimizer, fit, labels.situations.counts, epochs=_EPOCHS, size=_BATCH, generator=generator)
    return {"agreement": float(np.average([one.agreed for one in played], weights=[len(one.slots) for one in played]))}


def _situations(fragment: Fragment, device: str) -> PackedSituations:
    return PackedSituations(*(torch.from_numpy(array).to(device) for array in fragment.situations))


def discounted(
    rewards: NDArray[np.float32], dones: NDArray[np.bool_], gamma: float
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the discounted returns (T, N), and a mask (T, N): 1 if the round ends within the T steps, else 0."""
    nothing = torch.zeros(len(rewards) + 1, rewards.shape[1])
    returns = advantages(torch.from_numpy(rewards), nothing, torch.from_numpy(dones).float(), gamma, 1.0)
    return returns.numpy(), np.logical_or.accumulate(dones[::-1])[::-1].astype(np.float32)


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
