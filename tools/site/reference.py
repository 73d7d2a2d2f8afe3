"""The pages of the public names, for autodoc: in groups, and every name of ``__all__`` in one of them."""

import inspect
from typing import Any

import pacman_env

#: By page: title, what it is about, names; of ``pacman_env`` but for those that begin with ``sb3.``.
GROUPS: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "environments": (
        "Environments",
        "Environments, their registration and their parts.",
        (
            *("PacManBotEnv", "PacManBotVectorEnv", "PacManBotParallelEnv", "parallel_env", "env"),
            *("PacManBotParallelVecEnv", "parallel_vec_env", "register_envs", "OUTCOMES", "render_frame"),
        ),
    ),
    "sb3": ("Stable-Baselines3", "`pacman_env.sb3`, of the extra `train`.", ("sb3.PacManBotVecEnv",)),
    "policies": (
        "Policies",
        "Policies, and what a policy sees.",
        (
            *("Policy", "BasePolicy", "make_policy", "policy_names", "register_policy", "Situation"),
            *("PELLET", "REFUGE", "HOLD", "Opponents", "BehaviourOpponent"),
        ),
    ),
    "ghosts": (
        "Ghosts and observations",
        "Ghosts' behaviours and kinds of observation of your own.",
        ("Behaviour", "GhostView", "register_ghost", "ObservationKind", "ObservationPart", "register_observation"),
    ),
    "simulator": (
        "Configuration, maps, simulator",
        "Configurations, maps, and the batch of games below all environments.",
        (
            *("Config", "ConfigError", "make_config", "register_preset", "OccupancyMap", "MapError", "load_map"),
            "GameBatch",
        ),
    ),
    "statistics": (
        "Statistics",
        "Intervals of a comparison, and the version.",
        ("wilson", "paired_difference", "__version__"),
    ),
}


def names() -> set[str]:
    from pacman_env import sb3

    return {*pacman_env.__all__, *(f"sb3.{name}" for name in sb3.__all__)}


def index() -> str:
    text = "# Public names\n\nWhat `pacman_env` and `pacman_env.sb3` export; every other module is private.\n"
    for page_name, (title, about, members) in GROUPS.items():
        links = ", ".join(f"{{py:obj}}`{name} <pacman_env.{name}>`" for name in members)
        text += f"\n## [{title}]({page_name}.md)\n\n{about}\n\n{links}\n"
    entries = "\n".join(GROUPS)
    return text + f"\n```{{toctree}}\n:hidden:\n\n{entries}\n```\n"


def page(name: str) -> str:
    title, about, members = GROUPS[name]
    text = f"# {title}\n\n{about}\n"
    for member in members:
        text += f"\n```{{eval-rst}}\n{_directive(member)}\n```\n"
    return text


def _directive(name: str) -> str:
    if name.startswith("sb3."):
        return f".. autoclass:: pacman_env.{name}\n   :members:\n"
    thing: Any = getattr(pacman_env, name)
    if name == "parallel_env":  # a class by another name
        return f".. py:data:: pacman_env.{name}\n\n   :py:class:`pacman_env.{thing.__name__}` by another name.\n"
    if inspect.isclass(thing):
        hidden = "   :exclude-members: config\n" if name == "BasePolicy" else ""  # its value is a whole Config
        return f".. autoclass:: pacman_env.{name}\n   :members:\n{hidden}"
    if callable(thing):
        return f".. autofunction:: pacman_env.{name}\n"
    return f".. py:data:: pacman_env.{name}\n   :value: {thing!r}\n"
