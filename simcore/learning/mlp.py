"""A small multilayer perceptron: tanh layers and a linear one, run with numpy. It is trained elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

from simcore.arrays import Floats
from simcore.elementary import sigmoid
from simcore.learning.regressor import Arrays, DataError, Regressor, Shapes
from simcore.linear_algebra.products import product

Layers = list[tuple[Floats, Floats]]  # weights (from, to) and biases (to,) of each layer
Trainer = Callable[[Floats, Floats, tuple[int, ...], int], Layers]


class MultilayerPerceptron(Regressor):
    """h <- tanh(h W + b) for each hidden layer, then h W + b.

    trainer: (X, Y, hidden, seed) -> layers; handed in, because the training needs a package that running does not.
    """

    kind = "mlp"

    def __init__(self, *, hidden: Sequence[int] = (32, 32), seed: int = 0, trainer: Trainer | None = None) -> None:
        super().__init__()
        if not 1 <= len(hidden) <= 5 or not all(isinstance(n, int) and 1 <= n <= 1000 for n in hidden):
            raise DataError(f"hidden = {list(hidden)}: must be 1 to 5 layers of 1 to 1000 nodes")
        self.hidden, self.seed, self.trainer = tuple(hidden), seed, trainer

    def settings(self) -> dict[str, Any]:
        """What it was made with, as JSON data."""
        return {"hidden": list(self.hidden), "seed": self.seed}

    def shapes(self, inputs: int, outputs: int) -> Shapes:
        """The shape of each array but the scales; -1 = any number of rows."""
        found: Shapes = {}
        for i, (before, after) in enumerate(pairwise((inputs, *self.hidden, outputs))):
            found |= {f"w{i}": (before, after), f"b{i}": (after,)}
        return found

    def _fit(self, X: Floats, Y: Floats) -> Arrays:
        if self.trainer is None:
            raise DataError("a multilayer perceptron needs a trainer to be fitted")
        layers = self.trainer(X, Y, self.hidden, self.seed)
        return {name: array for i, (w, b) in enumerate(layers) for name, array in ((f"w{i}", w), (f"b{i}", b))}

    def _predict(self, X: Floats) -> Floats:
        a, last = self.arrays, len(self.hidden)
        h = X
        for i in range(last):
            h = 2.0 * sigmoid(2.0 * (product(h, a[f"w{i}"]) + a[f"b{i}"])) - 1.0
        answer: Floats = product(h, a[f"w{last}"]) + a[f"b{last}"]
        return answer
