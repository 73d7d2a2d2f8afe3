"""The algorithm of sb3-contrib's MaskablePPO, arranged for speed.

Games come in groups: while one is stepped, the network chooses for the other. Situations are packed once, when they
are met (``network.Packed``). A minibatch goes through the network in pieces that stay in the processor's cache, divided
among threads; gradients are added in the pieces' order, so the number of threads changes nothing.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import torch
from sb3_contrib import MaskablePPO
from stable_baselines3.common.utils import explained_variance

from pacman_env.engine.threads import cores
from pacman_env.sb3 import Observation
from pacman_env.training.arguments import Hyperparameters
from pacman_env.training.games import TrainingGames
from pacman_env.training.network import Packed, Row
from pacman_env.training.policy import EntityPolicy

#: The loss of the situations with these numbers, and measures of it.
Loss = Callable[[torch.Tensor], tuple[torch.Tensor, torch.Tensor]]
_PIECE = 512  # situations
_MEASURES = ("policy_gradient_loss", "value_loss", "entropy_loss", "approx_kl", "clip_fraction")


class Choices(NamedTuple):
    """Situations and the network's outputs."""

    situations: Packed
    order: torch.Tensor  # (B, C) of candidates in them
    slots: torch.Tensor  # (B,) the candidates chosen, as ``situations`` has them
    log_probs: torch.Tensor  # (B,)
    values: torch.Tensor  # (B,)


class Rollout(NamedTuple):
    """The B choices that an update learns from."""

    choices: Choices
    advantages: torch.Tensor  # (B,)
    returns: torch.Tensor  # (B,)


class Learner(MaskablePPO):
    """MaskablePPO over ``TrainingGames``, where no ending is bootstrapped, with an ``EntityPolicy``.

    It replaces ``collect_rollouts`` and ``train``; schedules, callbacks, logging and saving are Stable-Baselines3's.
    """

    threads = 1  # 0: one for each core
    rollout_buffer: Rollout
    _met: Row | None = None
    _last_obs: Any

    @torch.inference_mode()
    def choose(self, observation: Observation, deterministic: bool = False) -> tuple[Choices, Any]:
        """A choice for each situation, drawn or (``deterministic``) the likeliest, and the chosen candidates' numbers.

        Raises:
            FloatingPointError: the network gives no numbers any more.
        """
        network = self.policy.network
        seen = {key: torch.as_tensor(array, device=self.device) for key, array in observation.items()}
        situations, order = network.pack(seen["planner_candidates"], seen["planner_globals"], seen["action_mask"] > 0.5)
        logits, values = network.judge_packed(situations.of(slice(None)))
        log_probs = logits.log_softmax(dim=1)
        _check(values + log_probs.sum(dim=1))
        drawn = log_probs if deterministic else log_probs - torch.empty_like(log_probs).exponential_().log()
        slots = drawn.argmax(dim=1, keepdim=True)
        chosen = order.gather(1, slots)[:, 0].cpu().numpy()
        return Choices(situations, order, slots[:, 0], log_probs.gather(1, slots)[:, 0], values), chosen

    def collect_rollouts(  # type: ignore[no-untyped-def]
        self, env, callback, rollout_buffer, n_rollout_steps: int, use_masking: bool = True
    ) -> bool:
        """Collect a rollout; the callback is called after each step of a group of games."""
        del rollout_buffer, use_masking
        assert isinstance(env, TrainingGames)
        self.policy.set_training_mode(False)
        callback.on_rollout_start()
        groups, steps = env.groups, n_rollout_steps
        seen: list[Any] = [{key: array[rows] for key, array in self._last_obs.items()} for rows in groups]
        met: list[tuple[torch.Tensor, ...]] = []
        if self._met is None:
            self._met = Row(steps * env.num_envs)
        self._met.clear()
        values = torch.zeros(steps + 1, env.num_envs)
        rewards, dones = np.zeros((2, steps, env.num_envs), dtype=np.float32)
        for t in range(steps + 1):
            for k, rows in enumerate(groups):
                if t > 0:
                    seen[k], rewards[t - 1, rows], ended, infos = env.receive(k)
                    dones[t - 1, rows] = ended
                    self.num_timesteps += len(ended)
                    callback.update_locals({"dones": ended, "infos": infos})
                    if not callback.on_step():
                        return False
                    self._update_info_buffer([infos[i] for i in np.flatnonzero(ended)])
                choices, actions = self.choose(seen[k])
                values[t, rows] = choices.values.cpu()
                if t < steps:
                    env.send(k, actions)
                    self._met.add(choices.situations)
                    met.append(choices[1:])
        self._last_obs = {key: np.concatenate([part[key] for part in seen]) for key in seen[0]}
        found = advantages(torch.from_numpy(rewards), values, torch.from_numpy(dones), self.gamma, self.gae_lambda)
        both = (array.flatten().to(self.device) for array in (found, found + values[:-1]))
        rest = map(torch.cat, zip(*met, strict=True))
        self.rollout_buffer = Rollout(Choices(self._met.situations(), *rest), *both)
        callback.on_rollout_end()
        return True

    def _excluded_save_params(self) -> list[str]:
        return [*super()._excluded_save_params(), "_met"]

    def train(self) -> None:
        """Some epochs over the rollout.

        Raises:
            FloatingPointError: the network gives no numbers any more.
        """
        self.policy.set_training_mode(True)
        self._update_learning_rate(self.policy.optimizer)
        choices, gains, returns = self.rollout_buffer
        clip = self.clip_range(self._current_progress_remaining)
        measured = []
        with self.workers() as pool:
            for _ in range(self.n_epochs):
                for rows in torch.randperm(len(gains)).to(self.device).split(self.batch_size):
                    scaled = (gains - gains[rows].mean()) / (gains[rows].std() + 1e-8)
                    loss = partial(self._loss, clip, scaled, len(rows))
                    measured.append(self.descend(pool, self.policy.optimizer, loss, rows, choices.situations.counts))
                self._n_updates += 1
        means = torch.stack(measured).mean(dim=0)
        _check(means)
        for name, value in zip(_MEASURES, means.tolist(), strict=True):
            self.logger.record(f"train/{name}", value)
        explained = explained_variance(choices.values.cpu().numpy(), returns.cpu().numpy())
        self.logger.record("train/explained_variance", explained)
        self.logger.record("train/n_updates", self._n_updates, exclude="tensorboard")
        self.logger.record("train/clip_range", clip)

    def _loss(
        self, clip: float, gains: torch.Tensor, count: int, rows: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """PPO's for some of a minibatch of ``count``, and their part in ``_MEASURES``."""
        choices, _, returns = self.rollout_buffer
        logits, values = self.policy.network.judge_packed(choices.situations.of(rows))
        log_probs = logits.log_softmax(dim=1)
        entropy = -(log_probs.exp() * log_probs).sum()
        log_ratio = log_probs.gather(1, choices.slots[rows, None])[:, 0] - choices.log_probs[rows]
        ratio, gain = log_ratio.exp(), gains[rows]
        objective = torch.min(gain * ratio, gain * ratio.clamp(1 - clip, 1 + clip)).sum()
        error = (values - returns[rows]).square().sum()
        with torch.no_grad():
            clipped, divergence = ((ratio - 1).abs() > clip).sum(), (ratio - 1 - log_ratio).sum()
            measures = torch.stack([-objective, error, -entropy, divergence, clipped]) / count
        return (self.vf_coef * error - objective - self.ent_coef * entropy) / count, measures

    def workers(self) -> ThreadPoolExecutor:
        """The threads that share a minibatch; they end with the ``with`` block that they are used in."""
        return ThreadPoolExecutor(self.threads or cores(), "learner")

    def descend(
        self,
        pool: ThreadPoolExecutor,
        optimizer: torch.optim.Optimizer,
        loss: Loss,
        rows: torch.Tensor,
        counts: torch.Tensor,
    ) -> torch.Tensor:
        """One step of the optimizer by the sum of the losses of a minibatch's pieces; returns the sum of measures.

        Args:
            pool: :meth:`workers`.
            optimizer: of the network's parameters.
            loss: is called in threads.
            rows: numbers of the situations in the minibatch.
            counts: candidates that may be chosen in all situations; those with as many go together.
        """
        weights = list(self.policy.network.parameters())

        def gradients(piece: torch.Tensor) -> tuple[tuple[torch.Tensor, ...], torch.Tensor]:
            total, measures = loss(piece)
            return torch.autograd.grad(total, weights), measures

        pieces = rows[counts[rows].argsort(stable=True)].split(_PIECE if self.device.type == "cpu" else len(rows))
        found, measured = zip(*pool.map(gradients, pieces), strict=True)
        for weight, *parts in zip(weights, *found, strict=True):
            weight.grad = torch.stack(parts).sum(dim=0)
        torch.nn.utils.clip_grad_norm_(weights, self.max_grad_norm)
        optimizer.step()
        return torch.stack(measured).sum(dim=0)


def advantages(
    rewards: torch.Tensor, values: torch.Tensor, dones: torch.Tensor, gamma: float, gae_lambda: float
) -> torch.Tensor:
    """(T, N) generalized advantages (Schulman et al., 2016).

    Args:
        rewards: (T, N).
        values: (T + 1, N) before each step and after the last.
        dones: (T, N) 1 where the round ended with the step.
        gamma: discount per step.
        gae_lambda: of the average over horizons.
    """
    found, running = torch.zeros_like(rewards), torch.zeros_like(rewards[0])
    for t in reversed(range(len(rewards))):
        going = gamma * (1 - dones[t])
        running = rewards[t] + going * values[t + 1] - values[t] + going * gae_lambda * running
        found[t] = running
    return found


def use_device(name: str) -> str:
    """Set torch up so that the same training gives the same bits; returns the device's name.

    Raises:
        ValueError: there is no such device, or it cannot be used here.
    """
    os.environ.setdefault("CUBLAS_WORKSPACE_CONFIG", ":4096:8")  # else its sums come in whatever order
    torch.set_deterministic_debug_mode("error")  # its other name takes two seconds to import a compiler
    torch.utils.deterministic.fill_uninitialized_memory = False  # type: ignore[attr-defined]  # none is read
    torch.set_num_threads(1)  # threads are the learner's
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


def new_model(hyper: Hyperparameters, games: TrainingGames, seed: int, device: str = "cpu", **sizes: Any) -> Learner:
    """A learner with random weights, at the first of its rates; ``sizes`` are those of ``EntityPolicy``."""
    same = ("n_steps", "batch_size", "n_epochs", "gamma", "gae_lambda", "clip_range", "vf_coef", "max_grad_norm")
    return Learner(
        EntityPolicy,
        games,
        learning_rate=hyper.learning_rate[0],
        ent_coef=hyper.ent_coef[0],
        policy_kwargs={"width": hyper.width} | sizes,
        seed=seed,
        device=device,
        **{name: getattr(hyper, name) for name in same},
    )
