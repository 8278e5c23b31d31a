"""The series of a run as a table: one row a step, one column a component."""

from __future__ import annotations

import math
from itertools import product
from typing import TYPE_CHECKING

from simcore.metric_definitions import SERIES

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import numpy as np
    from numpy.typing import NDArray

_BY_STEP = frozenset(array.name for array in SERIES if array.shape[0] == "rows")


def rows_of(series: Mapping[str, NDArray[np.generic]]) -> dict[str, NDArray[np.generic]]:
    """The arrays that have one row a step, as `metric_definitions.SERIES` says; not those that have as many by chance,
    such as the frames of a run in which each step is one."""
    return {name: array for name, array in series.items() if name in _BY_STEP}


def columns_of(arrays: Mapping[str, NDArray[np.generic]]) -> dict[str, NDArray[np.generic]]:
    """tip_m_x, tip_m_y, tip_m_z, base_rotation_w, rcm_authority_x_y, ...: each (rows,).

    Raises ValueError for arrays that do not have the same number of rows.
    """
    if len({len(array) for array in arrays.values()}) > 1:
        raise ValueError("the arrays of one table must have the same number of rows")
    columns: dict[str, NDArray[np.generic]] = {}
    for name, array in arrays.items():
        parts = product(*(_components(name, size) for size in array.shape[1:]))
        flat = array.reshape(len(array), math.prod(array.shape[1:]))
        columns |= {"_".join((name, *part)): column for part, column in zip(parts, flat.T, strict=True)}
    return columns


def _components(name: str, size: int) -> Sequence[str]:
    """Of one axis of an array: quaternions are wxyz, pairs and triples of numbers those of axes."""
    if size == 4 and name.endswith("rotation"):
        return "wxyz"
    return "xyz"[:size] if size in (2, 3) else [str(number) for number in range(size)]
