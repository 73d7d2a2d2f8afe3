"""Compiled forward pass of a planner that ``pacman-env export`` wrote, in one call for all games of a batch.

Sums have a fixed order, so the results of a game do not depend on its batch.
"""

from typing import Any, NamedTuple

import numpy as np
from google.protobuf.empty_pb2 import Empty
from google.protobuf.unknown_fields import UnknownFieldSet
from numpy.typing import NDArray

from pacman_env.engine.jit import kernel
from pacman_env.engine.native import LANES, ROWS, multiply_block


class _Layer(NamedTuple):
    weight: Any  # (I, O) float32; O is a multiple of LANES
    bias: Any  # (1, O)


class _Network(NamedTuple):
    """Layers of ``EntityNetwork``; a layer with a context is split in two, and the context's half has the bias."""

    whole: _Layer
    own: Any  # (F, O)
    encode: _Layer
    pooled: _Layer
    encoded: Any  # (O, O)
    judge: _Layer
    everything: _Layer
    value: _Layer


class ForwardPass:
    """Network in an ONNX file with the content ``model``."""

    def __init__(self, model: bytes) -> None:
        graph = dict(_fields(model))[7]  # numbers of fields: see onnx.proto
        named: dict[str, NDArray[np.float32]] = {}  # a row for each input
        for tensor in (_fields(value) for number, value in _fields(graph) if number == 5):
            shape, content = [value for number, value in tensor if number == 1], dict(tensor)
            named[content[8].decode()] = np.frombuffer(content[9], "<f4").reshape(shape).T

        def layer(name: str, first: int = 0) -> _Layer:
            return _Layer(_whole_blocks(named[f"{name}.weight"][first:]), _whole_blocks(named[f"{name}.bias"]))

        own, width = len(named["shown"]), len(named["encode.bias"])
        self._network = _Network(
            layer("encode_candidate", own),
            _whole_blocks(named["encode_candidate.weight"][:own] * named["shown"][:, None]),
            layer("encode"),
            layer("judge_candidate", width),
            _whole_blocks(named["judge_candidate.weight"][:width]),
            layer("judge"),
            layer("critic.0"),
            layer("critic.2"),
        )

    def run(
        self, candidates: NDArray[np.float32], whole: NDArray[np.float32], mask: NDArray[np.bool_]
    ) -> tuple[NDArray[Any], NDArray[Any]]:
        """Return logits (N, C), -inf outside ``mask`` (N, C), and values (N,); see ``LearnedPlanner.run``.

        Raises ValueError for inputs of another width.
        """
        logits = np.full(mask.shape, -np.inf)
        network, counts = self._network, mask.sum(axis=1)
        game = np.repeat(np.arange(len(mask)), counts)
        # Kernels do not check bounds, so inputs of other widths fail here.
        own = np.ascontiguousarray(candidates[mask], np.float32).reshape(len(game), len(network.own))
        whole = np.ascontiguousarray(whole, np.float32).reshape(len(mask), len(network.whole.weight))
        judged, values = _judge(network, own, whole, game, counts)
        logits[mask] = judged[:, 0]
        return logits, values[:, 0]


@kernel
def _judge(network, own, whole, game, counts):  # type: ignore[no-untyped-def]
    """Return logits (M, O) of the candidates ``own`` (M, F), and values (N, O) of the games, both in column 0.

    ``game`` (M,) is the game of each candidate, and ``counts`` (N,) are the candidates of each game.
    """
    width, first = len(network.encoded), np.zeros(len(own) + len(whole), np.int64)
    pooled = np.zeros((len(whole), 2 * width), np.float32)
    context = _layer(whole, network.whole.weight, network.whole.bias, first, -np.inf)
    encoded = _layer(own, network.own, context, game, 0.0)
    encoded = _layer(encoded, network.encode.weight, network.encode.bias, first, 0.0)
    for k in range(len(game)):
        row = pooled[game[k]]
        for j in range(width):
            row[j] += encoded[k, j]
            row[width + j] = max(row[width + j], encoded[k, j])
    for i in range(len(whole)):
        pooled[i, :width] /= np.float32(max(counts[i], 1))
    context = _layer(pooled, network.pooled.weight, network.pooled.bias, first, -np.inf)
    judged = _layer(encoded, network.encoded, context, game, 0.0)
    logits = _layer(judged, network.judge.weight, network.judge.bias, first, -np.inf)
    everything = np.concatenate((pooled, whole), axis=1)
    hidden = _layer(everything, network.everything.weight, network.everything.bias, first, 0.0)
    return logits, _layer(hidden, network.value.weight, network.value.bias, first, -np.inf)


@kernel
def _layer(inputs, weight, start, which, least):  # type: ignore[no-untyped-def]
    """Return ``max(start[which] + inputs @ weight, least)``; inputs may have more columns than the weight has rows."""
    out = np.empty((len(inputs), weight.shape[1]), np.float32)
    for row in range(0, len(out), ROWS):
        for column in range(0, out.shape[1], LANES):
            multiply_block((inputs, weight, start, out, which), least, row, column)
    return out


def _whole_blocks(weight: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return a matrix with columns of zeros up to whole blocks; a vector becomes its only row."""
    matrix = np.ascontiguousarray(np.atleast_2d(weight))
    return np.pad(matrix, ((0, 0), (0, -matrix.shape[1] % LANES)))


def _fields(message: bytes) -> list[tuple[int, Any]]:
    """Return number and value of each field of a message in Protocol Buffers' format: an integer or bytes."""
    return [(field.field_number, field.data) for field in UnknownFieldSet(Empty.FromString(message))]
