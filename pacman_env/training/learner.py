"""PPO (Schulman et al., 2017) over candidates that may be forbidden, arranged for speed, and imitation before it.

PPO from random weights hides from Clyde for its first half million decisions; from imitation it begins where the rule
ends.

Games come in groups: while one is stepped, the network chooses for the other. Situations are packed once, when they
are met (``network.Packed``). A minibatch goes through the network in pieces that stay in the processor's cache, divided
among threads; gradients are added in the pieces' order, so the number of threads changes nothing.
"""

import os
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

from pacman_env.engine.threads import cores
from pacman_env.sb3 import Observation
from pacman_env.sim.observation.planner_features import CANDIDATE_FEATURES, GLOBAL_FEATURES
from pacman_env.training.arguments import Hyperparameters
from pacman_env.training.games import GhostGames, TrainingGames
from pacman_env.training.network import EntityNetwork, Packed, Row

#: From the rows of a piece of a minibatch to its part of the minibatch's loss, and of measures of it.
PieceLoss = Callable[[torch.Tensor], tuple[torch.Tensor, torch.Tensor]]
_PIECE = 512  # situations
_MEASURES = ("policy_gradient_loss", "value_loss", "entropy_loss", "approx_kl", "clip_fraction")
#: Of imitation: rounds of play, epochs after each, situations in a minibatch, learning rate.
_ROUNDS, _EPOCHS, _BATCH, _RATE = 4, 2, 2048, 1e-3
_ENTROPY = 0.1  # of imitation: keeps the choices from becoming certain, so that PPO has something to compare
_ENDINGS = 1000  # endings of earlier rollouts in the logged shares


class Choices(NamedTuple):
    situations: Packed
    order: torch.Tensor  # (B, C) of candidates in them
    slots: torch.Tensor  # (B,) the candidates chosen, as ``situations`` has them
    log_probs: torch.Tensor  # (B,)
    values: torch.Tensor  # (B,)


class Rollout(NamedTuple):
    choices: Choices
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
        self._last_rounds: deque[dict[str, Any]] = deque(maxlen=100)

    @torch.inference_mode()
    def choose(self, observation: Observation, deterministic: bool = False) -> tuple[Choices, NDArray[np.int64]]:
        """A choice for each situation, drawn or (``deterministic``) the likeliest, and the candidates' numbers."""
        seen = {key: torch.as_tensor(array, device=self.device) for key, array in observation.items()}
        situations, order = self.network.pack(
            seen["planner_candidates"], seen["planner_globals"], seen["action_mask"] > 0.5
        )
        logits, values = self.network.judge_packed(situations.of(slice(None)))
        log_probs = logits.log_softmax(dim=1)
        _check(values + log_probs.sum(dim=1))
        drawn = log_probs if deterministic else log_probs - torch.empty_like(log_probs).exponential_().log()
        slots = drawn.argmax(dim=1, keepdim=True)
        chosen = order.gather(1, slots)[:, 0].cpu().numpy()
        return Choices(situations, order, slots[:, 0], log_probs.gather(1, slots)[:, 0], values), chosen

    def learn(self, games: TrainingGames | GhostGames, decisions: int, seed: int, bar: Any) -> None:
        """PPO for at least so many more decisions, in new rounds of the games, whose seed is given."""
        first, began = self.decisions, time.perf_counter()
        observation = games.reset(seed)
        seen = [{key: array[rows] for key, array in observation.items()} for rows in games.groups]
        met = Row(self.hyper.n_steps * games.num_envs)
        endings: list[str] = []
        while self.decisions < first + decisions:
            rollout, ended = self.collect(games, seen, met, bar)
            self.decisions += len(rollout.returns)
            self._last_rounds.extend(info["episode"] for info in ended if "episode" in info)
            endings += [info["outcome"] for info in ended]
            if endings:
                complete, timeout = (endings.count(outcome) / len(endings) for outcome in ("complete", "timeout"))
                self.logger.record("rollout/completed", complete)
                self.logger.record("rollout/timed_out", timeout)
                bar.set_postfix(completed=f"{complete:.1%}", timeout=f"{timeout:.1%}", refresh=False)
                del endings[:-_ENDINGS]
            if self._last_rounds:
                for name, key in (("ep_rew_mean", "r"), ("ep_len_mean", "l")):
                    self.logger.record(f"rollout/{name}", np.mean([one[key] for one in self._last_rounds]))
            self.logger.record("time/fps", int((self.decisions - first) / (time.perf_counter() - began)))
            self.logger.dump(self.decisions)
            self.update(rollout)

    def collect(
        self, games: TrainingGames | GhostGames, seen: list[Observation], met: Row, bar: Any
    ) -> tuple[Rollout, list[dict[str, Any]]]:
        """``n_steps`` decisions in each game, and infos of the rounds that ended.

        ``seen`` has each group's observation, first and then last; ``met`` is the memory of the situations.
        """
        steps = self.hyper.n_steps
        outputs: list[tuple[torch.Tensor, ...]] = []
        endings: list[dict[str, Any]] = []
        met.clear()
        values = torch.zeros(steps + 1, games.num_envs)
        rewards, dones = np.zeros((2, steps, games.num_envs), dtype=np.float32)
        for t in range(steps + 1):
            for k, rows in enumerate(games.groups):
                if t > 0:
                    seen[k], rewards[t - 1, rows], ended, infos = games.receive(k)
                    dones[t - 1, rows] = ended
                    endings += [infos[i] for i in np.flatnonzero(ended)]
                    bar.update(len(ended))
                choices, actions = self.choose(seen[k])
                values[t, rows] = choices.values.cpu()
                if t < steps:
                    games.send(k, actions)
                    met.add(choices.situations)
                    outputs.append(choices[1:])
        found = advantages(
            torch.from_numpy(rewards), values, torch.from_numpy(dones), self.hyper.gamma, self.hyper.gae_lambda
        )
        both = (array.flatten().to(self.device) for array in (found, found + values[:-1]))
        return Rollout(Choices(met.situations(), *map(torch.cat, zip(*outputs, strict=True))), *both), endings

    def update(self, rollout: Rollout) -> None:
        """Some epochs over the rollout; raises FloatingPointError if the losses are not finite."""
        hyper, progress = self.hyper, self.hyper.progress(self.decisions)
        pairs = hyper.learning_rate, hyper.ent_coef
        rate, entropy_weight = (first + (last - first) * progress for first, last in pairs)
        self.optimizer.param_groups[0]["lr"] = rate
        choices, gains, returns = rollout

        def loss_of(rows: torch.Tensor) -> PieceLoss:
            scaled = (gains - gains[rows].mean()) / (gains[rows].std() + 1e-8)
            return partial(self._loss, rollout, scaled, entropy_weight, len(rows))

        counts = choices.situations.counts
        means = self.descend(self.optimizer, loss_of, counts, epochs=hyper.n_epochs, size=hyper.batch_size)
        _check(means)
        for name, value in zip(_MEASURES, means.tolist(), strict=True):
            self.logger.record(f"train/{name}", value)
        explained = explained_variance(choices.values.cpu().numpy(), returns.cpu().numpy())
        self.logger.record("train/explained_variance", explained)
        self.logger.record("train/learning_rate", rate)
        self.logger.record("train/clip_range", hyper.clip_range)

    def _loss(
        self, rollout: Rollout, gains: torch.Tensor, entropy_weight: float, count: int, rows: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """PPO's loss of some rows of a minibatch of ``count``, and their part in ``_MEASURES``."""
        choices, _, returns = rollout
        clip = self.hyper.clip_range
        logits, values = self.network.judge_packed(choices.situations.of(rows))
        log_probs = logits.log_softmax(dim=1)
        entropy = -(log_probs.exp() * log_probs).sum()
        log_ratio = log_probs.gather(1, choices.slots[rows, None])[:, 0] - choices.log_probs[rows]
        ratio, gain = log_ratio.exp(), gains[rows]
        objective = torch.min(gain * ratio, gain * ratio.clamp(1 - clip, 1 + clip)).sum()
        error = (values - returns[rows]).square().sum()
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


def imitate(model: Learner, games: TrainingGames, decisions: int, *, games_seed: int, seed: int) -> dict[str, float]:
    """Fit the network to what the games' teachers would choose in so many situations; ``seed`` orders minibatches.

    In the first of four rounds the rule plays, in the others the network does and the rule labels the situations, so
    that the network also learns in situations that the rule does not get into (DAgger: Ross, Gordon, Bagnell, 2011).
    Returns the share of choices that agree in the last round.
    """
    steps = max(decisions // games.num_envs // _ROUNDS, 1)
    optimizer = torch.optim.Adam(model.network.parameters(), lr=_RATE)
    generator = torch.Generator().manual_seed(seed)
    met, labelled = Row(_ROUNDS * steps * games.num_envs), list[_Labels]()
    observation = games.reset(games_seed)
    for number in range(_ROUNDS):
        observation, labels, agreement = _play(model, games, steps, observation, number > 0, met)
        labelled.append(labels)
        _fit(model, optimizer, met.situations(), _Labels(*map(torch.cat, zip(*labelled, strict=True))), generator)
    return {"agreement": agreement}


def _fit(
    model: Learner, optimizer: torch.optim.Optimizer, met: Packed, labels: _Labels, generator: torch.Generator
) -> None:
    def loss_of(rows: torch.Tensor) -> PieceLoss:
        return partial(labels.loss, model, met, len(rows))

    model.descend(optimizer, loss_of, met.counts, epochs=_EPOCHS, size=_BATCH, generator=generator)


def _play(
    model: Learner, games: TrainingGames, steps: int, observation: Observation, alone: bool, met: Row
) -> tuple[Observation, _Labels, float]:
    """Play on, the rule or (``alone``) the model, and add the situations to those ``met``.

    Returns the last observation, the labels, and how often they agreed.
    """
    n = games.num_envs
    slots: list[torch.Tensor] = []
    rewards, dones = np.zeros((steps, n), dtype=np.float32), np.zeros((steps, n), dtype=np.bool_)
    agreed = 0.0
    for t in range(steps):
        labels = games.choices()
        choices, own = model.choose(observation, deterministic=True)
        agreed += float((own == labels).mean()) / steps
        met.add(choices.situations)
        slots.append((choices.order == torch.as_tensor(labels, device=model.device)[:, None]).byte().argmax(dim=1))
        observation, rewards[t], dones[t], _ = games.step(own if alone else labels)
    flat = (torch.from_numpy(array.ravel()).to(model.device) for array in discounted(rewards, dones, model.hyper.gamma))
    return observation, _Labels(torch.cat(slots), *flat), agreed


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


def use_device(name: str) -> str:
    """Set torch up so that the same training gives the same bits; raises ValueError if the device cannot be used."""
    os.environ.setdefault("CUBLAS_WORKSPACE_CONFIG", ":4096:8")  # else its sums come in any order
    torch.set_deterministic_debug_mode("error")  # its other name takes two seconds to import a compiler
    torch.utils.deterministic.fill_uninitialized_memory = False  # type: ignore[attr-defined]  # none is read
    torch.set_num_threads(1)  # threads are the learner's
    torch.empty(31 << 20, dtype=torch.uint8)  # freed: glibc then reuses blocks so large (a fifth of the time)
    if name.partition(":")[0] not in ("cpu", "cuda"):
        raise ValueError(f"device = {name!r}: must be cpu or cuda, or cuda:N of several")
    try:
        torch.zeros(1, device=name)
    except (RuntimeError, AssertionError) as error:
        raise ValueError(f"device = {name!r}: cannot be used: {str(error).splitlines()[0]}") from None
    return name


def _check(numbers: torch.Tensor) -> None:
    if not torch.isfinite(numbers).all():
        raise FloatingPointError("the training has diverged: logits are no numbers any more")
