"""The insertions of the paper's data set: straight I-FEM insertions to a regular grid, with target noise."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.cases import Case
from simcore.provenance import provenance
from simcore.rollout.dataset import Dataset, DatasetError, Table, gathered
from simcore.scenario.scenario import Scenario

Vector = NDArray[np.float64]

GRID = (7, 15)  # [paper: 105 regular targets; the factorisation is ours]
FACE_MM = (36.0, 62.0)
DEPTH_MM = 122.0  # [paper]
ENTRY_MM = (18.0, 31.0, 0.0)  # [ours]
NOISE_MM = 0.25  # [paper]


@dataclass(frozen=True)
class Insertion:
    """One insertion as it was run: its table I, how it ended, the digest of its state series."""

    case: Case
    table: Table
    status: str
    digest: str


RunInsertions = Callable[[Sequence[Case]], Iterable[Insertion]]  # in any order


def grid_mm() -> Vector:
    """(105, 3) mm: the cell centres of the face z = 122 mm, x slowest."""
    x, y = ((np.arange(n) + 0.5) * edge / n for n, edge in zip(GRID, FACE_MM, strict=True))
    return np.array([(a, b, DEPTH_MM) for a in x for b in y])


def training_insertions(*, insertions: int, seed: int, changes: dict[str, Any] | None = None) -> tuple[Case, ...]:
    """The insertions to `insertions` grid points, spread over the grid; each has a seed of its own for its noise.

    changes: fields of the scenario that differ from its defaults. Raises DatasetError for a number that cannot be.
    """
    grid = grid_mm()
    if not 2 <= insertions <= len(grid):
        raise DatasetError(f"insertions = {insertions}: must be 2 to {len(grid)}")
    chosen = np.unique(np.linspace(0, len(grid) - 1, insertions).round().astype(int))
    return tuple(_case(int(k), grid[k], seed, changes or {}) for k in chosen)


def _case(number: int, end_mm: Vector, seed: int, changes: dict[str, Any]) -> Case:
    path = {"entry_mm": ENTRY_MM, **changes.get("trajectory", {}), "kind": "line", "target_mm": end_mm.tolist()}
    scenario = Scenario.load(
        {
            "name": f"data {number:03d}",
            "seed": 1000 * seed + number,
            "noise_mm": NOISE_MM,
            "recording": {"enabled": False},
            **changes,
            "trajectory": path,
        }
    )
    arm = scenario.controller.kind
    labels = {"group": "DATA", "arm": arm, "young": "constant", "noise": "on", "end_point": number, "direction": ""}
    return Case(f"DATA-{number:03d}", scenario.resolved(), {**labels})


def collect_dataset(chosen: Sequence[Case], run: RunInsertions, *, samples: int, seed: int) -> Dataset:
    """Run the insertions and gather their steps, in the order of the cases, whichever is finished first.

    An insertion that ended in a named failure gives the steps before it. Raises DatasetError without any step.
    """
    done = {insertion.case.id: insertion for insertion in run(chosen)}
    missing = [case.id for case in chosen if case.id not in done]
    if missing:
        raise DatasetError(f"{len(missing)} insertions were not run, the first is {missing[0]}")
    ordered = [done[case.id] for case in chosen]
    end_points = 1e-3 * np.array([case.scenario["trajectory"]["target_mm"] for case in chosen])
    origin = provenance(chosen[0].scenario)
    template = origin.pop("scenario")
    origin |= {
        "seed": seed,
        "scenario_template": template,
        "path_box_mm": [[0.0, 0.0, 0.0], [*FACE_MM, DEPTH_MM]],  # the cells of the grid, not only their centres
        "insertions": [
            {
                "id": insertion.case.id,
                "target_mm": insertion.case.scenario["trajectory"]["target_mm"],
                "seed": insertion.case.scenario["seed"],
                "status": insertion.status,
                "digest": insertion.digest,
            }
            for insertion in ordered
        ],
    }
    return gathered([i.table for i in ordered], end_points, samples=samples, seed=seed, provenance=origin)
