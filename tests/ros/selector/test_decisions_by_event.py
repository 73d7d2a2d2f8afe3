"""The goal selector under ``decisions.when = event``: when its policy is asked, and what it sees then."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from numpy.typing import NDArray

from pacman_env.config import make_config
from pacman_env.observations.situation import Situation
from pacman_env.policies.base import BasePolicy
from pacman_env.ros.game_nodes import SELECTOR
from pacman_env.ros.selector.goal_scores import Explanations
from tests.calls import calls_of
from tests.ros import session
from tests.ros.selector_game import FAR_AWAY, QUICK, TICK_S, Game, house, number_at, number_of_slot, slot_of

BY_EVENT = [*QUICK, "decisions.when=event"]
RULES = make_config().decisions
CANDIDATE = 5


class Stubborn(BasePolicy):
    """Always chooses the same candidate, and keeps what it saw."""

    name = "stubborn"
    seen: ClassVar[list[Situation]] = []

    def scores(self, situation: Situation) -> NDArray[np.float64]:
        return np.zeros(situation.mask.shape)

    def select(self, situation: Situation) -> NDArray[np.int64]:
        self.seen.append(situation.copy())
        return np.full(len(situation), CANDIDATE)


def play(folder: Path, when: str, *gone: int) -> tuple[list[Situation], int]:
    """Let Clyde come and go for 15 s; return what the policy saw, and the number of goals."""
    with session.nodes(folder) as nodes:
        game = Game(nodes)
        game.start(policy=f"{__name__}:Stubborn", settings=[*QUICK, f"decisions.when={when}"])
        Stubborn.seen.clear()  # the rehearsal
        game.pellets(*gone)
        game.begin()
        for tick in range(150):
            game.clyde(3.0 + 2.5 * np.cos(0.2 * tick), 0.0)
            nodes.advance(TICK_S)
        return Stubborn.seen[:], len(game.nav2.goals)


def test_policy_sees_same_situations_by_event(domain: int, tmp_path: Path) -> None:
    (ticks, goals), (events, same) = play(tmp_path, "tick"), play(tmp_path, "event")
    assert goals == same == 1
    assert len(ticks) >= 149
    assert 10 < len(events) < 100
    always = {round(float(situation.time_s[0]), 2): situation for situation in ticks}
    for situation in events:
        other = always[round(float(situation.time_s[0]), 2)]
        for name in ("time_s", "closing_speed", "current", "mask", "clyde"):
            np.testing.assert_allclose(getattr(situation, name), getattr(other, name), atol=1e-6, err_msg=name)
    assert any(situation.closing_speed[0] > 0.1 for situation in events)


@pytest.mark.parametrize("when", ["tick", "event"])
def test_forbidden_choice_holds_and_policy_is_asked_again(domain: int, tmp_path: Path, when: str) -> None:
    seen, goals = play(tmp_path, when, number_of_slot(CANDIDATE))
    assert goals == 0
    assert len(seen) >= 149


@pytest.mark.parametrize("policy", ["ppo", "clyde_aware"])
def test_decision_takes_few_hundred_calls(game: Game, policy: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Explanations, "scores_are_wanted", False)
    game.start(policy=policy)
    game.begin()
    game.running_goal(1)
    selector: Any = game.session.node(SELECTOR).selector
    cells = house().clyde.position[house().clyde.cells_in(0)]
    for k in range(10):
        game.clyde(*cells[(37 * k) % len(cells)].tolist())
        assert calls_of(selector.tick) < 800
        game.session.advance(TICK_S)
    assert not game.statuses()


def asked(game: Game, seconds: float) -> int:
    """How often the policy is asked in that time."""
    begin = game.condition()["decisions"]["count"]
    game.session.advance(seconds)
    return int(game.condition()["decisions"]["count"]) - begin


def test_policy_is_asked_after_events_and_seldom_otherwise(game: Game) -> None:
    game.start(settings=BY_EVENT)
    game.begin()
    first = game.running_goal(1)
    x, y, _ = game.pose
    game.condition(lambda c: c["decisions"]["count"] > 0)
    assert asked(game, 5 * RULES.longest_s) == 5
    assert len(game.nav2.goals) == 1, "the goal is repeated, not sent anew"

    game.clyde(x + RULES.threat_distance_m - 0.5, y)
    assert asked(game, 5 * RULES.threat_longest_s) == 6, "when Clyde has come, and then every threat_longest_s"
    game.clyde(*FAR_AWAY)
    game.condition(lambda c: c["clyde"] == pytest.approx(FAR_AWAY), "Clyde")

    before = game.condition()["decisions"]["count"]
    game.stand(first.x, first.y)
    game.status(f"pellet_collected:{number_at(first)}")
    second = game.running_goal(2)
    assert slot_of((second.x, second.y)) != slot_of((first.x, first.y))
    game.abort(second)
    third = game.running_goal(3)
    assert slot_of((third.x, third.y)) != slot_of((second.x, second.y))
    after = game.condition()["decisions"]["count"]
    assert after - before == 2, "once for each of the two"
