"""Facts that a training stores with the weights of a network."""

from pacman_env.policies.metadata import Training
from pacman_env.training.arguments import Arguments
from pacman_env.training.checkpoint import Facts
from pacman_env.training.games import VALIDATION_LEVEL, game_config


def facts_of(arguments: Arguments, decisions: int, metrics: dict[str, float]) -> Facts:
    """Return the facts of a network after ``decisions`` decisions; ``metrics`` by name."""
    training = Training(
        clyde_speeds_mps=arguments.hyper.clyde_speed,
        robot_speeds_mps=arguments.hyper.robot_speed,
        levels=f"generated:train below {VALIDATION_LEVEL}",
        preset=arguments.preset,
        execution=arguments.execution,
        decisions=decisions,
        seed=arguments.seed,
        ghosts=arguments.hyper.ghosts,
    )
    return Facts(game_config(arguments).robot.speed_mps, training, metrics)
