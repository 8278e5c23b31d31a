"""The series of a run as a table: one row a step, one column a component."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np
    from numpy.typing import NDArray

_AXES = {3: ("x", "y", "z"), 4: ("w", "x", "y", "z")}


def rows_of(series: Mapping[str, NDArray[np.generic]]) -> dict[str, NDArray[np.generic]]:
    """The arrays that have one row a step, of numbers or of vectors. Raises KeyError without `t_s`."""
    rows = len(series["t_s"])
    return {name: array for name, array in series.items() if array.ndim in (1, 2) and len(array) == rows}


def columns_of(arrays: Mapping[str, NDArray[np.generic]]) -> dict[str, NDArray[np.generic]]:
    """tip_m_x, tip_m_y, tip_m_z, base_rotation_w, ...: each (rows,).

    Raises ValueError for arrays that do not have the same number of rows.
    """
    if len({len(array) for array in arrays.values()}) > 1:
        raise ValueError("the arrays of one table must have the same number of rows")
    columns: dict[str, NDArray[np.generic]] = {}
    for name, array in arrays.items():
        if array.ndim == 1:
            columns[name] = array
            continue
        flat = array.reshape(len(array), -1)
        parts = _AXES.get(flat.shape[1], tuple(str(i) for i in range(flat.shape[1])))
        columns |= {f"{name}_{part}": flat[:, i] for i, part in enumerate(parts)}
    return columns
