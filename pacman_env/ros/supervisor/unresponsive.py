"""Nodes that do not respond to the referee's requests, as the referee reports them."""

from collections.abc import Mapping
from typing import Any

from pacman_env.ros import topics
from pacman_env.ros.messages import BadMessage, object_of

_LONGEST = 10_000  # characters
WORDS = "{} does not respond"  # a node


def reasons_of(message: Any) -> dict[str, str]:
    """Return the reason by node; raises BadMessage for a message that no referee publishes."""
    reasons = object_of(message, _LONGEST)
    if not all(isinstance(reason, str) for reason in reasons.values()):
        raise BadMessage("reasons that are no text")
    return {str(node)[:100]: str(reason)[:200] for node, reason in reasons.items()}


class Unresponsive:
    """Latest report, received through a node that has ``listen``."""

    def __init__(self, node: Any) -> None:
        self.reasons: Mapping[str, str] = {}
        node.listen(topics.UNRESPONSIVE, self._receive, "bad report of nodes that do not respond")

    def _receive(self, message: Any) -> None:
        self.reasons = reasons_of(message)

    @property
    def troubles(self) -> dict[str, str]:
        """Texts of the troubles by kind."""
        return {words: f"{words}: {reason}" for node, reason in self.reasons.items() for words in (WORDS.format(node),)}
