"""Registers the environments with Gymnasium and PettingZoo: at once where they are imported already, else then.

Importing this package must load neither, as a robot's node does without their 8 MB, and neither loads plug-ins by entry
points. The standard library has no public hook for the end of an import, so a finder in ``sys.meta_path`` waits for it.
"""

import sys
from collections.abc import Callable
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any, NoReturn

ENV_ID = "pacman_env/PacManBot-v0"
#: The same game for stock learners: with ``flat=True``.
FLAT_ID = "pacman_env/PacManBotFlat-v0"
_IDS: dict[str, dict[str, Any]] = {ENV_ID: {}, FLAT_ID: {"flat": True}}
#: Of ``FLAT_ID`` before 1.0; its spec is named ``FLAT_ID``, as another version of PacManBot would make v0 out of date.
FORMER_FLAT_ID = "pacman_env/PacManBot-v1"


def register_envs() -> None:
    """Register ``PacManBot-v0`` and ``PacManBotFlat-v0`` with Gymnasium; a second call changes nothing."""
    import gymnasium as gym

    for name, kwargs in _IDS.items():
        if name not in gym.registry:
            gym.register(
                name,
                entry_point="pacman_env.envs.pacmanbot:PacManBotEnv",
                vector_entry_point="pacman_env.envs.pacmanbot_vector:PacManBotVectorEnv",
                kwargs=dict(kwargs),
            )
    refuse = f"{__name__}:refuse_former_id"
    former = gym.envs.registration.EnvSpec(FLAT_ID, entry_point=refuse, vector_entry_point=refuse)
    gym.registry.setdefault(FORMER_FLAT_ID, former)


def register_parallel_envs() -> None:
    """Register the same names with PettingZoo; does nothing before PettingZoo 1.27, which has no registry."""
    import pettingzoo

    if not hasattr(pettingzoo, "register"):
        return
    for kind, known in (("parallel", pettingzoo.parallel_registry), ("aec", pettingzoo.aec_registry)):
        entry_point = f"pacman_env:{'parallel_env' if kind == 'parallel' else 'env'}"
        for name, kwargs in _IDS.items():
            if name not in known:
                pettingzoo.register(kind, name, entry_point, kwargs=dict(kwargs))
        known.setdefault(FORMER_FLAT_ID, pettingzoo.EnvSpec(FLAT_ID, entry_point=refuse_former_id))


def refuse_former_id(**_: Any) -> NoReturn:
    """The entry point of ``FORMER_FLAT_ID``."""
    from gymnasium.error import DeprecatedEnv

    raise DeprecatedEnv(f"{FORMER_FLAT_ID} is {FLAT_ID} since 1.0")


def register_when_imported() -> None:
    """Register now with what is imported, else at the end of its import."""
    for name, register in (("gymnasium", register_envs), ("pettingzoo", register_parallel_envs)):
        if name in sys.modules:
            register()
        else:
            sys.meta_path.insert(0, _Finder(name, register))


class _Finder(MetaPathFinder):
    """Finds a module as the other finders do, and calls ``then`` when it is loaded, not when it is only searched."""

    def __init__(self, module: str, then: Callable[[], None]) -> None:
        self._module, self._then = module, then

    def find_spec(self, fullname: str, path: Any = None, target: ModuleType | None = None) -> ModuleSpec | None:
        if fullname != self._module:
            return None
        others = (finder for finder in sys.meta_path if finder is not self)
        spec = next((found for one in others if (found := one.find_spec(fullname, path, target))), None)
        if spec is not None and spec.loader is not None:
            load = spec.loader.exec_module

            def load_and_register(module: ModuleType) -> None:
                load(module)
                if self in sys.meta_path:
                    sys.meta_path.remove(self)
                self._then()

            spec.loader.exec_module = load_and_register  # type: ignore[method-assign]
        return spec
