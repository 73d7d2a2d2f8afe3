"""PPO (Schulman et al., 2017) over candidates that may be forbidden, arranged for speed, and imitation before it.

PPO from random weights hides from Clyde for its first half million decisions; from imitation it begins where the rule
ends.

Situations are packed once, when they are met (``network.Packed``). A minibatch goes through the network in pieces that
stay in the processor's cache, divided among threads; gradients are added in the pieces' order, so the number of threads
changes nothing.
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
from pacman_env.sim.observation.planner_features import CANDIDATE_FEATURES, GLOBAL_FEATURES
from pacman_env.training.arguments import Hyperparameters
from pacman_env.training.collector import Collector
from pacman_env.training.fragments import Fragment, check
from pacman_env.training.games import Ending
from pacman_env.training.network import EntityNetwork, Packed, Row

#: From the rows of a piece of a minibatch to its part of the minibatch's loss, and of measures of it.
PieceLoss = Callable[[torch.Tensor], tuple[torch.Tensor, torch.Tensor]]
_PIECE = 512  # situations
_MEASURES = ("policy_gradient_loss", "value_loss", "entropy_loss", "approx_kl", "clip_fraction")
#: Of imitation: rounds of play, epochs after each, situations in a minibatch, learning rate.
_ROUNDS, _EPOCHS, _BATCH, _RATE = 4, 2, 2048, 1e-3
_ENTROPY = 0.1  # of imitation: keeps the choices from becoming certain, so that PPO has something to compare
_ENDINGS = 1000  # endings of earlier rollouts in the logged shares


class Rollout(NamedTuple):
    situations: Packed
    slots: torch.Tensor  # (B,) the candidates chosen, as the situations have them
    log_probs: torch.Tensor  # (B,)
    values: torch.Tensor  # (B,)
    advantages: torch.Tensor  # (B,)
    returns: torch.Tensor  # (B,)


class Learner:
    """A network and its training: by default with random weights from the seed, ``sizes`` are EntityNetwork's."""

    def __init__(self, hyper: Hyperparameters, seed: int, device: str = "cpu", threads: int = 1, **sizes: Any) -> None:
        torch.manual_seed(seed)
        network = EntityNetwork(len(CANDIDATE_FEATURES), len(GLOBAL_FEATURES), **({"width": hyper.width} | sizes))
        self.network = network.to(device)
        self.optimizer = torch.optim.Adam(network.parameters(), hyper.learning_rate[0], eps=1e-5)
        self.hyper, self.device, self.threads = hyper, device, threads  # 0 threads: one for each core
        self.decisions = 0  # of PPO so far
        self.logger = Logger(None, [])
        self._last_rounds: deque[Ending] = deque(maxlen=100)

    def learn(self, games: Collector, decisions: int, seed: int, bar: Any) -> None:
        """PPO for at least so many more decisions, in new rounds of the games, whose seed is given."""
        first, began = self.decisions, time.perf_counter()
        games.reset(seed)
        met = Row(self.hyper.n_steps * games.num_envs)
        endings: list[str] = []
        while self.decisions < first + decisions:
            rollout, ended = self.collect(games, met, bar)
            self.decisions += len(rollout.returns)
            self._last_rounds.extend(ended)
            endings += [ending.outcome for ending in ended]
            if endings:
                complete, timeout = (endings.count(outcome) / len(endings) for outcome in ("complete", "timeout"))
                self.logger.record("rollout/completed", complete)
                self.logger.record("rollout/timed_out", timeout)
                bar.set_postfix(completed=f"{complete:.1%}", timeout=f"{timeout:.1%}", refresh=False)
                del endings[:-_ENDINGS]
            if self._last_rounds:
                self.logger.record("rollout/ep_rew_mean", np.mean([ending.reward for ending in self._last_rounds]))
                self.logger.record("rollout/ep_len_mean", np.mean([ending.length for ending in self._last_rounds]))
            self.logger.record("time/fps", int((self.decisions - first) / (time.perf_counter() - began)))
            self.logger.dump(self.decisions)
            self.update(rollout)

    def collect(self, games: Collector, met: Row, bar: Any) -> tuple[Rollout, list[Ending]]:
        """``n_steps`` decisions in each game, and the rounds that ended; ``met`` is the memory of the situations."""
        hyper = self.hyper
        played = games.play(self.network, hyper.n_steps, on_fragment=lambda one: bar.update(len(one.slots)))
        met.clear()
        rows: list[tuple[torch.Tensor, ...]] = []
        for one in played:
            met.add(Packed(*(tensor(array).to(self.device) for array in one.situations)))
            values = tensor(one.values)
            found = advantages(tensor(one.rewards), values, tensor(one.dones).float(), hyper.gamma, hyper.gae_lambda)
            flat = (values[:-1], found, found + values[:-1])
            rows.append((tensor(one.slots), tensor(one.log_probs), *(array.flatten() for array in flat)))
        joined = (torch.cat(parts).to(self.device) for parts in zip(*rows, strict=True))
        return Rollout(met.situations(), *joined), [ending for one in played for ending in one.endings]

    def update(self, rollout: Rollout) -> None:
        """Some epochs over the rollout; raises FloatingPointError if the losses are not finite."""
        hyper, progress = self.hyper, self.hyper.progress(self.decisions)
        pairs = hyper.learning_rate, hyper.ent_coef
        rate, entropy_weight = (first + (last - first) * progress for first, last in pairs)
        self.optimizer.param_groups[0]["lr"] = rate
        gains = rollout.advantages

        def loss_of(rows: torch.Tensor) -> PieceLoss:
            scaled = (gains - gains[rows].mean()) / (gains[rows].std() + 1e-8)
            return partial(self._loss, rollout, scaled, entropy_weight, len(rows))

        counts = rollout.situations.counts
        means = self.descend(self.optimizer, loss_of, counts, epochs=hyper.n_epochs, size=hyper.batch_size)
        check(means)
        for name, value in zip(_MEASURES, means.tolist(), strict=True):
            self.logger.record(f"train/{name}", value)
        explained = explained_variance(rollout.values.cpu().numpy(), rollout.returns.cpu().numpy())
        self.logger.record("train/explained_variance", explained)
        self.logger.record("train/learning_rate", rate)
        self.logger.record("train/clip_range", hyper.clip_range)

    def _loss(
        self, rollout: Rollout, gains: torch.Tensor, entropy_weight: float, count: int, rows: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """PPO's loss of some rows of a minibatch of ``count``, and their part in ``_MEASURES``."""
        clip = self.hyper.clip_range
        logits, values = self.network.judge_packed(rollout.situations.of(rows))
        log_probs = logits.log_softmax(dim=1)
        entropy = -(log_probs.exp() * log_probs).sum()
        log_ratio = log_probs.gather(1, rollout.slots[rows, None])[:, 0] - rollout.log_probs[rows]
        ratio, gain = log_ratio.exp(), gains[rows]
        objective = torch.min(gain * ratio, gain * ratio.clamp(1 - clip, 1 + clip)).sum()
        error = (values - rollout.returns[rows]).square().sum()
        with torch.no_grad():
            clipped, divergence = ((ratio - 1).abs() > clip).sum(), (ratio - 1 - log_ratio).sum()
            measures = torch.stack([-objective, error, -entropy, divergence, clipped]) / count
        return (self.hyper.vf_coef * error - objective - entropy_weight * entropy) / count, measures

    def descend(
        self,
        optimizer: torch.optim.Optimizer,
        loss_of: Callable[[torch.Tensor], PieceLoss],
        counts: torch.Tensor,
        *,
        epochs: int,
        size: int,
        generator: torch.Generator | None = None,
    ) -> torch.Tensor:
        """Step the optimizer once for each minibatch of ``size`` in all epochs; returns the minibatches' mean measures.

        ``loss_of`` makes the loss of a minibatch from its rows. ``counts`` (B,) are the candidates that may be chosen
        in the situations: those with as many go together.
        """
        weights = list(self.network.parameters())

        def gradients(loss: PieceLoss, piece: torch.Tensor) -> tuple[tuple[torch.Tensor, ...], torch.Tensor]:
            total, measures = loss(piece)
            return torch.autograd.grad(total, weights), measures

        means = []
        with ThreadPoolExecutor(self.threads or cores(), "learner") as pool:
            for _ in range(epochs):
                for rows in torch.randperm(len(counts), generator=generator).to(self.device).split(size):
                    pieces = rows[counts[rows].argsort(stable=True)].split(_PIECE if self.device == "cpu" else size)
                    found, measures = zip(*pool.map(partial(gradients, loss_of(rows)), pieces), strict=True)
                    for weight, *parts in zip(weights, *found, strict=True):
                        weight.grad = torch.stack(parts).sum(dim=0)
                    torch.nn.utils.clip_grad_norm_(weights, self.hyper.max_grad_norm)
                    optimizer.step()
                    means.append(torch.stack(measures).sum(dim=0))
        return torch.stack(means).mean(dim=0)


class _Labels(NamedTuple):
    slots: torch.Tensor  # (B,) its choices, as the situations have them
    returns: torch.Tensor  # (B,) discounted
    known: torch.Tensor  # (B,) 1 where the return is known: the round ended in time

    def loss(self, model: Learner, met: Packed, count: int, rows: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Of some rows of a minibatch of ``count`` of the situations ``met``; no measures."""
        situations, slots = met.of(rows), self.slots[rows]
        logits, values = model.network.judge_packed(situations)
        log_probs = logits.log_softmax(dim=1)
        entropy = -(log_probs.exp() * log_probs).sum()
        error = ((values - self.returns[rows]).square() * self.known[rows]).sum()
        taught = slots < situations.counts  # nothing is learned from what the network of an ablation may not choose
        labelled = log_probs.gather(1, torch.where(taught, slots, 0)[:, None])[:, 0]
        return (0.5 * error - (labelled * taught).sum() - _ENTROPY * entropy) / count, torch.zeros(0)


def imitate(model: Learner, games: Collector, decisions: int, *, games_seed: int, seed: int) -> dict[str, float]:
    """Fit the network to what the games' teachers would choose in so many situations; ``seed`` orders minibatches.

    In the first of four rounds the rule plays, in the others the network does and the rule labels the situations, so
    that the network also learns in situations that the rule does not get into (DAgger: Ross, Gordon, Bagnell, 2011).
    Returns the share of choices that agree in the last round.
    """
    steps = max(decisions // games.num_envs // _ROUNDS, 1)
    optimizer = torch.optim.Adam(model.network.parameters(), lr=_RATE)
    generator = torch.Generator().manual_seed(seed)
    met, labelled = Row(_ROUNDS * steps * games.num_envs), list[_Labels]()
    games.reset(games_seed)
    for number in range(_ROUNDS):
        played = games.play(model.network, steps, "labelled" if number > 0 else "taught")
        for one in played:
            met.add(Packed(*(tensor(array).to(model.device) for array in one.situations)))
            labelled.append(_labels(model, one))
        _fit(model, optimizer, met.situations(), _Labels(*map(torch.cat, zip(*labelled, strict=True))), generator)
    return {"agreement": float(np.average([one.agreed for one in played], weights=[len(one.slots) for one in played]))}


def _labels(model: Learner, played: Fragment) -> _Labels:
    returns, known = discounted(played.rewards, played.dones, model.hyper.gamma)
    return _Labels(*(tensor(array.ravel()).to(model.device) for array in (played.slots.copy(), returns, known)))


def tensor(array: NDArray[Any]) -> torch.Tensor:
    """The same memory where it may be written to, as torch wants it: what comes from another process may not be."""
    return torch.from_numpy(np.require(array, requirements="W"))


def _fit(
    model: Learner, optimizer: torch.optim.Optimizer, met: Packed, labels: _Labels, generator: torch.Generator
) -> None:
    def loss_of(rows: torch.Tensor) -> PieceLoss:
        return partial(labels.loss, model, met, len(rows))

    model.descend(optimizer, loss_of, met.counts, epochs=_EPOCHS, size=_BATCH, generator=generator)


def discounted(
    rewards: NDArray[np.float32], dones: NDArray[np.bool_], gamma: float
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(T, N) discounted sums of rewards to the end of the round, and 1 where that end is among the steps, else 0."""
    returns, known = np.zeros_like(rewards), np.zeros_like(rewards)
    running, ends = np.zeros(rewards.shape[1], dtype=np.float32), np.zeros(rewards.shape[1], dtype=np.bool_)
    for t in reversed(range(len(rewards))):
        ends |= dones[t]
        running = rewards[t] + np.float32(gamma) * np.where(dones[t], np.float32(0.0), running)
        returns[t], known[t] = running, ends
    return returns, known


def advantages(
    rewards: torch.Tensor, values: torch.Tensor, dones: torch.Tensor, gamma: float, gae_lambda: float
) -> torch.Tensor:
    """(T, N) generalized advantages (Schulman et al., 2016) of (T, N) rewards, (T + 1, N) values and (T, N) dones."""
    found, running = torch.zeros_like(rewards), torch.zeros_like(rewards[0])
    for t in reversed(range(len(rewards))):
        going = gamma * (1 - dones[t])
        running = rewards[t] + going * values[t + 1] - values[t] + going * gae_lambda * running
        found[t] = running
    return found
