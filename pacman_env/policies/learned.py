"""Learned planner as a policy: the network of an ONNX file, applied to the planner features.

The built-in planner has a compiled forward pass. onnxruntime runs other files, and is imported for the first one.
"""

import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacman_env.config.validation import located
from pacman_env.observations.planner_features import CANDIDATE_FEATURES, GLOBAL_FEATURES, planner_features
from pacman_env.observations.situation import Situation
from pacman_env.policies.base import BasePolicy, Explanation
from pacman_env.policies.forward_pass import ForwardPass
from pacman_env.policies.metadata import PlannerMetadata, read_planner
from pacman_env.policies.policy_calls import PolicyError

#: Planner in the package.
PRETRAINED = Path(__file__).parent / "pretrained" / "ppo.onnx"
_FORBIDDEN = -1e7  # logits below this mark forbidden candidates
#: Features in explanations, in the units of ``observations/planner_features.py``.
_SHOWN = ("path_robot", "path_clyde", "time_margin", "caught_soon", "caught", "approached", "closest_mean")
_Nodes = dict[str, tuple[str, tuple[int | None, ...]]]  # by name: type and sizes (None: any)
_OUTPUTS: _Nodes = {"logits": ("tensor(float)", (None, None)), "values": ("tensor(float)", (None,))}


class OnnxPolicy(BasePolicy):
    """A policy whose network is an ONNX file; pickles and copies include the model."""

    path: Path
    _session: Any

    def _open(self) -> None:
        """Create ``_session``, which computes the network."""
        raise NotImplementedError

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_session": None}  # a copy creates its own session

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the policy, whose file may lie in another folder on this machine."""
        self.__dict__.update(state)
        self._open()


class LearnedPlanner(OnnxPolicy):
    """Chooses the candidate with the highest logit of a trained network.

    ``path`` is an ONNX file next to its metadata (None: the built-in planner); onnxruntime uses ``threads`` threads.
    """

    def __init__(self, path: str | os.PathLike[str] | None = None, threads: int = 1) -> None:
        if threads < 1:
            raise ValueError(f"threads = {threads}: must be at least 1")
        if path is None and not PRETRAINED.is_file():
            raise ValueError(f"policy 'ppo': {PRETRAINED} is missing, name an ONNX file of your own instead")
        self.path = PRETRAINED if path is None else Path(path).absolute()
        self.name = self.path.stem
        self.metadata, self._model = read_planner(self.path)
        self._threads = threads
        self._is_compiled = self.path == PRETRAINED and not self.metadata.dropped_kinds
        self._columns = _columns(self.metadata.candidate_features, CANDIDATE_FEATURES)
        self._whole_columns = _columns(self.metadata.global_features, GLOBAL_FEATURES)
        self._open()

    def _open(self) -> None:
        if self._is_compiled:
            self._session = ForwardPass(self._model)
        else:
            self._session = _session(self.path, self.metadata, self._model, self._threads)

    def scores(self, situation: Situation) -> NDArray[np.float64]:
        """Return logits (N, C), -inf for forbidden candidates; raises ValueError if the situation has no maps."""
        return self._judge(situation)[0]

    def explain(self, situation: Situation) -> Explanation:
        """Return logit, probability, features and the situation's value for each allowed candidate."""
        logits, values, candidates = self._judge(situation)
        best = logits.max(axis=1, keepdims=True, initial=-1e30)  # finite even if no candidate is allowed
        odds = np.exp(logits - best)
        probability = odds / np.maximum(odds.sum(axis=1, keepdims=True), 1.0)
        columns = {name: CANDIDATE_FEATURES.index(name) for name in _SHOWN if name in CANDIDATE_FEATURES}
        reasons = super().explain(situation)
        for i, c in np.argwhere(situation.mask).tolist():
            reasons[i][c]["probability"] = float(probability[i, c])
            reasons[i][c]["value"] = float(values[i])
            reasons[i][c].update({name: float(candidates[i, c, column]) for name, column in columns.items()})
        return reasons

    def run(
        self, candidates: NDArray[np.float32], whole: NDArray[np.float32], mask: NDArray[np.bool_]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Run the network and return logits (B, C), at most -1e8 outside ``mask`` (B, C), and values (B,).

        ``candidates`` (B, C, F) and ``whole`` (B, H) are results of ``planner_features``. Raises PolicyError if the
        network does not run or returns another shape.
        """
        try:
            own, context = candidates[..., self._columns], whole[:, self._whole_columns]
            if self._is_compiled:
                return self._session.run(own, context, mask)
            inputs = {"candidates": own, "globals": context, "mask": mask}
            logits, values = self._session.run(list(_OUTPUTS), inputs)
        except Exception as error:  # onnxruntime's errors have no common base class
            raise PolicyError(f"policy {self.name!r}: {self.path} does not run: {error}") from None
        if (logits.shape, values.shape) != (mask.shape, mask.shape[:1]):
            found, expected = (logits.shape, values.shape), (mask.shape, mask.shape[:1])
            raise PolicyError(f"policy {self.name!r}: {self.path}: outputs: found {found}, expected {expected}")
        return logits, values

    def _judge(self, situation: Situation) -> tuple[NDArray[Any], NDArray[Any], NDArray[np.float32]]:
        """Return logits (N, C), values (N,) and the candidates' features (N, C, F).

        In onnxruntime, each game runs alone with its allowed candidates, because sums over other shapes round
        differently, and a game must not depend on its batch.
        """
        if situation.maps is None:
            raise ValueError(f"policy {self.name!r}: the situation has no maps to look ahead on")
        candidates, whole = planner_features(situation, self.metadata.robot_speed_mps)
        if self._is_compiled:
            return *self.run(candidates, whole, situation.mask), candidates
        logits = np.full(situation.mask.shape, -np.inf)
        values = np.full(len(logits), np.nan)
        for i, mask in enumerate(situation.mask):
            allowed = mask.nonzero()[0]
            if allowed.size:
                found, value = self.run(candidates[None, i, allowed], whole[None, i], mask[None, allowed])
                logits[i, allowed] = np.where(found[0] <= _FORBIDDEN, -np.inf, found[0])  # NaN stays
                values[i] = value[0]
        return logits, values, candidates


def _columns(names: tuple[str, ...], known: tuple[str, ...]) -> Any:
    """Return an index of a network's columns ``names`` among all columns ``known``, of which some may be newer."""
    return slice(None) if names == known else [known.index(name) for name in names]


def open_session(path: Path, model: bytes, threads: int) -> Any:
    """Create an onnxruntime session of a model, the content of ``path``; raises ValueError if it cannot be loaded."""
    try:
        import onnxruntime
    except ModuleNotFoundError:
        needed = "a learned planner needs onnxruntime: pip install onnxruntime"
        raise ModuleNotFoundError(f"{path}: {needed}", name="onnxruntime") from None
    if b"location" in model:  # key of the file name of external data, in every encoding
        raise ValueError(f"{path}: weights: found external data (a key 'location'), expected all in one file")
    onnxruntime.disable_telemetry_events()
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads, options.inter_op_num_threads = threads, 1
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.enable_cpu_mem_arena = False  # a decision needs kilobytes
    options.log_severity_level = 4  # errors are raised anyway
    # onnxruntime's errors have no common base class
    with located(f"{path}: no model that onnxruntime can load", ValueError, Exception):
        return onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])


def _session(path: Path, metadata: PlannerMetadata, model: bytes, threads: int) -> Any:
    """Create a session of a model with the inputs that its metadata names, and test it once."""
    session = open_session(path, model, threads)
    features, whole = len(metadata.candidate_features), len(metadata.global_features)
    inputs: _Nodes = {
        "candidates": ("tensor(float)", (None, None, features)),
        "globals": ("tensor(float)", (None, whole)),
        "mask": ("tensor(bool)", (None, None)),
    }
    for what, expected in {"inputs": inputs, "outputs": _OUTPUTS}.items():
        nodes = session.get_inputs() if what == "inputs" else session.get_outputs()
        found = {n.name: (n.type, tuple(s if isinstance(s, int) else None for s in n.shape)) for n in nodes}
        if found != expected:
            raise ValueError(f"{path}: {what}: found {found}, expected {expected}")
    zeros = {
        "candidates": np.zeros((1, 3, features), np.float32),
        "globals": np.zeros((1, whole), np.float32),
        "mask": np.ones((1, 3), np.bool_),
    }
    with located(f"{path}: the model does not run", ValueError, Exception):
        outputs = session.run(list(_OUTPUTS), zeros)
    shapes = [output.shape for output in outputs]
    if shapes != [(1, 3), (1,)] or not all(np.isfinite(output).all() for output in outputs):
        raise ValueError(f"{path}: outputs: found {shapes}, expected {[(1, 3), (1,)]} and finite")
    return session
