"""Nodes that do not do what the referee asks them to, as it reports them."""

from collections.abc import Mapping
from typing import Any

from pacman_env.ros import topics
from pacman_env.ros.messages import BadMessage, object_of

_LONGEST = 10_000  # characters
WORDS = "{} does not respond"  # a node


def reasons_of(message: Any) -> dict[str, str]:
    """What is wrong, by node; BadMessage for what no referee publishes."""
    found = object_of(message, _LONGEST)
    if not all(isinstance(reason, str) for reason in found.values()):
        raise BadMessage("reasons that are no text")
    return {str(node)[:100]: str(reason)[:200] for node, reason in found.items()}


class Unresponsive:
    """The latest report, received by a node that has ``listen``."""

    def __init__(self, node: Any) -> None:
        self.reasons: Mapping[str, str] = {}
        node.listen(topics.UNRESPONSIVE, self._receive, "bad report of nodes that do not respond")

    def _receive(self, message: Any) -> None:
        self.reasons = reasons_of(message)

    @property
    def troubles(self) -> dict[str, str]:
        """By kind, with their words."""
        return {words: f"{words}: {reason}" for node, reason in self.reasons.items() for words in (WORDS.format(node),)}
