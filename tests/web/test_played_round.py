"""A round of the page: the same as the environment's, whoever plays it."""

import json
import math
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from pacman_env.config import make_config
from pacman_env.envs.pacmanbot import PacManBotEnv
from pacman_env.episodes.rollout import episode_seeds, play
from pacman_env.evaluation.replay import RecordedGame
from pacman_env.evaluation.rounds.scenarios import open_scenario
from pacman_env.game.ends import COMPLETE
from pacman_env.game.goals import goal_name
from pacman_env.game.power import frightened_s
from pacman_env.game.round import clyde_speed_mps
from pacman_env.observations.situation import Situation
from pacman_env.policies.base import BasePolicy
from pacman_env.policies.learned import LearnedPlanner
from pacman_env.policies.registry import make_policy
from pacman_env.web import played_round
from pacman_env.web.game_interface import Refused
from pacman_env.web.match import HARDEST
from pacman_env.web.orders import FOLLOW, Moves, Orders
from pacman_env.web.page_messages import Setup
from pacman_env.web.played_round import ADVISER, PlayedRound
from pacman_env.web.rules import PLAY, Choices, Rules
from pacman_env.web.simulated_view import between, scene_of
from pacman_env.web.vocabulary import TERMS
from pacman_env.world.maps.occupancy import shipped_maps
from tests.web.pages import decode

CHOICES = Choices()
SHORT = {"time_limit_s": 20.0}


class Lost(BasePolicy):
    name = "lost"

    def scores(self, situation: Situation) -> NDArray[np.float64]:
        return np.full(situation.mask.shape, np.nan)


def laid_out(
    seed: int = 7, ghost_roles: frozenset[int] = frozenset(), clyde_mps: float | None = None, **rules: Any
) -> PlayedRound:
    chosen = Rules(**{"policy": "clyde_aware", "second": "nearest", "settings": SHORT, **rules})
    config, source, ghosts = CHOICES.prepare(chosen, clyde_mps)
    return PlayedRound(config, source, ghosts, (chosen.policy, chosen.second), seed, ghost_roles)


def played(round: PlayedRound, orders: Orders | None = None, ticks: int = 1000) -> PlayedRound:
    for _ in range(ticks):
        if round.over:
            break
        round.step(orders or Orders())
    return round


@pytest.mark.parametrize("ghosts", [("wander",), ("chase", "wander")])
def test_played_round_equals_environment_bit_for_bit(ghosts: tuple[str, ...]) -> None:
    ours = played(laid_out(ghosts=ghosts))
    env = PacManBotEnv("house", ghosts=ghosts, settings=SHORT)
    env.reset(options={"round_seed": 7})
    policy = make_policy("clyde_aware")
    for snapshot in ours.snapshots[1:]:
        *_, info = env.step(int(policy.select(env.situation)[0]))
        game = env.batch.games[0]
        assert snapshot.true == (game["x"], game["y"], game["heading"])
    assert (info["outcome"], info["collected"]) == (ours.end.word, ours.snapshots[-1].collected)


def test_ghost_without_orders_moves_as_configured() -> None:
    free, taken = (
        laid_out(ghosts=("chase", "arcade")),
        laid_out(ghosts=("chase", "arcade"), ghost_roles=frozenset([0, 1])),
    )
    for _ in range(20):
        free.step(Orders())
        taken.step(Orders())
        np.testing.assert_array_equal(free.snapshots[-1].ghosts, taken.snapshots[-1].ghosts)


def test_ghost_goes_to_free_cell_nearest_to_click() -> None:
    round = laid_out(ghost_roles=frozenset([0]), clyde_mps=2.0, settings={"time_limit_s": 60.0})
    cells = round.assets.clyde
    own = cells.cells_in(round.assets.clyde_part)
    away_m = np.hypot(*(cells.position[own][:, None] - round.assets.goal_xy).transpose(2, 0, 1)).min(axis=1)
    cell = int(own[away_m.argmax()])
    assert away_m.max() > 1.0  # from every pellet and refuge
    x, y = cells.position[cell]
    assert round.nearest_ghost_cell(0, x + 0.2 * cells.resolution, y) == cell
    far = np.hypot(*(cells.position[own] - 100.0).T)
    assert round.nearest_ghost_cell(0, 100.0, 100.0) == int(own[far.argmin()])
    right = int(own[cells.position[own, 0].argmax()])
    wall = cells.position[right] + (0.5, 0.0)
    assert round.nearest_ghost_cell(0, *wall) == right
    played(round, Orders(robot=True, ghosts={0: cell}), 30)
    assert round.snapshots[-1].ghosts[0] == pytest.approx((x, y))
    np.testing.assert_array_equal(round.snapshots[-1].ghost_goals, [(x, y)])
    assert not round.over
    played(round, Orders(robot=True, ghosts={0: FOLLOW}))
    assert (round.end.word, round.catcher) == ("caught", 0)
    np.testing.assert_array_equal(round.snapshots[-1].ghost_goals, [round.snapshots[-1].true[:2]])


def test_velocities_drive_the_robot_until_a_goal() -> None:
    round = laid_out(settings={"time_limit_s": 60.0})
    played(round, Orders(robot=True, goal=3), 4)
    before = round.snapshots[-1]
    played(round, Orders(robot=True, velocity=(0.0, 1.0)), 4)
    turned = math.remainder(round.snapshots[-1].true[2] - before.true[2], 2 * math.pi)
    assert turned == pytest.approx(2.0, abs=0.5)
    assert round.snapshots[-1].goal == -1
    played(round, Orders(robot=True, goal=8), 20)
    assert round.snapshots[-1].goal == 8
    assert math.dist(round.snapshots[-1].true[:2], before.true[:2]) > 0.5


def test_score_terms_explain_choice_afterwards() -> None:
    round = played(laid_out())
    for tick in (0, 7, round.ticks - 1):
        why = round.why(tick)
        goal, first, second = round.choices[tick]
        assert why["goal"] == goal
        assert why["chosen"] == {"clyde_aware": first, "nearest": second}
        allowed = [row["candidate"] for row in why["rows"]]
        assert first in allowed
        assert allowed == sorted(allowed)
    with pytest.raises(IndexError):
        round.why(round.ticks + 1)


@pytest.mark.parametrize("policy", CHOICES.facts()["policies"])
def test_terms_of_policies_have_plain_names_and_units(policy: str) -> None:
    why = played(laid_out(policy=policy), ticks=2).why_now()
    assert {name for row in why["rows"] for name in row["terms"][policy]} <= TERMS.keys()


def test_terms_are_converted_to_their_units() -> None:
    speed = LearnedPlanner().metadata.robot_speed_mps  # which its features count with
    rows = played(laid_out(policy="ppo", settings={"robot.speed_mps": speed}), ticks=2).why_now()["rows"]
    (metres, unit_m), (seconds, unit_s) = ((TERMS[name][2], TERMS[name][1]) for name in ("path_robot", "time_margin"))
    assert (unit_m, unit_s) == ("m", "s")
    for row in [row for row in rows if row["kind"] == "pellet"]:
        assert metres * row["terms"]["ppo"]["path_robot"] == pytest.approx(row["robot_m"], abs=0.01)
        margin = np.clip(row["ghost_later_s"], -40, 40)
        assert seconds * row["terms"]["ppo"]["time_margin"] == pytest.approx(margin, abs=0.2)


def test_candidates_of_generated_maps_have_no_gaps() -> None:
    round = laid_out(map="generated", level=3)
    assert round.level == 3
    assert round.batch.hold > round.hold  # which has rows without a pellet
    played(round, ticks=20)
    places = len(round.assets.goal_xy)
    assert all(0 <= choice <= places for choices in round.choices for choice in choices)
    assert len(round.snapshots[0].scores) == places + 1


def test_click_finds_the_nearest_allowed_candidate() -> None:
    round = laid_out()
    x, y = round.assets.goal_xy[5]
    assert round.nearest(x + 0.1, y) == 5
    assert round.nearest(100.0, 100.0) is None
    round = played(laid_out(settings={}), ticks=400)
    gone = int(np.flatnonzero(~round.snapshots[-1].alive)[0])
    assert round.nearest(*round.assets.goal_xy[gone]) != gone


@given(share=st.floats(0, 1), tick=st.integers(0, 20))
@settings(max_examples=30, deadline=None)
def test_interpolated_frame_lies_between_ticks(share: float, tick: int) -> None:
    old, new = ROUND.snapshots[tick], ROUND.snapshots[tick + 1]
    now = between(old, new, share)
    for k in (0, 1):
        low, high = sorted((old.true[k], new.true[k]))
        assert low - 1e-9 <= now.true[k] <= high + 1e-9
    assert old.time_s <= now.time_s <= new.time_s
    before, shown = (json.loads(frame.encode()) for frame in (old, now))
    changed = {name for name in before if share < 1.0 and shown[name] != before[name]}
    poses = {"time_s", "true", "believed", "ghosts"}
    assert changed <= {"goal", "velocity", "scores", "plan"} | poses  # the rest changes when the tick is over
    assert decode(old.encode()).ghosts == pytest.approx(old.ghosts, abs=1e-4)


def test_goal_has_same_name_as_in_replay() -> None:
    round = played(laid_out(settings={}), ticks=1)
    names = scene_of(round, Rules(), 1).facts["names"]
    config = make_config("robot")
    game = RecordedGame(open_scenario("house", config), config, "clyde_aware", np.uint64(7), "")
    game.step()
    assert game.changes[0].goal.startswith(f"{names[round.choices[0][0]]} at")
    assert [goal_name([0, 2], goal) for goal in range(3)] == ["pellet 0", "pellet 2", "refuge 0"]


ROUND = played(laid_out())


def test_robot_holds_if_policy_makes_no_choice(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(played_round, "make_policy", lambda name: Lost())
    round = played(laid_out(), ticks=3)
    assert round.choices == [[round.hold] * 3] * 3


@st.composite
def people(draw: st.DrawFn) -> list[Orders]:
    """Orders of 20 ticks, of which some are like those before."""
    goals, cells = st.none() | st.integers(0, 8), st.none() | st.integers(FOLLOW, 300)
    speeds = st.tuples(st.floats(-0.3, 0.3), st.floats(-1.9, 1.9))
    orders = st.one_of(
        st.builds(Orders, robot=st.booleans(), goal=goals, ghosts=st.dictionaries(st.integers(0, 1), cells)),
        st.builds(Orders, robot=st.just(True), velocity=speeds),
    )
    return [one for one in draw(st.lists(orders, min_size=10, max_size=10)) for _ in range(2)]


@settings(max_examples=10)
@given(people(), st.booleans())
def test_moves_repeat_round_of_people(orders: list[Orders], placed: bool) -> None:
    first = laid_out(ghosts=("wander", "chase"), ghost_roles=frozenset([0, 1]))
    if placed:
        first.place_ghost(1, 0.5, -0.5)
    for one in orders:
        first.step(one)
    moves = msgspec.json.decode(msgspec.json.encode(first.moves), type=Moves)
    again = laid_out(ghosts=("wander", "chase"), ghost_roles=moves.ghosts)
    again.replay(moves, len(orders))
    for ours, theirs in zip(first.snapshots, again.snapshots, strict=True):
        assert ours.true == theirs.true
        np.testing.assert_array_equal(ours.ghosts, theirs.ghosts)
    assert again.moves == first.moves


@pytest.mark.parametrize(
    "moves",
    [
        Moves(orders=[(0, Orders(robot=True, goal=999))]),
        Moves(orders=[(0, Orders(ghosts={0: 10**6}))]),
        Moves(orders=[(0, Orders(ghosts={1: 0}))]),
        Moves(placed={2: (0.0, 0.0)}),
    ],
)
def test_moves_of_another_map_are_refused(moves: Moves) -> None:
    with pytest.raises(Refused):
        laid_out(ghost_roles=moves.ghosts).replay(moves)


def test_dangerous_goal_of_person_is_marked() -> None:
    """A person who never leaves a chasing ghost's way is marked; one who follows the adviser is not."""
    rules = {"policy": ADVISER, "ghosts": ("chase",), "clyde_mps": 0.25, "settings": {}}
    good, bad = laid_out(**rules), laid_out(**rules)
    while not good.over:
        good.step(Orders(robot=True, goal=good._page_choice(good._policies[0], good._situation)))
    assert not good.worse
    nearest = laid_out(**{**rules, "policy": "nearest"})
    while not bad.over:
        bad.step(Orders(robot=True, goal=nearest._page_choice(nearest._policies[0], bad._situation)))
    assert bad.worse
    changed = {tick for tick, orders in bad.moves.orders}
    assert set(bad.worse) <= changed


@pytest.mark.parametrize(  # the hardest map always
    "name", ["maze", *(pytest.param(name, marks=pytest.mark.daily) for name in shipped_maps() if name != "maze")]
)
def test_hardest_level_of_play_can_be_won(name: str) -> None:
    """The built-in policy completes at least half of the rounds of the last level that *Play* offers."""
    config, source, _ = CHOICES.prepare(Rules(map=name).changed(Setup(**PLAY)), None)
    mps = clyde_speed_mps(PLAY["clyde_mps"], config.clyde.speed_step_mps, HARDEST)
    fields = {"clyde.speed_mps": mps, "power.duration_s": frightened_s(config.power, HARDEST)}
    records, _ = play(source, config.with_fields(**fields), ADVISER, episode_seeds(1, 16))
    assert np.mean(records["end"] == COMPLETE) >= 0.5
