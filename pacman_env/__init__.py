"""PacManBot as a learning environment: maps, game rules, simulator, policies.

Importing this package registers the environments with Gymnasium and PettingZoo, also if these are imported later. A
public name loads its module on first use. The names in ``__all__`` and the names of :mod:`pacman_env.sb3` are public;
every other module is private and may change.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from pacman_env._version import __version__
from pacman_env.envs.registration import register_envs, register_when_imported

if TYPE_CHECKING:
    from .config import Config, ConfigError, make_config
    from .config.composition import register_preset
    from .envs.infos import OUTCOMES
    from .envs.pacmanbot import PacManBotEnv
    from .envs.pacmanbot_vector import PacManBotVectorEnv
    from .envs.parallel_vec_env import PacManBotParallelVecEnv, parallel_vec_env
    from .envs.pettingzoo_env import PacManBotParallelEnv, env, parallel_env
    from .episodes.statistics import paired_difference, wilson
    from .game.ghosts import Behaviour, GhostView, register_ghost
    from .observations.kinds import ObservationKind, ObservationPart, register_observation
    from .observations.situation import HOLD, PELLET, REFUGE, Situation
    from .policies.base import BasePolicy, Policy
    from .policies.opponents import BehaviourOpponent, Opponents
    from .policies.registry import make_policy, policy_names, register_policy
    from .render.frames import render_frame
    from .sim.batch import GameBatch
    from .world.maps.occupancy import MapError, OccupancyMap, load_map

__all__ = ["HOLD", "OUTCOMES", "PELLET", "REFUGE", "__version__"]
__all__ += ["PacManBotEnv", "PacManBotParallelEnv", "PacManBotParallelVecEnv", "PacManBotVectorEnv", "register_envs"]
__all__ += ["GameBatch", "Situation", "env", "parallel_env", "parallel_vec_env", "render_frame"]
__all__ += ["BasePolicy", "BehaviourOpponent", "Opponents", "Policy", "make_policy", "policy_names", "register_policy"]
__all__ += ["Behaviour", "GhostView", "ObservationKind", "ObservationPart", "register_ghost", "register_observation"]
__all__ += ["Config", "ConfigError", "MapError", "OccupancyMap", "load_map", "make_config", "register_preset"]
__all__ += ["paired_difference", "wilson"]

#: Public names by module.
_EXPORTS = {
    "config": "Config ConfigError make_config",
    "config.composition": "register_preset",
    "envs.infos": "OUTCOMES",
    "envs.pacmanbot": "PacManBotEnv",
    "envs.pacmanbot_vector": "PacManBotVectorEnv",
    "envs.parallel_vec_env": "PacManBotParallelVecEnv parallel_vec_env",
    "envs.pettingzoo_env": "PacManBotParallelEnv env parallel_env",
    "episodes.statistics": "paired_difference wilson",
    "game.ghosts": "Behaviour GhostView register_ghost",
    "policies.base": "BasePolicy Policy",
    "policies.opponents": "BehaviourOpponent Opponents",
    "policies.registry": "make_policy policy_names register_policy",
    "render.frames": "render_frame",
    "sim.batch": "GameBatch",
    "observations.kinds": "ObservationKind ObservationPart register_observation",
    "observations.situation": "HOLD PELLET REFUGE Situation",
    "world.maps.occupancy": "MapError OccupancyMap load_map",
}
_MODULE_OF = {name: module for module, names in _EXPORTS.items() for name in names.split()}

register_when_imported()


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(f"{__name__}.{_MODULE_OF[name]}"), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
