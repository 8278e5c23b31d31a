"""A data set of insertions that have ended already, instead of new ones; as a NumPy archive or a Parquet table."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.cases import Outcome
from benchmarks.learning.training import TRAINED_ON
from service.local.verify import CannotVerifyError, load_series
from simcore.errors import Problem, ScenarioError
from simcore.provenance import machine
from simcore.rollout.artefacts import replace_atomically
from simcore.rollout.dataset import Dataset, DatasetError, Table, gathered, table_one
from simcore.rollout.table import columns_of

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from service.local.insertion_sets import InsertionSet

FORMAT = b"needlebench/dataset-table/1"


class Gathered(NamedTuple):
    """A data set, the insertions that are in it, and what its user should know."""

    data: Dataset
    outcomes: list[Outcome]
    notes: list[str]


def dataset_of(source: InsertionSet, *, arms: Sequence[str], samples: int, seed: int) -> Gathered:
    """The steps of all insertions, or of those of some arms (as the labels of their cases call them), that left all of
    the data set's variables. Raises ScenarioError for an unknown arm, DatasetError where nothing is left."""
    chosen = [one for one in source.outcomes if not arms or str(one.case.labels.get("arm")) in arms]
    known = sorted({str(one.case.labels.get("arm")) for one in source.outcomes})
    if unknown := [arm for arm in arms if arm not in known]:
        raise ScenarioError([Problem("--arm", unknown[0], f"is none of {', '.join(known)}")])
    used, tables, targets, left_out = list[Outcome](), list[Table](), list[NDArray[Any]](), list[str]()
    for outcome in chosen:
        found = _table(source, outcome)
        if found is None:
            left_out.append(outcome.case.id)
            continue
        used.append(outcome)
        tables.append(found[0])
        targets.append(found[1])
    if not used:
        raise DatasetError(f"none of {len(chosen)} insertions left a series with all variables of the data set")
    ends = np.array([target[-1] for target in targets])
    provenance = _provenance(used, np.concatenate(targets), source.suite, seed)
    data = gathered(tables, ends, samples=samples, seed=seed, provenance=provenance)
    return Gathered(data, used, _notes(used, left_out))


def _table(source: InsertionSet, outcome: Outcome) -> tuple[Table, NDArray[Any]] | None:
    """Table I of an insertion and its targets, (steps, 3) m; None where its series does not have all of it."""
    file = source.series_file(outcome.case.id)
    try:
        series = None if file is None else load_series(file)
        if series is None:
            return None
        table = table_one(series)
    except (CannotVerifyError, KeyError):
        return None
    finite = all(np.isfinite(array).all() for array in table.values())
    targets = np.asarray(series["target_m"], float)
    return (table, targets) if finite and len(table["tip_m"]) and np.isfinite(targets).all() else None


def _provenance(used: Sequence[Outcome], targets_m: NDArray[Any], suite: str, seed: int) -> dict[str, Any]:
    box = 1e3 * np.array([targets_m.min(axis=0), targets_m.max(axis=0)])
    return {
        **machine(),
        "seed": seed,
        "suite": suite,
        "scenario_template": used[0].case.scenario,
        "path_box_mm": box.round(6).tolist(),
        "insertions": [
            {
                "id": one.case.id,
                "arm": one.case.labels.get("arm"),
                "seed": one.case.scenario["seed"],
                "status": one.result["status"],
                "digest": one.result["digest"],
                "commit": (one.result.get("provenance") or {}).get("commit"),
            }
            for one in used
        ],
    }


def _notes(used: Sequence[Outcome], left_out: Sequence[str]) -> list[str]:
    notes = []
    if left_out:
        first = ", ".join(left_out[:3])
        notes.append(f"{len(left_out)} insertions left no series with all variables, and are not in it: {first}")
    differing = [
        name
        for name in (*TRAINED_ON, "controller")
        if len({json.dumps(one.case.scenario.get(name), sort_keys=True) for one in used}) > 1
    ]
    if differing:
        notes.append(
            f"the insertions differ in {', '.join(differing)}; what a model is said to be trained on is that of "
            f"{used[0].case.id}"
        )
    return notes


def save_parquet(found: Gathered, path: Path) -> None:
    """A row a step: insertion, arm, step, the variables by component, and on which side of each split it is; where it
    all comes from is in the file's metadata. Raises ScenarioError without pyarrow."""
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        problem = "needs pyarrow, which comes with recordings: pip install pyarrow"
        raise ScenarioError([Problem("--format", "parquet", problem)]) from None
    data = found.data
    ids = np.array([one.case.id for one in found.outcomes])
    arms = np.array([str(one.case.labels.get("arm", "")) for one in found.outcomes])
    rows = len(data.trajectory)

    def marked(numbers: NDArray[Any]) -> NDArray[Any]:
        marks = np.zeros(rows, bool)
        marks[numbers] = True
        return marks

    table = pyarrow.table(
        {
            "insertion": ids[data.trajectory],
            "arm": arms[data.trajectory],
            "step": data.step,
            **columns_of(data.variables),
            "drawn": marked(data.drawn),
            "test_by_sample": marked(data.by_sample.test),
            "test_by_trajectory": marked(data.by_trajectory.test),
        }
    )
    origin = json.dumps(data.provenance, allow_nan=False).encode()
    table = table.replace_schema_metadata({b"format": FORMAT, b"provenance": origin})
    replace_atomically(path, lambda file: parquet.write_table(table, file))
