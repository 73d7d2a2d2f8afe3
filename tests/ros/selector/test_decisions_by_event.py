"""The goal selector as a process under ``decisions.when = event``: when its policy is asked."""

from __future__ import annotations

import pytest

pytest.importorskip("rclpy")

from pacman_env.config import make_config
from tests.ros.selector_game import FAR_AWAY, Game, house, slot_of

TICK_S = 0.1
BY_EVENT = [f"execution.tick_s={TICK_S}", f"execution.check_period_s={TICK_S}", "decisions.when=event"]
RULES = make_config().decisions


def asked(game: Game, seconds: float) -> int:
    """How often the policy is asked in that time."""
    assert game.clock is not None
    begin = game.condition(lambda c: True)["decisions"]["count"]
    game.clock.advance(seconds)
    return int(game.condition(lambda c: True)["decisions"]["count"]) - begin


def test_the_policy_is_asked_when_something_has_happened_and_else_seldom(game: Game) -> None:
    game.start_at_rest(settings=BY_EVENT)
    game.begin()
    first = game.running_goal(1)
    x, y, _ = game.pose
    game.condition(lambda c: c["decisions"]["count"] > 0)
    assert asked(game, 5 * RULES.longest_s) in (4, 5, 6)  # in the diagnostics, a tick later or earlier
    assert len(game.nav2.goals) == 1, "the goal is repeated, not sent anew"

    game.clyde(x + RULES.threat_distance_m - 0.5, y)
    assert asked(game, 5 * RULES.threat_longest_s) in (5, 6, 7)
    game.clyde(*FAR_AWAY)
    game.condition(lambda c: c["clyde"] == pytest.approx(FAR_AWAY), "Clyde")

    before = game.condition(lambda c: True)["decisions"]["count"]
    game.stand(first.x, first.y)
    game.status(f"pellet_collected:{int(house().pellet_ids[slot_of((first.x, first.y))])}")
    second = game.running_goal(2)
    assert slot_of((second.x, second.y)) != slot_of((first.x, first.y))
    game.nav2.abort(second)
    third = game.running_goal(3)
    assert slot_of((third.x, third.y)) != slot_of((second.x, second.y))
    after = game.condition(lambda c: True)["decisions"]["count"]
    assert after - before <= 4, "once for each of the two, and at most twice for the time"
