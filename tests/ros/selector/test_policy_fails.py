"""A user's policy that fails in a round: the robot holds, the node says why, and it recovers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, ClassVar

import pytest

from pacman_env.heuristics.simple import Nearest
from pacman_env.ros import topics
from pacman_env.ros.game_nodes import SELECTOR
from pacman_env.ros.selector.reasons import POLICY_FAILS
from tests.ros import session
from tests.ros.selector_game import Game


class Wilful(Nearest):
    """Chooses the nearest pellet, or fails as the test says."""

    name = "wilful"
    fault: ClassVar[str] = ""

    def scores(self, situation: Any) -> Any:
        if self.fault == "raises":
            raise LookupError("no such goal")
        return super().scores(situation)

    def reset(self, games: Any, config: Any) -> None:
        super().reset(games, config)
        if self.fault == "reset":
            raise LookupError("nothing to forget")


@pytest.fixture(scope="module")
def game(domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Game]:
    """A round that has begun."""
    with session.nodes(tmp_path_factory.mktemp("game")) as nodes:
        begun = Game(nodes)
        begun.start(policy=f"{__name__}:Wilful")
        begun.begin()
        begun.running_goal(1)
        yield begun


@pytest.mark.parametrize(("fault", "words"), [("raises", "no such goal"), ("reset", "nothing to forget")])
def test_failing_policy_holds_and_is_reported_until_it_answers(
    game: Game, monkeypatch: pytest.MonkeyPatch, fault: str, words: str
) -> None:
    game.condition(lambda c: POLICY_FAILS not in c["troubles"], "a policy that answers")
    goal = game.nav2.goals[-1]
    monkeypatch.setattr(Wilful, "fault", fault)
    if fault == "reset":
        game.say(topics.GAME_COMMAND, "reset_round")
        game.begin()
    condition = game.condition(lambda c: POLICY_FAILS in c["troubles"], fault)
    shown = condition["trouble_texts"][POLICY_FAILS]
    assert shown.startswith(f"policy '{__name__}:Wilful'")
    assert words in shown
    assert goal.cancelled
    sent = len(game.nav2.goals)
    game.session.advance(3.0)
    assert len(game.nav2.goals) == sent  # it holds
    monkeypatch.setattr(Wilful, "fault", "")
    assert not game.running_goal(sent + 1).cancelled
    game.condition(lambda c: POLICY_FAILS not in c["troubles"], "its end")
    assert game.session.node(SELECTOR).status is None
