"""One Parquet table of a campaign: a row an insertion, with its processor, its BLAS kernels and its warnings."""

from __future__ import annotations

import json
from itertools import islice
from typing import TYPE_CHECKING, Any

from service.local.campaign_folder import TABLE, read_about, stored_lines
from simcore.errors import Problem, ScenarioError
from simcore.rollout.artefacts import replace_atomically

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

FORMAT = b"needlebench/campaign-table/1"
_ROWS = 5000  # at once in memory
_MACHINE = ("cpu", "blas_core", "blas_version", "llvm_cpu", "platform", "commit")
_GROUPS = {"metrics": "", "timing": "timing_", "solver": "solver_", "cost": "cost_"}


def row_of(line: Mapping[str, Any]) -> dict[str, Any]:
    """The cells of an insertion: case, labels, how it ended, measures, cost, machine, warnings, scenario as JSON."""
    result = line["result"]
    source = result.get("provenance") or {}
    row: dict[str, Any] = {"case": line["id"]}
    row |= {f"label_{name}": str(value) for name, value in line["labels"].items()}
    row |= {"status": result["status"], "message": result.get("message") or None, "digest": result.get("digest")}
    for group, prefix in _GROUPS.items():
        row |= {f"{prefix}{name}": value for name, value in (result.get(group) or {}).items() if _plain(value)}
    row |= {name: source.get(name) for name in _MACHINE}
    row["warnings"] = list(result.get("warnings") or ())
    row["series_sha256"] = line["series_sha256"]
    row["scenario"] = json.dumps(source.get("scenario"), sort_keys=True)
    return row


def _plain(value: Any) -> bool:
    return value is None or isinstance(value, bool | int | float | str)


def write_table(folder: Path) -> Path:
    """Write the table of a campaign's folder, whatever has ended. Raises ScenarioError without pyarrow."""
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        problem = "needs pyarrow, which comes with recordings: pip install pyarrow"
        raise ScenarioError([Problem("--out", str(folder), problem)]) from None
    types: dict[str, type] = {}
    for row in _rows(folder):
        for name, value in row.items():
            types[name] = _wider(types.get(name), value)
    arrow = {
        bool: pyarrow.bool_(),
        int: pyarrow.int64(),
        float: pyarrow.float64(),
        str: pyarrow.string(),
        list: pyarrow.list_(pyarrow.string()),
        type(None): pyarrow.float64(),
    }
    schema = pyarrow.schema(
        [(name, arrow[kind]) for name, kind in types.items()],
        metadata={b"format": FORMAT, b"campaign": json.dumps(read_about(folder), allow_nan=False).encode()},
    )

    def fill(file: Any) -> None:
        with parquet.ParquetWriter(file, schema, compression="zstd") as writer:
            rows = _rows(folder)
            while some := list(islice(rows, _ROWS)):
                writer.write_table(pyarrow.Table.from_pylist([_cast(row, types) for row in some], schema=schema))

    replace_atomically(folder / TABLE, fill)
    return folder / TABLE


def _rows(folder: Path) -> Iterator[dict[str, Any]]:
    return map(row_of, stored_lines(folder))


def _wider(known: type | None, value: Any) -> type:
    """The type of a column that has held `known` and now holds a value."""
    kind = type(value)
    if known in (None, type(None)):
        return kind
    if value is None or kind is known:
        return known
    return float if {known, kind} <= {int, float} else str


def _cast(row: dict[str, Any], types: Mapping[str, type]) -> dict[str, Any]:
    return {
        name: None if row.get(name) is None else row[name] if kind is list else kind(row[name])
        for name, kind in types.items()
        if kind is not type(None)
    }
