"""Write rounds as two Parquet tables: ``decisions.parquet`` with a row per decision, ``rounds.parquet`` per round.

Numbers are columns. Arrays are flattened to lists of a fixed size; the columns' metadata contains their shapes.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from pacman_env.sim.observation.kinds import MASK

from .recording import RecordedRounds, outcomes

DECISIONS, ROUNDS = "decisions.parquet", "rounds.parquet"


class Tables:
    """Writer of both tables, a context manager."""

    def __init__(self, folder: Path, facts: dict[str, Any]) -> None:
        """Write ``facts`` as JSON to the schemas' metadata, under the key ``pacman_env``."""
        self._folder, self._metadata = folder, {"pacman_env": json.dumps(facts)}
        self._writers: dict[str, pq.ParquetWriter] = {}
        self._number = 0

    def write(self, played: RecordedRounds) -> None:
        """Append rounds as a row group."""
        rounds, count = played.rounds, len(played.rounds)
        numbers = self._number + np.arange(count)
        decisions = rounds["decisions"]
        step = np.arange(decisions.sum()) - np.repeat(np.cumsum(decisions) - decisions, decisions)
        looks = np.ones(len(played.masks), dtype=np.bool_)
        last = np.cumsum(decisions + 1) - 1
        looks[last] = False
        seen = {_column(key): array for key, array in played.observations.items() if not key.endswith(MASK)}
        self._append(
            DECISIONS,
            {
                "round": np.repeat(numbers, decisions),
                "step": step,
                **{key: array[looks] for key, array in seen.items()},
                MASK: played.masks[looks].astype(np.bool_),
                "action": played.actions,
                "reward": played.rewards,
                "terminated": played.terminated,
                "truncated": played.truncated,
                "elapsed_s": played.elapsed_s,
            },
        )
        self._append(
            ROUNDS,
            {
                "round": numbers,
                **{name: rounds[name] for name in rounds.dtype.names or () if name != "outcome"},
                "outcome": np.array(outcomes(rounds)),
                **{f"last_{key}": array[last] for key, array in seen.items()},
            },
        )
        self._number += count

    def _append(self, name: str, columns: dict[str, NDArray[Any]]) -> None:
        arrays = [_list(array) for array in columns.values()]
        shapes = [{"shape": json.dumps(array.shape[1:])} if array.ndim > 1 else None for array in columns.values()]
        fields = [
            pa.field(key, array.type, nullable=False, metadata=shape)
            for key, array, shape in zip(columns, arrays, shapes, strict=True)
        ]
        schema = pa.schema(fields, metadata=self._metadata)
        if name not in self._writers:
            self._writers[name] = pq.ParquetWriter(self._folder / name, schema, compression="zstd")
        self._writers[name].write_table(pa.Table.from_arrays(arrays, schema=schema))

    def __enter__(self) -> "Tables":
        return self

    def __exit__(self, *_: Any) -> None:
        for writer in self._writers.values():
            writer.close()


def _column(key: str) -> str:
    """Return the column name of a part of an observation."""
    return f"observation.{key.removeprefix('observation/').replace('/', '.')}" if key else "observation"


def _list(array: NDArray[Any]) -> pa.Array:
    """Convert an array (R, ...) to R rows."""
    if array.ndim == 1:
        return pa.array(array)
    values = pa.array(np.ascontiguousarray(array).reshape(-1))
    return pa.FixedSizeListArray.from_arrays(values, int(np.prod(array.shape[1:])))
