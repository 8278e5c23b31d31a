"""Learning curves: how well the ELM predicts Delta P, over hidden nodes, samples and random input weights."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Indices = NDArray[np.int64]

TEST_SHARE = 0.1  # [paper] 90 / 10
SPLITS = ("sample", "trajectory")  # by trajectory no neighbour of a test sample is trained on
DRAW_SEED, SPLIT_SEED = 105, 90


class Predictor(Protocol):
    """A regressor that has been fitted."""

    def predict(self, X: Vector) -> Vector: ...


Fit = Callable[[int, int, Vector, Vector], Predictor]  # (nodes, seed, X (n, 6) m, Y (n, 3) m)


@dataclass(frozen=True)
class LearningPoint:
    """One training. Errors: root mean square of |Delta P - prediction|, mm."""

    curve: str  # "nodes", "samples" or "seeds": what was varied
    split: str  # "sample" or "trajectory"
    nodes: int
    samples: int  # drawn, 90 % of them for training
    seed: int
    train_rmse_mm: float
    test_rmse_mm: float


@dataclass(frozen=True)
class LearningCurves:
    """All trainings, and what not learning would give: the errors' scale.

    spread_mm: root mean square distance of Delta P from its mean, mm.
    """

    points: tuple[LearningPoint, ...]
    spread_mm: float
    nodes: int  # of the controller
    samples: int
    seeds: int

    def of(self, curve: str, split: str) -> list[LearningPoint]:
        """The trainings of one curve."""
        return [point for point in self.points if (point.curve, point.split) == (curve, split)]


@dataclass(frozen=True)
class Samples:
    """The data set: X (n, 6) m = (P, e~_p), Y (n, 3) m = Delta P, trajectory (n,) = number of the insertion."""

    X: Vector
    Y: Vector
    trajectory: Indices


def learning_curves(
    data: Samples, fit: Fit, *, nodes: int, samples: int, node_counts: Sequence[int], sample_counts: Sequence[int], seeds: int
) -> LearningCurves:
    """Fit for every node count, sample count and seed, both splits.

    Sample counts above what there is are taken as all there is, once.
    """
    samples = min(samples, len(data.X))
    counts = sorted({min(count, len(data.X)) for count in sample_counts})
    plan = [
        *(("nodes", count, samples, seed) for count in node_counts for seed in range(min(seeds, 5))),
        *(("samples", nodes, count, seed) for count in counts for seed in range(min(seeds, 5))),
        *(("seeds", nodes, samples, seed) for seed in range(seeds)),
    ]
    points = tuple(_point(data, fit, split, *entry) for split in SPLITS for entry in plan)
    spread = 1e3 * float(np.sqrt(np.mean(np.sum((data.Y - data.Y.mean(axis=0)) ** 2, axis=1))))
    return LearningCurves(points, spread, nodes, samples, seeds)


def _point(data: Samples, fit: Fit, split: str, curve: str, nodes: int, samples: int, seed: int) -> LearningPoint:
    train, test = split_indices(data, samples, split)
    model = fit(nodes, seed, data.X[train], data.Y[train])
    errors = (prediction_rmse_mm(model, data.X[part], data.Y[part]) for part in (train, test))
    return LearningPoint(curve, split, nodes, samples, seed, *errors)


def drawn(count: int, samples: int) -> Indices:
    """Which of `count` rows are drawn; smaller draws are within larger ones."""
    return np.random.default_rng(DRAW_SEED).permutation(count)[:samples].astype(np.int64)


def split_indices(data: Samples, samples: int, split: str) -> tuple[Indices, Indices]:
    """Rows for training and for testing, disjoint, about 90 / 10; with split "trajectory" no insertion is in both."""
    rows = drawn(len(data.X), samples)
    if split == "sample":
        tested = max(1, round(TEST_SHARE * len(rows)))
        return rows[tested:], rows[:tested]
    names = np.random.default_rng(SPLIT_SEED).permutation(np.unique(data.trajectory))
    held = names[: max(1, round(TEST_SHARE * len(names)))]
    within = np.isin(data.trajectory[rows], held)
    return rows[~within], rows[within]


def prediction_rmse_mm(model: Predictor, X: Vector, Y: Vector) -> float:
    """Root mean square of |Y - prediction|, mm; nan without rows."""
    if not len(X):
        return float("nan")
    return 1e3 * float(np.sqrt(np.mean(np.sum((model.predict(X) - Y) ** 2, axis=1))))


def rows_of(curves: LearningCurves) -> Iterator[dict[str, float | int | str]]:
    """The trainings as flat rows, for a CSV file."""
    for point in curves.points:
        yield dict(vars(point))
