"""Messages as a test has received them: what sessions, probes of processes and recordings share."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pacman_env.ros.topics import Topic


@dataclass(frozen=True)
class Recorded:
    """One message, and when it was handled, s: of simulated time in a session, of ``time.monotonic`` in a probe."""

    at: float
    topic: str
    message: Any

    @property
    def value(self) -> Any:
        return self.message.data


class Records:
    """What was recorded, in the order of arrival."""

    now_s: float  # time by which messages are recorded

    def __init__(self) -> None:
        self.records: list[Recorded] = []  # of all recorded topics
        self._by_topic: dict[str, list[Recorded]] = {}  # the same
        self._latest: dict[str, Any] = {}  # messages, those that were forgotten among them

    def add(self, one: Recorded) -> None:
        self.records.append(one)
        self._by_topic.setdefault(one.topic, []).append(one)
        self._latest[one.topic] = one.message

    def record(self, *wanted: Topic) -> None:
        """Record from now on; of a latched topic, what it was said last, too."""
        for topic in wanted:
            if topic.name not in self._by_topic:
                self._by_topic[topic.name] = []
                self.subscribe(topic, lambda message, name=topic.name: self.add(Recorded(self.now_s, name, message)))

    def subscribe(self, topic: Topic, receive: Callable[[Any], None]) -> None:
        raise NotImplementedError

    def on(self, *wanted: Topic) -> list[Recorded]:
        """The records of some topics, in order."""
        if len(wanted) == 1:
            return self._by_topic.get(wanted[0].name, [])[:]
        names = {topic.name for topic in wanted}
        return [one for one in self.records if one.topic in names]

    def messages(self, topic: Topic) -> list[Any]:
        return [one.message for one in self.on(topic)]

    def values(self, topic: Topic) -> list[Any]:
        """As ``messages``, the ``data`` alone."""
        return [one.value for one in self.on(topic)]

    def last(self, topic: Topic) -> Any:
        """The last message; None: none."""
        records = self._by_topic.get(topic.name)
        return records[-1].message if records else None

    def latest(self, topic: Topic) -> Any:
        """As ``last``, be it forgotten or not."""
        return self._latest.get(topic.name)

    def value(self, topic: Topic) -> Any:
        """As ``latest``, the ``data`` alone."""
        message = self.latest(topic)
        return None if message is None else message.data

    def clear(self, *topics: Topic) -> None:
        """Drop what was recorded so far on some topics; none: on all."""
        names = {topic.name for topic in topics} or set(self._by_topic)
        self.records[:] = [one for one in self.records if one.topic not in names]
        for name in names:
            self._by_topic[name].clear()
