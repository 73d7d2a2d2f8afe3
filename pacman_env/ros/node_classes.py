"""Find the class of a node by its name; only programs that run several nodes in one process need this."""

import importlib

from .game_nodes import module_of
from .node import BaseNode


def node_class(name: str) -> type[BaseNode]:
    """Return the class of one of the game's nodes by the node's name."""
    module = importlib.import_module(module_of(name))
    kinds = [one for one in vars(module).values() if isinstance(one, type) and issubclass(one, BaseNode)]
    return next(kind for kind in kinds if kind.__module__ == module.__name__)
