import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pacman_env.config import make_config
from pacman_env.heuristics.clyde_aware import ClydeAware
from pacman_env.observations.situation import HOLD, PELLET, REFUGE, Situation
from tests.policies.contract import PolicyContract, random_situation
from tests.shared import shared_path


def situations(cases: list[dict[str, Any]], current: bool = False) -> Situation:
    """One game per case, pellets padded to the longest, then HOLD."""
    slots = max(len(case["pellets"]) for case in cases)
    situation = random_situation(0, len(cases), pellets=slots, refuges=0)
    position = np.zeros((len(cases), slots + 1, 2))
    mask = np.zeros((len(cases), slots + 1), np.bool_)
    mask[:, -1] = True
    for n, case in enumerate(cases):
        pellets = case["pellets"]
        position[n, :] = case["robot"]
        position[n, : len(pellets)] = pellets
        mask[n, : len(pellets)] = case.get("mask", True)
    return replace(
        situation,
        robot=np.array([[*case["robot"], 0.0] for case in cases]),
        clyde=np.array([case["clyde"] for case in cases], float),
        closing_speed=np.array([case.get("closing_speed", 0.0) for case in cases]),
        position=position,
        mask=mask,
        current=np.array([case["current_target"] if current else -1 for case in cases]),
    )


def goal(policy: ClydeAware, case: dict[str, Any]) -> int:
    return int(policy.select(situations([case], current="current_target" in case))[0])


def threatening(policy: ClydeAware, situation: Situation) -> bool:
    return bool(policy.explain(situation)[0][0]["threatening"])


def test_death_radius_defaults_to_the_games() -> None:
    wide = make_config(**{"execution.death_radius_m": 0.6})
    for policy, radius_m in ((ClydeAware(), 0.6), (ClydeAware(death_radius_m=0.3), 0.3)):
        policy.reset(np.ones(1, np.bool_), wide)
        assert policy.parameters.death_radius_m == radius_m
    assert ClydeAware().parameters.death_radius_m == make_config().execution.death_radius_m == 0.25


class TestWithMemory(PolicyContract):
    def make(self) -> ClydeAware:
        return ClydeAware(threat_exit_margin_m=1.0)


class TestGoldenAnswers:
    """600 situations with the answers of the scorer that ran on the robot."""

    @pytest.fixture
    def cases(self) -> list[dict[str, Any]]:
        cases: list[dict[str, Any]] = json.loads(shared_path("data/scorer_golden.json").read_text())["cases"]
        assert len(cases) == 600
        return cases

    def test_scores_and_flags(self, cases: list[dict[str, Any]]) -> None:
        for case, row in zip(cases, ClydeAware().explain(situations(cases)), strict=True):
            pellets = row[: len(case["pellets"])]
            np.testing.assert_allclose([p["total"] for p in pellets], case["scores"], rtol=0, atol=1e-6)
            assert [p["safe"] for p in pellets] == case["safe_direction"]
            assert {p["threatening"] for p in row} == {case["threatening"]}

    def test_choices(self, cases: list[dict[str, Any]]) -> None:
        assert ClydeAware().select(situations(cases)).tolist() == [case["selected"] for case in cases]
        replanned = ClydeAware().select(situations(cases, current=True))
        expected = [case["current_target"] if case["replanned_to"] is None else case["replanned_to"] for case in cases]
        assert replanned.tolist() == expected


@pytest.mark.parametrize(
    ("distance", "closing", "expected"),
    [
        (0.25, 1.0, False),
        (0.26, -1.0, True),
        (2.0, -1.0, True),
        (2.01, 0.029, False),
        (2.01, 0.03, True),
        (3.0, 0.03, True),
        (3.01, 1.0, False),
    ],
)
def test_threat_depends_on_distance_and_closing_speed(distance: float, closing: float, expected: bool) -> None:
    case = {"robot": [0, 0], "clyde": [distance, 0], "closing_speed": closing, "pellets": [[1, 1]]}
    assert threatening(ClydeAware(), situations([case])) is expected


def test_safe_pellet_wins_only_under_threat() -> None:
    pellets = [[1.0, 0.0], [-12.0, 0.0]]  # towards Clyde and cheap; away from him and dear
    near = {"robot": [0, 0], "clyde": [1.9, 0.0], "pellets": pellets}
    scores = ClydeAware(direction_weight=0.0).scores(situations([near]))[0]
    assert scores[0] > scores[1]
    assert goal(ClydeAware(direction_weight=0.0), near) == 1
    assert goal(ClydeAware(direction_weight=0.0), near | {"clyde": [2.1, 0.0]}) == 0


def test_unsafe_pellet_is_taken_without_safe_ones() -> None:
    case = {"robot": [0, 0], "clyde": [1.9, 0.0], "pellets": [[1.0, 0.0], [-1.0, 0.0]], "mask": [True, False]}
    assert goal(ClydeAware(), case) == 0


def test_pellets_near_the_ghost_are_left_last() -> None:
    case = {"robot": [0, 0], "clyde": [4.0, 0.0], "pellets": [[4.0, 0.25], [0.0, 60.0]]}
    assert goal(ClydeAware(), case) == 1
    assert goal(ClydeAware(), case | {"mask": [True, False]}) == 0
    assert goal(ClydeAware("documented"), case) == 0
    reasons = ClydeAware().explain(situations([case]))[0]
    assert [reasons[0]["skipped"], reasons[1]["skipped"]] == [True, False]


def test_replan_margin_holds_against_safe_pellet() -> None:
    case = {"robot": [0, 0], "clyde": [1.9, 0.0], "pellets": [[1.0, 0.0], [-12.0, 0.0]], "current_target": 0}
    assert goal(ClydeAware(direction_weight=0.0), case) == 0


@pytest.mark.parametrize(("gain", "expected"), [(0.29, 0), (0.31, 1)])
def test_new_pellet_must_exceed_the_margin(gain: float, expected: int) -> None:
    case = {"robot": [0, 0], "clyde": [50, 50], "pellets": [[5.0, 0], [0, 5.0 - gain]], "current_target": 0}
    assert goal(ClydeAware(), case) == expected


def test_current_goal_without_pellet_is_given_up() -> None:
    case = {"robot": [0, 0], "clyde": [50, 50], "pellets": [[5.0, 0], [0, 4.9]], "mask": [False, True]}
    assert goal(ClydeAware(), case | {"current_target": 0}) == 1
    situation = random_situation(0, 1, pellets=2, refuges=1, allowed=1.0)
    for current in (2, 3):
        assert situation.kind[0, current] in (REFUGE, HOLD)
        chosen = ClydeAware().select(replace(situation, current=np.array([current])))
        assert situation.kind[0, chosen[0]] == PELLET


def test_documented_form_is_the_milestone_formula() -> None:
    situation = random_situation(1, 100, allowed=1.0)
    scores = ClydeAware("documented").scores(situation)
    for n in range(100):
        (xr, yr, _), (xc, yc) = situation.robot[n], situation.clyde[n]
        apart = math.dist((xr, yr), (xc, yc))
        threat = apart > 0.25 and (apart <= 2.0 or (apart <= 3.0 and situation.closing_speed[n] >= 0.03))
        for c, (x, y) in enumerate(situation.position[n]):
            if situation.kind[n, c] != PELLET:
                assert scores[n, c] == -np.inf
                continue
            cost = math.dist((x, y), (xr, yr)) + max(0.0, 2.0 - math.dist((x, y), (xc, yc))) * 3.0
            alignment = (xc - xr) * (x - xr) + (yc - yr) * (y - yr)
            cost += 5.0 * (1.0 + alignment) if threat and alignment > 0 else 0.0
            assert scores[n, c] == pytest.approx(-cost, abs=1e-9)


def test_only_distance_counts_without_a_ghost() -> None:
    situation = random_situation(2, 50)
    unheard = replace(situation, clyde=np.full((50, 2), np.nan))
    for row in ClydeAware().explain(unheard):
        for candidate in row:
            assert not candidate["threatening"]
            if candidate["kind"] == "pellet":
                assert candidate["total"] == candidate["distance"]
                assert candidate["safe"]


class TestThreatExitMargin:
    @staticmethod
    def at(distance: float, closing: float = 0.0) -> Situation:
        case = {"robot": [0, 0], "clyde": [distance, 0], "closing_speed": closing, "pellets": [[1, 1]]}
        return situations([case])

    def flags(self, policy: ClydeAware, distances: list[float]) -> list[bool]:
        found = []
        for distance in distances:
            policy.select(self.at(distance))
            found.append(threatening(policy, self.at(distance)))
        return found

    def test_threat_ends_only_beyond_the_margin(self) -> None:
        assert self.flags(ClydeAware(), [2.1, 1.9, 2.1, 1.9, 2.1]) == [False, True, False, True, False]
        policy = ClydeAware(threat_exit_margin_m=0.5)
        assert self.flags(policy, [2.1, 1.9, 2.1, 2.5, 2.51, 2.1]) == [False, True, True, True, False, False]

    def test_other_number_of_games_needs_reset(self) -> None:
        policy = ClydeAware(threat_exit_margin_m=0.5)
        policy.select(random_situation(0, 4))
        with pytest.raises(ValueError, match="2 games, but 4 are remembered"):
            policy.select(random_situation(0, 2))
        policy.reset(np.ones(2, np.bool_), make_config())
        assert policy.select(random_situation(0, 2)).shape == (2,)


@settings(deadline=None)  # the first call compiles
@given(
    seed=st.integers(0, 10**6),
    angle=st.floats(-math.pi, math.pi),
    shift=st.tuples(st.floats(-50, 50), st.floats(-50, 50)),
    form=st.sampled_from(["deployed", "documented"]),
)
def test_scores_are_independent_of_map_frame(seed: int, angle: float, shift: tuple[float, float], form: Any) -> None:
    situation = random_situation(seed, 4)
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    robot = situation.robot.copy()
    robot[:, :2] = robot[:, :2] @ turn.T + shift
    moved = replace(
        situation, robot=robot, clyde=situation.clyde @ turn.T + shift, position=situation.position @ turn.T + shift
    )
    np.testing.assert_allclose(ClydeAware(form).scores(moved), ClydeAware(form).scores(situation), atol=1e-9)


def test_bad_forms_and_parameters_are_named() -> None:
    with pytest.raises(ValueError, match="form = 'other'"):
        ClydeAware("other")  # type: ignore[arg-type]
    for value in (-1.0, math.nan, math.inf):
        with pytest.raises(ValueError, match="risk_weight"):
            ClydeAware(risk_weight=value)
    with pytest.raises(TypeError, match=r"'risk_wait'.*risk_weight"):
        ClydeAware(risk_wait=1.0)
