"""Node with the configuration of a game, which it publishes and compares with the configuration of all others."""

from __future__ import annotations

import json
import os
import socket
import time
from collections.abc import Mapping
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.parameter import Parameter

from pacman_env.config import EXECUTIONS, Config, differences, make_config, parse_settings, preset_names
from pacman_env.world.maps.occupancy import OccupancyMap, load_map

from .message_conversion import configuration_of, started
from .node import BaseNode, parameter
from .topics import CONFIGURATION

_LISTED = 5  # most differing fields that a log message lists


class ConfiguredNode(BaseNode):
    """Node with a configuration; the later of two such nodes of one name in a namespace ends."""

    config: Config  # from the parameters preset, execution and settings
    map: OccupancyMap  # from the parameter map_yaml
    map_yaml: str

    def __init__(self, name: str, *, with_map: bool = False, **options: Any) -> None:
        super().__init__(name, **options)
        preset = parameter(self, "preset", "robot", f"configuration: one of {', '.join(preset_names())}")
        execution = parameter(self, "execution", "robust", f"rules of Algorithm 4: one of {', '.join(EXECUTIONS)}")
        text = "fields of the configuration that differ from preset and execution, each name=value"
        descriptor = ParameterDescriptor(description=text, read_only=True)
        settings = self.declare_parameter("settings", Parameter.Type.STRING_ARRAY, descriptor).value or ()
        self.rules = preset, execution, list(settings)
        self.config = make_config(preset, execution, **parse_settings(settings))
        if with_map:
            self.map_yaml = parameter(self, "map_yaml", "", "YAML file of the map, or the name of a built-in map")
            self.map = load_map(self.map_yaml)
        acts = self.acts()
        self._plays: dict[str, Any] = {
            "node": name if acts else self.get_name(),  # a renamed node that acts is still a rival
            "acts": acts,
            "started": process(),
            "hash": self.config.hash,
            "map": self.map.hash[:12] if with_map else None,
            "rules": self.rules,
            "configuration": self.config.as_dict(),
        }
        self._configuration = CONFIGURATION.publisher(self)
        self.listen(CONFIGURATION, self._compare, "bad configuration")
        self._configuration.publish(CONFIGURATION.type(data=json.dumps(self._plays)))
        self._differing: dict[str, str] = {}  # by trouble: the node with another configuration

    def acts(self) -> bool:
        """Return True if only one node of this kind may run: the later of two such nodes ends."""
        return True

    def _compare(self, message: Any) -> None:
        """Log how another node's configuration differs from this node's; refuse to run if this node runs already.

        A node's difference is logged once, and again only if the two configurations were equal in between.
        """
        own, other = self._plays, configuration_of(message)
        node, map = other["node"], other["map"]
        if node == own["node"] and own["acts"] and other["acts"] and started(other) < started(own):
            place = self.get_namespace()
            self.refuse(f"another {node} plays in {place} already: {process_words(other)}")
            return
        fields_differ = differences(other["configuration"], own["configuration"])
        if map != own["map"] and None not in (map, own["map"]):
            fields_differ["map"] = map, own["map"]
        trouble = f"configuration of {node}"
        if not fields_differ:
            self._agrees(trouble)
            return
        fields = [f"{name} {theirs}, here {ours}" for name, (theirs, ours) in fields_differ.items()]
        more = [f"{len(fields) - _LISTED} fields more"] if len(fields) > _LISTED else []
        text = "; ".join([*fields[:_LISTED], *more])
        self._differing[trouble] = node
        self.once.begin(trouble, f"{node} plays by another configuration: {text}")

    def _agrees(self, trouble: str) -> None:
        if self._differing.pop(trouble, None) is not None:
            self.once.over(trouble)

    def troubles(self) -> dict[str, int]:
        """Return the current troubles and how often each occurred."""
        if self._differing:
            names = {info.node_name for info in self.get_publishers_info_by_topic(self._configuration.topic_name)}
            for trouble in [trouble for trouble, node in self._differing.items() if node not in names]:
                self._agrees(trouble)
        return self.once.counts


def process_words(plays: Mapping[str, Any]) -> str:
    started_s, host, number = started(plays)
    return f"process {number} on {host}, since {time.strftime('%H:%M:%S', time.localtime(started_s))}"


def process() -> list[Any]:
    """Identify this process: its start (s since 1970), its machine and its number."""
    return [time.time(), socket.gethostname(), os.getpid()]
