"""Training of a learned controller's model from a data set, with its errors on both sides of the split."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from simcore.learning import Regressor, TrainedModel
from simcore.learning.regressor import DataError

if TYPE_CHECKING:
    from simcore.rollout.dataset import Dataset, Split

Vector = NDArray[np.float64]

SPLITS = ("sample", "trajectory")
TRAINED_ON = ("dt_s", "tissue", "needle", "interaction", "motion", "robot", "solver")


@dataclass(frozen=True)
class Training:
    """A model and its root mean square errors of Delta P per axis, (3,) mm."""

    model: TrainedModel
    train_rmse_mm: Vector
    test_rmse_mm: Vector


def split_of(data: Dataset, name: str) -> Split:
    """`sample` [paper] or `trajectory`. Raises DataError when one side is empty."""
    split = data.by_sample if name == "sample" else data.by_trajectory
    if not split.train.size or not split.test.size:
        sides = f"{split.train.size} rows to learn from and {split.test.size} to test"
        raise DataError(f"the split by {name} leaves {sides}: the data set is too small")
    return split


def train_model(
    data: Dataset, regressor: Regressor, *, split: str, samples: int | None = None, data_sha256: str | None = None
) -> Training:
    """Fit on the training side of the split, on its `samples` first rows of a draw by the data set's seed if fewer.

    data_sha256: of the data set's file, for the model's provenance. Raises DataError.
    """
    rows = split_of(data, split)
    learned = rows.train
    if samples is not None and samples < len(learned):
        learned = np.sort(np.random.default_rng([data.seed, 3]).permutation(learned)[:samples])
    regressor.fit(data.inputs(learned), data.outputs(learned))
    train, test = (_rmse_mm(regressor, data, side) for side in (learned, rows.test))
    origin = data.provenance
    template = origin["scenario_template"]
    provenance: dict[str, Any] = {
        "inputs": ["base_position_m", "tip_error_m"],
        "outputs": ["base_step_m"],
        "data_sha256": data_sha256,
        "data_seed": data.seed,
        "data_commit": origin.get("commit"),
        "data_versions": origin.get("versions"),
        "insertions": len(data.end_point_m),
        "split": split,
        "train_rows": len(learned),
        "test_rows": len(rows.test),
        "train_rmse_mm": train.tolist(),
        "test_rmse_mm": test.tolist(),
        "trained_on": {
            **{name: template[name] for name in TRAINED_ON},
            "trajectory": {k: v for k, v in template["trajectory"].items() if k != "target_mm"},
            "noise_mm": template["noise_mm"],
            "controller": template["controller"],
            "path_box_mm": origin["path_box_mm"],
        },
    }
    return Training(TrainedModel(regressor, provenance), train, test)


def _rmse_mm(regressor: Regressor, data: Dataset, rows: NDArray[np.int64]) -> Vector:
    error = regressor.predict(data.inputs(rows)) - data.outputs(rows)
    rmse: Vector = 1e3 * np.sqrt(np.mean(error**2, axis=0))
    return rmse
