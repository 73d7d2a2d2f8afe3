"""Compiled forward pass of a planner that ``pacman-env export`` wrote, in one call for all games of a batch.

Sums have a fixed order, so the results of a game do not depend on its batch.
"""

from typing import Any

import numpy as np
from google.protobuf.empty_pb2 import Empty
from google.protobuf.unknown_fields import UnknownFieldSet
from numpy.typing import NDArray

from pacman_env.engine.jit import kernel
from pacman_env.engine.native import LANES, ROWS, multiply_block


class ForwardPass:
    """Network in an ONNX file with the content ``model``."""

    def __init__(self, model: bytes) -> None:
        graph = dict(_fields(model))[7]  # numbers of fields: see onnx.proto
        named: dict[str, NDArray[np.float32]] = {}  # a row for each input
        for tensor in (_fields(value) for number, value in _fields(graph) if number == 5):
            shape, content = [value for number, value in tensor if number == 1], dict(tensor)
            named[content[8].decode()] = np.frombuffer(content[9], "<f4").reshape(shape).T
        own, width = len(named["shown"]), len(named["encode.bias"])
        first, last = named["encode_candidate.weight"], named["judge_candidate.weight"]
        named |= {"own": first[:own] * named["shown"][:, None], "whole": first[own:]}
        named |= {"encoded": last[:width], "pooled": last[width:]}
        self._weights = {name: _whole_blocks(weight) for name, weight in named.items()}

    def run(
        self, candidates: NDArray[np.float32], whole: NDArray[np.float32], mask: NDArray[np.bool_]
    ) -> tuple[NDArray[Any], NDArray[Any]]:
        """Return logits (N, C), -inf outside ``mask`` (N, C), and values (N,); see ``LearnedPlanner.run``."""
        w, counts, first = self._weights, mask.sum(axis=1), np.zeros(mask.size + len(mask), np.int64)
        game = np.repeat(np.arange(len(mask)), counts)
        own = np.ascontiguousarray(candidates[mask], np.float32).reshape(len(game), len(w["own"]))
        whole = np.ascontiguousarray(whole, np.float32).reshape(len(mask), len(w["whole"]))
        context = _layer(whole, w["whole"], w["encode_candidate.bias"], first, -np.inf)
        encoded = _layer(own, w["own"], context, game, 0.0)
        encoded = _layer(encoded, w["encode.weight"], w["encode.bias"], first, 0.0)
        pooled = np.zeros((len(mask), len(w["pooled"])), np.float32)
        _pool(encoded, game, pooled)
        pooled[:, : len(w["encoded"])] /= np.maximum(counts, 1)[:, None]
        context = _layer(pooled, w["pooled"], w["judge_candidate.bias"], first, -np.inf)
        judged = _layer(encoded, w["encoded"], context, game, 0.0)
        logits = np.full(mask.shape, -np.inf)
        logits[mask] = _layer(judged, w["judge.weight"], w["judge.bias"], first, -np.inf)[:, 0]
        hidden = np.concatenate([pooled, whole], axis=1)
        hidden = _layer(hidden, w["critic.0.weight"], w["critic.0.bias"], first, 0.0)
        return logits, _layer(hidden, w["critic.2.weight"], w["critic.2.bias"], first, -np.inf)[:, 0]


@kernel
def _layer(inputs, weight, start, which, least):  # type: ignore[no-untyped-def]
    """Return ``max(start[which] + inputs @ weight, least)``; inputs may have more columns than the weight has rows."""
    out = np.empty((len(inputs), weight.shape[1]), np.float32)
    for row in range(0, len(out), ROWS):
        for column in range(0, out.shape[1], LANES):
            multiply_block((inputs, weight, start, out, which), least, row, column)
    return out


@kernel
def _pool(encoded, game, out):  # type: ignore[no-untyped-def]
    """Write sum and maximum of the rows (I or more) of each ``game`` to ``out`` (N, 2 I), which must contain zeros."""
    width = out.shape[1] // 2
    for k in range(len(game)):
        row = out[game[k]]
        for j in range(width):
            row[j] += encoded[k, j]
            row[width + j] = max(row[width + j], encoded[k, j])


def _whole_blocks(weight: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return a matrix with columns of zeros up to whole blocks; a vector becomes its only row."""
    matrix = np.ascontiguousarray(np.atleast_2d(weight))
    return np.pad(matrix, ((0, 0), (0, -matrix.shape[1] % LANES)))


def _fields(message: bytes) -> list[tuple[int, Any]]:
    """Return number and value of each field of a message in Protocol Buffers' format: an integer or bytes."""
    return [(field.field_number, field.data) for field in UnknownFieldSet(Empty.FromString(message))]
