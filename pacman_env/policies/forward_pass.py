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
        self._weights: list[NDArray[np.float32]] = []  # in the file's order, with columns up to whole blocks
        graph = dict(_fields(model))[7]  # numbers of fields: see onnx.proto
        for tensor in (_fields(value) for number, value in _fields(graph) if number == 5):
            shape, content = [value for number, value in tensor if number == 1], dict(tensor)
            if content[2] == 1 and shape:  # float32, and no scalar
                weight = np.atleast_2d(np.frombuffer(content[9], "<f4").reshape(shape))
                self._weights.append(np.pad(weight, ((0, 0), (0, -weight.shape[1] % LANES))))

    def run(
        self, candidates: NDArray[np.float32], whole: NDArray[np.float32], mask: NDArray[np.bool_]
    ) -> tuple[NDArray[Any], NDArray[Any]]:
        """Return logits (N, C), -inf outside ``mask`` (N, C), and values (N,); see ``LearnedPlanner.run``."""
        from_whole, whole_bias, from_own, encode, encode_bias, from_pooled, pooled_bias = self._weights[:7]
        from_encoded, judge, judge_bias, from_all, all_bias, value, value_bias = self._weights[7:]
        counts, first = mask.sum(axis=1), np.zeros(mask.size, np.int64)
        game = np.repeat(np.arange(len(mask)), counts)
        own = np.ascontiguousarray(candidates[mask], np.float32).reshape(len(game), len(from_own))
        whole = np.ascontiguousarray(whole, np.float32).reshape(len(mask), len(from_whole))
        context = _layer(whole, from_whole, whole_bias, first, -np.inf)
        encoded = _layer(_layer(own, from_own, context, game, 0.0), encode, encode_bias, first, 0.0)
        pooled = np.zeros((len(mask), len(from_pooled)), np.float32)
        _pool(encoded, game, pooled)
        pooled[:, : len(encode)] /= np.maximum(counts, 1)[:, None]
        context = _layer(pooled, from_pooled, pooled_bias, first, -np.inf)
        judged = _layer(_layer(encoded, from_encoded, context, game, 0.0), judge, judge_bias, first, -np.inf)
        logits = np.full(mask.shape, -np.inf)
        logits[mask] = judged[:, 0]
        hidden = _layer(np.concatenate([pooled, whole], axis=1), from_all, all_bias, first, 0.0)
        return logits, _layer(hidden, value, value_bias, first, -np.inf)[:, 0]


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


def _fields(message: bytes) -> list[tuple[int, Any]]:
    """Return number and value of each field of a message in Protocol Buffers' format: an integer or bytes."""
    return [(field.field_number, field.data) for field in UnknownFieldSet(Empty.FromString(message))]
