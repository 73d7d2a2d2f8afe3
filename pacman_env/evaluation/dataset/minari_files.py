"""Write rounds as a Minari data set: ``data/main_data.hdf5`` and its metadata.

Minari creates the storage and its metadata. Rounds are written with HDF5's own functions, because Minari's writer is
several times slower; the tests read them with Minari.
"""

import copy
import errno
import os
import shutil
from pathlib import Path
from typing import Any

import gymnasium as gym
import h5py
import minari
import numpy as np
from gymnasium.envs.registration import EnvSpec
from h5py import h5d, h5g, h5p, h5s, h5t
from minari.dataset.minari_dataset import gen_dataset_id, parse_dataset_id
from minari.dataset.minari_storage import MinariStorage
from numpy.typing import NDArray

from pacman_env.envs.base_env import as_json
from pacman_env.sim.observation.kinds import MASK

from .recording import RecordedRounds, outcomes

_ROUND_BYTES, _FILE_BYTES = 2**14, 2**21  # upper bounds of HDF5's overhead


def is_dataset_id(name: str) -> bool:
    """Return True if Minari can split a data set name into its parts and compose the same name from them."""
    try:
        return gen_dataset_id(*parse_dataset_id(name)) == name
    except ValueError:
        return False


class MinariFiles:
    """Writer of one data set, a context manager; the folder must not contain a Minari data set yet."""

    def __init__(self, folder: Path, spec: EnvSpec, spaces: tuple[Any, Any], facts: dict[str, Any]) -> None:
        """Create the storage with the spaces of observations and actions, and ``facts`` as additional metadata."""
        self._folder = folder
        self._require_room(0)
        data = folder.absolute() / "data"  # Minari joins a relative path to itself to measure the size
        self._storage = MinariStorage.new(data, *spaces, env_spec=spec, data_format="hdf5", jpeg_encoding=False)
        self._storage.update_metadata({"minari_version": minari.__version__, **facts})
        self._file = h5py.File(data / "main_data.hdf5", "w", libver="latest")
        self._types: dict[str, Any] = {}
        self._arrays, self._groups = h5p.create(h5p.DATASET_CREATE), h5p.create(h5p.GROUP_CREATE)
        for properties in (self._arrays, self._groups):
            properties.set_obj_track_times(False)  # so that the same rounds give the same bytes
        self._number = self._steps = 0

    def write(self, played: RecordedRounds) -> None:
        """Append rounds; raises OSError unless the disk has room for twice their size."""
        arrays = [*vars(played).values(), *played.observations.values()]
        size = sum(array.nbytes for array in arrays if isinstance(array, np.ndarray))
        self._require_room(2 * (size + len(played.rounds) * _ROUND_BYTES))
        steps = {
            "actions": played.actions,
            "rewards": played.rewards,
            "terminations": played.terminated,
            "truncations": played.truncated,
        }
        seen = {f"observations/{key}".rstrip("/"): array for key, array in played.observations.items()}
        if not any(key.rpartition("/")[2] == MASK for key in played.observations):
            seen[f"infos/{MASK}"] = played.masks
        words = outcomes(played.rounds)
        for number, (decisions, looks) in enumerate(played.slices()):
            group = self._group(self._file.id, f"episode_{self._number}")
            about = played.rounds[number]
            attributes = h5py.AttributeManager(h5py.Group(group))
            attributes["id"] = self._number
            attributes["total_steps"] = int(about["decisions"])
            attributes["options/round_seed"] = about["seed"]
            attributes["level"] = about["level"]
            attributes["outcome"] = words[number]
            groups = {"": group}
            for key, array in steps.items():
                self._put(group, key, array[decisions])
            for key, array in seen.items():
                self._put(self._parent(groups, key.rpartition("/")[0]), key.rpartition("/")[2], array[looks])
            self._number += 1
        self._steps += len(played.actions)

    def _require_room(self, size: int) -> None:
        """Raise OSError if the disk may become full: after a failed write, HDF5 crashes with a segmentation fault."""
        if shutil.disk_usage(self._folder).free < size + _FILE_BYTES:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self._folder))

    def _put(self, group: Any, key: str, array: NDArray[Any]) -> None:
        array = np.ascontiguousarray(array)
        kind = self._types.get(array.dtype.str)
        if kind is None:
            kind = self._types[array.dtype.str] = h5t.py_create(array.dtype, logical=True)
        space = h5s.create_simple(array.shape)
        h5d.create(group, key.encode(), kind, space, self._arrays).write(h5s.ALL, h5s.ALL, array, kind)

    def _group(self, above: Any, name: str) -> Any:
        return h5g.create(above, name.encode(), gcpl=self._groups)

    def _parent(self, groups: dict[str, Any], path: str) -> Any:
        """Return the group of this path in a round, and create it if necessary."""
        if path not in groups:
            above, _, name = path.rpartition("/")
            groups[path] = self._group(self._parent(groups, above), name)
        return groups[path]

    def __enter__(self) -> "MinariFiles":
        return self

    def __exit__(self, *_: Any) -> None:
        self._file.close()
        self._storage.update_metadata({"total_episodes": self._number, "total_steps": self._steps})
        self._storage.update_metadata({"dataset_size": float(self._storage.get_size())})


def spec_of(env_id: str, arguments: dict[str, Any]) -> EnvSpec:
    """Return Gymnasium's spec of an environment with these arguments, so that readers can create it again."""
    spec = copy.deepcopy(gym.spec(env_id))
    spec.kwargs.update(as_json(arguments))
    return spec
