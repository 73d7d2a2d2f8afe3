"""Messages of a goal selector about its choices: candidates, scores as markers, terms of the scores as JSON."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from std_msgs.msg import String
from visualization_msgs.msg import Marker, MarkerArray

from pacman_env.levels.assets import MapAssets
from pacman_env.observations.robot_view import RobotView
from pacman_env.observations.situation import HOLD, Situation
from pacman_env.ros import topics
from pacman_env.ros.message_conversion import marker_message
from pacman_env.ros.selector.policy_child import as_json
from pacman_env.ros.topics import SCORE_MARKERS

_HEIGHT_M = 0.25  # height of the letters
_CHOSEN, _OTHER = (0.1, 0.8, 0.1), (0.4, 0.4, 0.4)


class Explanations:
    """Publisher of candidates and, while they have subscribers, of scores and their terms."""

    def __init__(self, node: Any, view: RobotView) -> None:
        self._node = node
        self._scores, self._why = topics.SCORES.publisher(node), topics.WHY.publisher(node)
        self._candidates = topics.CANDIDATES.publisher(node)
        self._candidates.publish(String(data=as_json(candidates_of(view.assets))))

    @property
    def scores_are_wanted(self) -> bool:
        return bool(self._scores.get_subscription_count())

    @property
    def why_is_wanted(self) -> bool:
        return bool(self._why.get_subscription_count())

    def publish(self, answer: Any, situation: Situation) -> None:
        """Publish the explanation in an answer of a policy (``policy_child.Answer``)."""
        if answer.unexplained:
            self._node.once.warning("no scores", answer.unexplained)
        if answer.scores is not None:
            stamp = self._node.get_clock().now().to_msg()
            self._scores.publish(score_markers(situation, answer.scores, answer.choice[0], stamp))
        if answer.why is not None:
            self._why.publish(String(data=answer.why))


def score_markers(situation: Situation, scores: Sequence[float], chosen: int, stamp: Any) -> Any:
    """Return a MarkerArray with a text marker for each finite score (C,) at the place of its candidate.

    The chosen candidate's score is green, and hold is shown at the robot. Marker ids are candidate numbers. The first
    marker deletes all earlier ones.
    """
    markers = [Marker(ns=SCORE_MARKERS, action=Marker.DELETEALL)]
    markers[0].header.frame_id, markers[0].header.stamp = "map", stamp
    for candidate, score in enumerate(scores):
        if not math.isfinite(score):
            continue
        x, y = situation.position[0, candidate].tolist()
        colour = _CHOSEN if candidate == chosen else _OTHER
        marker = marker_message(SCORE_MARKERS, candidate, (x, y), _HEIGHT_M, colour, stamp)
        marker.type = Marker.TEXT_VIEW_FACING
        marker.text = f"hold {score:.1f}" if situation.kind[0, candidate] == HOLD else f"{score:.1f}"
        markers.append(marker)
    return MarkerArray(markers=markers)


def candidates_of(assets: MapAssets) -> dict[str, Any]:
    """Return the candidates' positions (m) by number, pellets before refuges, and the ids of the pellets."""
    places = [[round(x, 3), round(y, 3)] for x, y in assets.goal_xy.tolist()]
    return {"map": assets.occupancy.name, "places": places, "pellets": assets.pellet_ids.tolist()}


def decision_times(times_ms: Sequence[float]) -> dict[str, float | int]:
    """Return the count of the times, and their last, median, 99th percentile and longest in ms."""
    if not times_ms:
        return {"count": 0}
    median, late = np.percentile(list(times_ms), (50, 99)).tolist()
    times = {"last_ms": times_ms[-1], "median_ms": median, "p99_ms": late, "longest_ms": max(times_ms)}
    return {"count": len(times_ms), **{name: round(value, 3) for name, value in times.items()}}
