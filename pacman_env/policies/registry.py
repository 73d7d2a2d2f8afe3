"""Create policies by name or file; the built-in ones only need the base installation."""

from collections.abc import Callable, Sequence
from typing import Any

from pacman_env.config import ConfigError
from pacman_env.game.ghosts import POLICY, behaviour_names, find_behaviour
from pacman_env.plugins import Registry
from pacman_env.policies.base import BasePolicy, Policy
from pacman_env.policies.learned import PRETRAINED, LearnedPlanner
from pacman_env.policies.policy_calls import what_users_raise

_FILE = ".onnx"
#: Policy of a ghost, trained against a planner (docs/adversary.md); therefore not among the listed policies.
LEARNED_CLYDE = "clyde:learned"
#: Factories of policies, called with parameters; other packages add entry points.
POLICIES: Registry[Callable[..., Policy]] = Registry(
    "policy",
    "pacman_env.policies",
    {
        "clyde_aware": "pacman_env.heuristics.clyde_aware:ClydeAware",
        "clyde_aware:documented": "pacman_env.heuristics.clyde_aware:documented",
        "lookahead": "pacman_env.heuristics.lookahead:Lookahead",
        "nearest": "pacman_env.heuristics.simple:Nearest",
        "ppo": LearnedPlanner,
        "random": "pacman_env.heuristics.simple:Random",
        "random_pellet": "pacman_env.heuristics.simple:RandomPellet",
        "search": "pacman_env.heuristics.search.search:Search",
        "search:alone": "pacman_env.heuristics.search.search:alone",
    },
    "module:Class, or an .onnx file",
)
register_policy = POLICIES.register
policy_names = POLICIES.names


def make_policy(spec: str, **parameters: Any) -> Policy:
    """Create a policy, for example ``make_policy("clyde_aware:documented", replan_margin_m=0.5)``.

    ``spec`` is a name, a class such as ``my_package.policies:Shy``, or a file such as ``runs/mine.onnx``. Raises
    ValueError for an unknown name, a parameter out of range or a file of another version. Raises TypeError for an
    unknown parameter, and ModuleNotFoundError for a learned planner without onnxruntime.
    """
    if spec == LEARNED_CLYDE:
        return LearnedPlanner(PRETRAINED.with_name("clyde.onnx"), **parameters)
    if spec.lower().endswith(_FILE):
        from pacman_env.policies.flat import FlatPolicy, is_flat_policy  # imports the simulator

        return (FlatPolicy if is_flat_policy(spec) else LearnedPlanner)(spec, **parameters)
    if spec.lower().endswith(".zip"):
        raise ValueError(
            f"{spec}: must be an .onnx file. 'pacman-env export' converts a checkpoint of 'pacman-env train'. "
            "A model of Stable-Baselines3 would unpickle; export it with pacman_env.sb3.export"
        )
    factory = POLICIES.find(spec)
    if not callable(factory):
        raise ValueError(f"policy {spec!r}: {factory!r} is no class or function that makes one")
    if parameters:  # given in Python code, so a wrong one may raise TypeError
        policy = factory(**parameters)
    else:
        with what_users_raise(factory, spec):
            policy = factory()
    missing = [name for name in ("reset", "scores", "select", "explain", "name") if not hasattr(policy, name)]
    if missing:
        raise ValueError(f"policy {spec!r}: {policy!r} is not a policy, it has no {', '.join(missing)}")
    kind = type(policy)
    if getattr(kind, "scores", None) is BasePolicy.scores and kind.select is BasePolicy.select:
        raise ValueError(f"policy {spec!r}: {kind.__name__} has no scores(self, situation)")
    return policy


def moved_by_policy(ghost: str) -> bool:
    """Return True if a name in ``clyde.ghosts`` means a policy (also ``clyde:learned`` or a file), not a behaviour."""
    file = ghost == LEARNED_CLYDE or ghost.lower().endswith(_FILE)
    return file or (ghost in policy_names() and ghost not in behaviour_names())


def behaviours_of(ghosts: Sequence[str]) -> tuple[str, ...]:
    """Return the behaviour of each ghost: ``policy`` if a policy moves it, which is not loaded.

    Raises ConfigError for an unknown behaviour and for ``policy`` itself.
    """
    for number, name in enumerate(ghosts):
        if name == POLICY:
            raise ConfigError(f"clyde.ghosts[{number}] = 'policy': name the .onnx file that moves it instead")
        if not moved_by_policy(name):
            find_behaviour(name)
    return tuple(POLICY if moved_by_policy(name) else name for name in ghosts)


def split_ghosts(ghosts: Sequence[str]) -> tuple[tuple[str, ...], dict[int, Policy]]:
    """Return the behaviour of each ghost (``policy`` if a policy moves it), and these policies by ghost number.

    Raises the errors of :func:`behaviours_of` and ``make_policy``.
    """
    behaviours = behaviours_of(ghosts)
    return behaviours, {number: make_policy(ghosts[number]) for number, one in enumerate(behaviours) if one == POLICY}
