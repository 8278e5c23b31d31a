"""Extreme Learning Machine [paper; Huang et al. 2006]: Y = beta g(w X + b), g the sigmoid, w and b random and fixed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from simcore.elementary import sigmoid
from simcore.learning.regressor import Arrays, DataError, Regressor, Shapes, ridge_solution
from simcore.linear_algebra.products import product

if TYPE_CHECKING:
    from simcore.arrays import Floats

NODES = 25  # [paper]
RIDGE = 1e-6  # [ours] keeps beta finite where two random nodes look alike, without a visible bias
WEIGHT_RANGE = 1.0  # [ours] of w and b, uniform, for standardised inputs: the sigmoids bend but do not saturate


class ExtremeLearningMachine(Regressor):
    """Only beta is learned, by least squares with a ridge; w (nodes, inputs) and b (nodes,) come from the seed."""

    kind = "elm"

    def __init__(
        self, *, nodes: int = NODES, ridge: float = RIDGE, weight_range: float = WEIGHT_RANGE, seed: int = 0
    ) -> None:
        super().__init__()
        if not 1 <= nodes <= 10_000:
            raise DataError(f"nodes = {nodes}: must be 1 to 10000")
        if not 0.0 <= ridge <= 1e6:
            raise DataError(f"ridge = {ridge:g}: must be 0 to 1e6")
        if not 0.0 < weight_range <= 100.0:
            raise DataError(f"weight_range = {weight_range:g}: must be above 0 and at most 100")
        self.nodes, self.ridge, self.weight_range, self.seed = nodes, ridge, weight_range, seed

    def settings(self) -> dict[str, Any]:
        """What it was made with, as JSON data."""
        return {"nodes": self.nodes, "ridge": self.ridge, "weight_range": self.weight_range, "seed": self.seed}

    def shapes(self, inputs: int, outputs: int) -> Shapes:
        """The shape of each array but the scales; -1 = any number of rows."""
        return {"w": (self.nodes, inputs), "b": (self.nodes,), "beta": (self.nodes, outputs)}

    def _fit(self, X: Floats, Y: Floats) -> Arrays:
        rng = np.random.default_rng(self.seed)
        w = rng.uniform(-self.weight_range, self.weight_range, (self.nodes, X.shape[1]))
        b = rng.uniform(-self.weight_range, self.weight_range, self.nodes)
        return {"w": w, "b": b, "beta": ridge_solution(sigmoid(product(X, w.T) + b), Y, self.ridge)}

    def _predict(self, X: Floats) -> Floats:
        a = self.arrays
        answer: Floats = product(sigmoid(product(X, a["w"].T) + a["b"]), a["beta"])
        return answer
