"""A series file in other formats: JSON and CSV, for those without numpy."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from service.files.strict_json import without_nan

Arrays = dict[str, NDArray[np.generic]]
_AXES = {3: ("x", "y", "z"), 4: ("w", "x", "y", "z")}


def load(path: Path, names: list[str] | None = None) -> Arrays:
    """The named arrays; by default all with one row a step. Raises ValueError for an unknown name."""
    with np.load(path, allow_pickle=False) as file:
        if names is None:
            rows = len(file["t_s"])
            found = {name: file[name] for name in file.files}
            return {name: array for name, array in found.items() if array.ndim in (1, 2) and len(array) == rows}
        for name in names:
            if name not in file.files:
                raise ValueError(f"there is no array {name!r}; there are {', '.join(file.files)}")
        return {name: file[name] for name in names}


def as_json(arrays: Arrays) -> str:
    """{name: nested lists}; numbers that are not finite become null."""
    return json.dumps({name: without_nan(array.tolist()) for name, array in arrays.items()}, allow_nan=False)


def as_csv(arrays: Arrays) -> str:
    """One line a row, one column a component: tip_m_x, tip_m_y, tip_m_z, base_rotation_w, ...

    Raises ValueError for arrays that do not have the same number of rows.
    """
    if len({len(array) for array in arrays.values()}) > 1:
        raise ValueError("the arrays of one CSV must have the same number of rows")
    header: list[str] = []
    columns: list[list[object]] = []
    for name, array in arrays.items():
        flat = array.reshape(len(array), -1)
        width = flat.shape[1]
        parts = _AXES.get(width, tuple(str(i) for i in range(width)))
        header += [name] if array.ndim == 1 else [f"{name}_{part}" for part in parts]
        columns += [column.tolist() for column in flat.T]
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(header)
    writer.writerows(zip(*columns, strict=True))
    return text.getvalue()
