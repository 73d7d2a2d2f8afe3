"""Imitation: the network comes to choose as the rule does, and to know what the rule's rounds are worth."""

from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("sb3_contrib")

import torch

from pacman_env.observations.planner_features import CANDIDATE_FEATURES
from pacman_env.policies.registry import make_policy
from pacman_env.training import labels as module
from pacman_env.training.games import PlannerGames, dropped, make_parts, start
from pacman_env.training.labels import Labels, discounted, imitate, play_labelled
from pacman_env.training.lineups import make_teacher
from pacman_env.training.network import choose
from pacman_env.training.ppo import PPO
from tests.training.test_arguments import tiny


def pupil(seed: int = 0, **changes: Any) -> PPO:
    return PPO(tiny(width=16, n_steps=8, batch_size=32).hyper, seed, **changes)


def taught(decisions: int, weights: int = 0) -> tuple[PPO, float]:
    model = pupil(weights)
    return model, imitate(model, make_parts(tiny(games=8, n_steps=8, levels=4), 0), decisions, games_seed=3, seed=1)


def agreement(model: PPO) -> float:
    """Of the network with the rule, in situations that the rule meets in other houses."""
    parts = make_parts(tiny(games=8, n_steps=8, levels=4), 1)
    start(parts, 4, model.pool)
    return float(np.mean([play_labelled(model.network, model.hyper, 60, True, games).agreed for games in parts]))


def test_imitation_raises_agreement_with_rule() -> None:
    """Of the mean of four: before, one alone agrees in 2 to 24 %, afterwards in 10 to 75 %."""
    before = np.mean([agreement(pupil(weights)) for weights in range(4)])
    models, results = zip(*(taught(4096, weights=weights) for weights in range(4)), strict=True)
    assert np.mean([agreement(model) for model in models]) > before + 0.25
    assert all(0.0 < result <= 1.0 for result in results)


def test_labels_are_choices_of_the_lineup_teacher() -> None:
    arguments = tiny(ghosts=["chase", "wander,wander"], teacher_nodes=221)
    differ = 0
    for games in make_parts(arguments, 0):
        games.reset(0)
        found = play_labelled(pupil().network, arguments.hyper, 8, True, games).slots.reshape(8, -1).numpy()
        teacher, rule = make_teacher(games.lineup, 221), make_policy("lookahead")
        games.reset(0)
        for one in (teacher, rule):
            one.reset(np.ones(games.num_envs, dtype=np.bool_), games.env.env.config)
        for slots in found:
            choices, situation = teacher.select(games.env.env.situation), games.env.env.situation
            order = choose(pupil().network, games.observation).order.numpy()
            np.testing.assert_array_equal(order[np.arange(len(slots)), slots], choices)
            differ += int((choices != rule.select(situation)).sum())
            dones = games.step(choices).dones
            for one in (teacher, rule):
                one.reset(dones, games.env.env.config)
    assert differ > 0


@pytest.mark.parametrize("teaching", [True, False])
def test_teacher_or_network_plays_labelled_rounds(teaching: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    played: list[np.ndarray] = []
    step = PlannerGames.step
    monkeypatch.setattr(PlannerGames, "step", lambda games, actions: played.append(actions) or step(games, actions))
    games, model = make_parts(tiny(ghosts=["wander"]), 0)[0], pupil()
    games.reset(0)
    labels = play_labelled(model.network, model.hyper, 20, teaching, games)
    games.reset(0)
    for actions, agreed in zip(list(played), labels.agreed.reshape(20, -1).numpy() > 0, strict=True):
        chosen = choose(model.network, games.observation).actions
        np.testing.assert_array_equal(chosen == actions, agreed if teaching else np.ones_like(agreed))
        games.step(actions)
    assert 0.0 < labels.agreed.mean() < 1.0


def test_labels_do_not_depend_on_threads() -> None:
    arguments = tiny(ghosts=["wander,chase", "chase"], games=4, n_steps=8, levels=4, teacher_nodes=221)
    found = []
    for threads in (1, 3):
        parts = make_parts(arguments, 0)
        with ThreadPoolExecutor(threads) as pool:
            start(parts, 5, pool)
            played = pool.map(partial(play_labelled, pupil().network, arguments.hyper, 8, False), parts)
            found.append([tensor for labels in played for tensor in (*labels.situations, *labels[1:])])
    assert all(torch.equal(one, other) for one, other in zip(*found, strict=True))


def test_discounted_returns_match_hand_computed_values() -> None:
    """Of three games: one that ends in the middle, one that ends at last, one that does not."""
    rewards = np.array([[1, 0, 1], [2, 0, 0], [4, 8, 0], [8, 0, 4]], dtype=np.float32)
    dones = np.array([[0, 0, 0], [1, 0, 0], [0, 0, 0], [0, 1, 0]], dtype=np.bool_)
    returns, known = discounted(torch.tensor(rewards), torch.tensor(dones).float(), 0.5)
    np.testing.assert_array_equal(returns, [[2, 2, 1.5], [2, 4, 1], [8, 8, 2], [8, 0, 4]])
    np.testing.assert_array_equal(known, [[1, 1, 0], [1, 1, 0], [0, 1, 0], [0, 1, 0]])


def labelled(model: PPO, games: PlannerGames, kind: str) -> Labels:
    """Labels of a teacher that always chooses a candidate of a kind; no return is known."""
    games.reset(0)
    seen, column = games.observation, CANDIDATE_FEATURES.index(kind)
    choices = (seen["planner_candidates"][:, :, column] * seen["action_mask"]).argmax(axis=1)
    assert (seen["planner_candidates"][np.arange(len(choices)), choices, column] == 1).all()
    met = choose(model.network, seen)
    slots = (met.order == torch.from_numpy(choices)[:, None]).byte().argmax(dim=1)
    nothing = torch.zeros(len(choices))
    situations = type(met.situations)(*(tensor.clone() for tensor in met.situations))
    return Labels(situations, slots.clone(), nothing, nothing, nothing)


@pytest.mark.parametrize(("kind", "learns"), [("is_refuge", False), ("is_pellet", True)])
def test_labels_forbidden_by_ablation_teach_nothing(kind: str, learns: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_ENTROPY", 0.0)
    model = pupil(**dropped(tiny(without=("refuges",))))
    before = {name: value.clone() for name, value in model.network.state_dict().items()}
    labels = labelled(model, make_parts(tiny(), 0)[0], kind)
    rows, counts = torch.arange(len(labels.slots)), labels.situations.mask.sum(dim=1)
    optimizer = torch.optim.Adam(model.network.parameters(), lr=1e-3)
    model.descend(optimizer, partial(module.loss, model.network, labels, len(rows)), rows, counts)
    same = all(torch.equal(value, before[name]) for name, value in model.network.state_dict().items())
    assert same != learns


def test_imitation_keeps_optimizer_of_ppo_unused() -> None:
    model, _ = taught(64)
    assert model.optimizer.state_dict()["state"] == {}
