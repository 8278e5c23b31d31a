"""A series file in other formats: JSON and CSV, for those without numpy."""

from __future__ import annotations

import csv
import io
import json
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from service.files.strict_json import without_nan
from simcore.errors import ARCHIVE_ERRORS, NeedlebenchError, Problem, ScenarioError
from simcore.rollout.table import columns_of, rows_of

if TYPE_CHECKING:
    from pathlib import Path

Arrays = dict[str, NDArray[np.generic]]


class DamagedSeriesError(NeedlebenchError):
    """A series file that was cut off or changed; says how that shows."""


def load(path: Path, names: list[str] | None = None) -> Arrays:
    """The named arrays; by default all with one row a step.

    Raises ValueError for an unknown name and DamagedSeriesError for a file that cannot be read.
    """
    try:
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            known = list(file.files)
            unknown = next((name for name in names or () if name not in known), None)
            arrays = {} if unknown is not None else {name: file[name] for name in names or known}
    except ARCHIVE_ERRORS as error:
        raise DamagedSeriesError(f"is damaged: {str(error)[:200]}") from None
    if unknown is not None:
        raise ValueError(f"there is no array {unknown!r}; there are {', '.join(known)}")
    if names is not None:
        return arrays
    if "t_s" not in arrays:
        raise DamagedSeriesError("is damaged: the times of its steps are missing")
    return rows_of(arrays)


def as_json(arrays: Arrays) -> str:
    """{name: nested lists}; numbers that are not finite become null."""
    return json.dumps({name: without_nan(array.tolist()) for name, array in arrays.items()}, allow_nan=False)


def as_csv(arrays: Arrays) -> str:
    """One line a row, one column a component: tip_m_x, tip_m_y, tip_m_z, base_rotation_w, ...

    Raises ValueError for arrays that do not have the same number of rows.
    """
    columns = columns_of(arrays)
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(columns)
    writer.writerows(zip(*(column.tolist() for column in columns.values()), strict=True))
    return text.getvalue()


def write_parquet(arrays: Arrays, path: Path) -> None:
    """The same table as a Parquet file. Raises ValueError as `as_csv` does, and ScenarioError without pyarrow."""
    columns = columns_of(arrays)
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        problem = "needs pyarrow, which comes with recordings: pip install pyarrow"
        raise ScenarioError([Problem("--to", "parquet", problem)]) from None
    parquet.write_table(pyarrow.table(columns), path)
