"""The arrays of a situation are those that its fields declare."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from typing_extensions import TypeAliasType

from pacman_env.sim.observation.situation import SituationArrays, _scalar

T = TypeVar("T", bound=np.generic)
#: As NumPy 2.5 has it.
NewerNDArray = TypeAliasType("NewerNDArray", np.ndarray[Any, np.dtype[T]], type_params=(T,))


def test_the_scalar_type_is_read_from_the_alias_of_any_numpy() -> None:
    assert _scalar(NDArray[np.float64]) is np.float64
    assert _scalar(NewerNDArray[np.int32]) is np.int32


def test_arrays_have_the_declared_types_and_axes() -> None:
    declared = SituationArrays._field_defaults
    assert (declared["robot"].dtype, declared["robot"].shape) == (np.float64, "N 3")
    assert (declared["mask"].dtype, declared["mask"].shape) == (np.bool_, "N C")
    assert (declared["goal"].dtype, declared["goal"].shape) == (np.int32, "N C")
