"""Behaviour cloning: a network learns from a data set of a policy what it chooses, and both play in other houses.

The data set is a folder that ``pacman-env dataset`` has written, of PacManBotFlat. One small network gives
each candidate a number, whatever its place in the list; the mask excludes forbidden candidates.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import minari
import numpy as np
import torch
from torch import Tensor, nn

from pacman_env import OUTCOMES, PacManBotVectorEnv, make_policy, paired_difference, wilson

GLOBALS = 51  # the last numbers of an observation; before them, each candidate has as many as any other
COMPLETE = list(OUTCOMES).index("complete")
BATCH = 50  # games at once


class Cloned(nn.Module):
    """(N, D) observations and (N, A) masks to (N, A) logits."""

    def __init__(self, width: int, hidden: int = 128) -> None:
        super().__init__()
        self.each = nn.Sequential(nn.Linear(width + GLOBALS, hidden), nn.ReLU(), nn.Linear(hidden, hidden), nn.ReLU())
        self.score = nn.Sequential(nn.Linear(2 * hidden, hidden), nn.ReLU(), nn.Linear(hidden, 1))

    def forward(self, observation: Tensor, mask: Tensor) -> Tensor:
        actions = mask.shape[1]
        candidates = observation[:, :-GLOBALS].unflatten(1, (actions, -1))
        whole = observation[:, None, -GLOBALS:].expand(-1, actions, -1)
        each = self.each(torch.cat([candidates, whole], dim=2)) * mask[:, :, None]
        best = each.amax(dim=1, keepdim=True).expand_as(each)  # over all candidates: the alternatives to this one
        return self.score(torch.cat([each, best], dim=2)).squeeze(2).masked_fill(~mask, -1e8)


def load(folder: Path) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """(D, F) observations, (D, A) masks, (D,) actions and (D,) numbers of their rounds."""
    episodes = list(minari.MinariDataset(folder / "data"))
    observation = np.concatenate([episode.observations[:-1] for episode in episodes])
    mask = np.concatenate([episode.infos["action_mask"][:-1] for episode in episodes]).astype(bool)
    action = np.concatenate([episode.actions for episode in episodes])
    number = np.repeat(np.arange(len(episodes)), [len(episode.actions) for episode in episodes])
    return torch.from_numpy(observation), torch.from_numpy(mask), torch.from_numpy(action), torch.from_numpy(number)


def learn(folder: Path, epochs: int, seed: int) -> Cloned:
    """Fit the choices of nine tenths of the rounds; the others say how often the network chooses the same."""
    torch.manual_seed(seed)
    observation, mask, action, number = load(folder)
    held_out = number >= 0.9 * (number.max() + 1)
    learnt, judged = (~held_out).nonzero()[:, 0], held_out.nonzero()[:, 0]
    network = Cloned((observation.shape[1] - GLOBALS) // mask.shape[1])
    steps = epochs * -(-len(learnt) // 512)
    optimizer = torch.optim.Adam(network.parameters(), lr=1e-3)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, max_lr=2e-3, total_steps=steps)
    print(f"{len(learnt)} decisions to learn from, {len(judged)} to judge by", flush=True)
    for epoch in range(epochs):
        losses = []
        for batch in learnt[torch.randperm(len(learnt))].split(512):
            loss = nn.functional.cross_entropy(network(observation[batch], mask[batch]), action[batch])
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            schedule.step()
            losses.append(loss.item())
        with torch.no_grad():
            chosen = torch.cat([network(observation[b], mask[b]).argmax(dim=1) for b in judged.split(4096)])
        same = (chosen == action[judged]).float().mean().item()
        print(f"epoch {epoch + 1}: loss {np.mean(losses):.4f}, the same choice in {100 * same:.1f} %", flush=True)
    return network


def completed(choose: Callable[[PacManBotVectorEnv, Any], Any], rounds: int, arguments: dict[str, Any]) -> np.ndarray:
    """Return which rounds are completed, (rounds,); round k is the same for every policy."""
    outcomes = []
    for first in range(0, rounds, BATCH):
        env = PacManBotVectorEnv(min(BATCH, rounds - first), flat=True, autoreset_mode="Disabled", **arguments)
        observation, info = env.reset(seed=first)
        while (info["outcome"] == 0).any():  # running; games that are over stay so
            observation, *_, info = env.step(choose(env, observation))
        outcomes.append(info["outcome"])
        env.close()
    return np.concatenate(outcomes) == COMPLETE


def main() -> None:
    """Learn, save, and play the same rounds as the teacher."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    options.add_argument("folder", type=Path, help="the data set's")
    options.add_argument("--epochs", type=int, default=8, help="passes over the data")
    options.add_argument("--seed", type=int, default=0, help="of the network and the order of the data")
    options.add_argument("--test", default="generated:test", metavar="MAP", help="to play on")
    options.add_argument("--rounds", type=int, default=1000, help="to play")
    options.add_argument("--save", type=Path, default=None, help="file for the network's weights")
    given = options.parse_args()
    torch.set_num_threads(1)
    about = minari.MinariDataset(given.folder / "data").storage.metadata
    settings, taught = about["pacman_env"]["settings"], about["algorithm_name"]
    began, used = time.monotonic(), time.process_time()
    network = learn(given.folder, given.epochs, given.seed)
    took_s, used_s = time.monotonic() - began, time.process_time() - used
    print(f"learnt in {took_s:.0f} s, {used_s:.0f} s of a processor", flush=True)
    if given.save is not None:
        torch.save(network.state_dict(), given.save)

    kept = ("observation.nearest_pellets", "observation.nearest_refuges", "observation.candidates")
    arguments = {"map": given.test, "settings": {name: settings[name] for name in kept}}
    teacher = make_policy(taught)

    def clone(env: PacManBotVectorEnv, observation: Any) -> Any:
        with torch.no_grad():
            logits = network(torch.from_numpy(observation), torch.from_numpy(env.action_masks()))
        return logits.argmax(dim=1).numpy()

    def teach(env: PacManBotVectorEnv, observation: Any) -> Any:
        return env.action_of(teacher.select(env.situation))

    ours, theirs = completed(clone, given.rounds, arguments), completed(teach, given.rounds, arguments)
    for name, played in ((taught, theirs), ("its clone", ours)):
        low, high = wilson(int(played.sum()), given.rounds)
        print(f"{name}: {100 * played.mean():.1f} [{100 * low:.1f}, {100 * high:.1f}] % of {given.rounds} rounds")
    more, (low, high) = paired_difference(ours, theirs)
    print(f"difference {100 * more:+.1f} [{100 * low:+.1f}, {100 * high:+.1f}] points")


if __name__ == "__main__":
    main()
