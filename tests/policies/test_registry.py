import shutil
from pathlib import Path

import pytest

from pacman_env.config import ConfigError
from pacman_env.policies.base import Policy
from pacman_env.policies.learned import PRETRAINED
from pacman_env.policies.registry import LEARNED_CLYDE, behaviours_of, make_policy, policy_names, split_ghosts
from tests.policies.contract import PolicyContract


@pytest.fixture(scope="module")
def planner(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A learned planner's file, ``ppo.onnx``."""
    pytest.importorskip("torch")
    pytest.importorskip("onnx")
    from tests.training.planners import random_planner

    return random_planner(tmp_path_factory.mktemp("planner"), "ppo")


@pytest.mark.parametrize("name", policy_names())
class TestEveryPolicyByName(PolicyContract):
    @pytest.fixture(autouse=True)
    def _name(self, name: str) -> None:
        self.policy_name = name

    def make(self) -> Policy:
        return make_policy(self.policy_name)

    def test_policy_knows_its_name(self) -> None:
        assert self.make().name == self.policy_name


def test_handcrafted_policies_are_registered() -> None:
    assert {"clyde_aware", "clyde_aware:documented", "nearest", "random", "random_pellet", "search:alone"} <= set(
        policy_names()
    )
    assert make_policy("search:alone", nodes=4000).base.name == "lookahead"  # type: ignore[attr-defined]


def test_file_is_a_policy(planner: Path) -> None:
    assert make_policy(str(planner), threads=1).name == "ppo"
    with pytest.raises(ValueError, match=r"other\.onnx: cannot be read"):
        make_policy(str(planner.with_name("other.onnx")))


def test_ghosts_are_split_into_behaviours_and_policies(planner: Path) -> None:
    behaviours, policies = split_ghosts(("wander", str(planner), "nearest", "clyde:learned"))
    assert behaviours == ("wander", "policy", "policy", "policy")
    assert {number: policy.name for number, policy in policies.items()} == {1: "ppo", 2: "nearest", 3: "clyde"}
    with pytest.raises(ConfigError, match=r"clyde\.ghosts\[1\] = 'policy': name the \.onnx file that moves it"):
        split_ghosts(("wander", "policy"))


def test_behaviours_are_found_without_loading_policies() -> None:
    assert behaviours_of(("wander", "nobody.onnx", "nearest", "arcade")) == ("wander", "policy", "policy", "arcade")
    with pytest.raises(ConfigError, match="nobody"):
        behaviours_of(("wander", "nobody"))


def test_learned_clyde_is_no_robot_policy() -> None:
    assert LEARNED_CLYDE not in policy_names()
    assert make_policy(LEARNED_CLYDE).name == "clyde"


def test_parameters_reach_the_policy() -> None:
    assert make_policy("nearest", replan_margin_m=1.5).replan_margin_m == 1.5  # type: ignore[attr-defined]


def test_suffix_of_planner_file_is_read_in_any_case(tmp_path: Path) -> None:
    for suffix, name in ((".onnx", "GOOD.ONNX"), (".json", "GOOD.json")):
        shutil.copy(PRETRAINED.with_suffix(suffix), tmp_path / name)
    spec = str(tmp_path / "GOOD.ONNX")
    assert make_policy(spec).name
    assert split_ghosts([spec])[0] == ("policy",)
    with pytest.raises(ValueError, match="export"):
        make_policy("model.ZIP")
