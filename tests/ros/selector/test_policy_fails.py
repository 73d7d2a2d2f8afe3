"""A user's policy that fails in a round: the robot holds, people see why in the same words, and it recovers."""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any, ClassVar

import numpy as np
import pytest

from pacman_env.heuristics.simple import Nearest
from pacman_env.ros import topics
from pacman_env.ros.operator_page.ros_game import RosGame
from pacman_env.ros.selector.reasons import POLICY_FAILS, REMEDIES
from pacman_env.ros.supervisor.checks import examine
from pacman_env.ros.supervisor.checks.check import BAD, Finding
from pacman_env.ros.supervisor.doctor import Doctor
from pacman_env.ros.supervisor.game_nodes import SELECTOR
from pacman_env.ros.supervisor.status_line import StatusLine
from tests.ros import session
from tests.ros.selector_game import Game

PATIENCE_S = 60.0


class Wilful(Nearest):
    """Chooses the nearest pellet, or fails as the test says."""

    name = "wilful"
    fault: ClassVar[str] = ""
    nodes: ClassVar[Any] = None  # a session, whose wall clock a slow policy advances

    def scores(self, situation: Any) -> Any:
        if self.fault == "raises":
            raise LookupError("no such goal")
        if self.fault == "slow":
            self.nodes.game.wall.advance(2_000_000_000)
        scores = super().scores(situation)
        return np.full_like(scores, np.nan) if self.fault == "NaN" else scores

    def reset(self, games: Any, config: Any) -> None:
        super().reset(games, config)
        if self.fault == "reset":
            raise LookupError("nothing to forget")


@pytest.fixture(scope="module")
def playing(domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Game, RosGame]]:
    """A round with a page, which other processes' nodes can discover."""
    with session.nodes(tmp_path_factory.mktemp("game"), alone=False) as nodes:
        Wilful.nodes = nodes
        game = Game(nodes)
        game.start(policy=f"{__name__}:Wilful")
        game.begin()
        game.running_goal(1)
        pages: list[RosGame] = []

        def page() -> Any:
            pages.append(RosGame(session.NAMESPACE, int(os.environ["ROS_DOMAIN_ID"]), True, "house"))
            return pages[0].node

        nodes.start("pacman_page", page)
        try:
            yield game, pages[0]
        finally:
            pages[0].close()


def bad_game(doctor: Doctor) -> Finding | None:
    """Return what the doctor finds wrong with the game, ``None`` while it finds nothing wrong."""
    return next((one for one in examine(doctor.observations()) if one.check == "game" and one.status == BAD), None)


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("raises", "LookupError: no such goal"),
        ("NaN", "is NaN"),
        ("slow", "takes more than 1 s"),
        ("reset", "LookupError: nothing to forget"),
    ],
)
def test_failing_policy_is_reported_alike_until_it_answers(
    playing: tuple[Game, RosGame], domain: int, monkeypatch: pytest.MonkeyPatch, fault: str, words: str
) -> None:
    game, page = playing
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

    with StatusLine(session.NAMESPACE, sim=False) as terminal:
        assert terminal.spin_until(lambda: terminal.troubles, PATIENCE_S)
        assert terminal.troubles[POLICY_FAILS] == shown
    with Doctor(session.NAMESPACE, domain, None, "", False, PATIENCE_S) as doctor:
        # The message may come before the names of the robot's nodes.
        doctor.observe(lambda: bad_game(doctor) is not None)
        finding = bad_game(doctor)
    assert finding is not None
    assert (finding.summary.partition("; ")[2], finding.remedy) == (shown, REMEDIES[POLICY_FAILS])
    alerts = game.session.wait_for(lambda: page.scene().facts.get("alerts"), what="the alert")
    assert alerts == [{"kind": POLICY_FAILS, "words": shown, "remedy": REMEDIES[POLICY_FAILS], "asks": False}]

    monkeypatch.setattr(Wilful, "fault", "")
    assert not game.running_goal(sent + 1).cancelled
    game.condition(lambda c: POLICY_FAILS not in c["troubles"], "its end")
    assert game.session.node(SELECTOR).status is None
