"""Learning curves: how well the ELM predicts Delta P, over hidden nodes, samples and random input weights."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.learning.training import SPLITS, train_model
from benchmarks.paper.learning_studies import LearningPoint
from simcore.learning import ExtremeLearningMachine
from simcore.rollout.dataset import Dataset

CURVE_SEEDS = 5


@dataclass(frozen=True)
class ElmTraining:
    """One trained ELM. Errors: root mean square of |Delta P - prediction|, mm."""

    curve: str  # "nodes", "samples" or "seeds": what was varied
    split: str  # "sample" or "trajectory": by trajectory no neighbour of a test sample is trained on
    nodes: int
    samples: int  # for training
    seed: int
    train_rmse_mm: float
    test_rmse_mm: float


@dataclass(frozen=True)
class LearningCurves:
    """All trainings, and the scale of their errors.

    spread_mm: root mean square distance of Delta P from its mean, mm: what no learning at all would give.
    nodes, seeds: of the controllers.
    """

    points: tuple[ElmTraining, ...]
    spread_mm: float
    nodes: int
    seeds: int

    def of(self, curve: str, split: str) -> list[ElmTraining]:
        """The trainings of one curve."""
        return [point for point in self.points if (point.curve, point.split) == (curve, split)]

    def for_report(self) -> list[LearningPoint]:
        """The curves as the report draws them: test errors over nodes and samples, by split."""
        return [
            LearningPoint(
                curve=point.curve,
                value=point.nodes if point.curve == "nodes" else point.samples,
                seed=point.seed,
                measure=f"Delta P, split by {point.split}",
                error_mm=point.test_rmse_mm,
            )
            for point in self.points
            if point.curve != "seeds"
        ]

    def rows(self) -> Iterator[dict[str, float | int | str]]:
        """The trainings as flat rows, for a CSV file."""
        return (dict(vars(point)) for point in self.points)


def learning_curves(
    data: Dataset, *, nodes: int, node_counts: Sequence[int], sample_counts: Sequence[int], seeds: int
) -> LearningCurves:
    """Train for every node count, sample count and seed, both splits; along the curves only the first few seeds.

    sample_counts: for training; a larger count than there are takes all of them. Raises DataError for a data set
    that is too small to split.
    """
    few = range(min(seeds, CURVE_SEEDS))
    points = []
    for split in SPLITS:
        points += [_point(data, split, "nodes", count, None, seed) for count in node_counts for seed in few]
        points += [_point(data, split, "samples", nodes, count, seed) for count in sample_counts for seed in few]
        points += [_point(data, split, "seeds", nodes, None, seed) for seed in range(seeds)]
    outputs = data.outputs(data.drawn)
    spread = 1e3 * float(np.sqrt(np.mean(np.sum((outputs - outputs.mean(axis=0)) ** 2, axis=1))))
    return LearningCurves(tuple(dict.fromkeys(points)), spread, nodes, seeds)


def _point(data: Dataset, split: str, curve: str, nodes: int, samples: int | None, seed: int) -> ElmTraining:
    done = train_model(data, ExtremeLearningMachine(nodes=nodes, seed=seed), split=split, samples=samples)
    errors = [float(np.linalg.norm(axes)) for axes in (done.train_rmse_mm, done.test_rmse_mm)]
    return ElmTraining(curve, split, nodes, done.model.provenance["train_rows"], seed, *errors)
