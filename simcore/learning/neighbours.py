"""k nearest neighbours: the mean answer of the stored samples that are nearest in standardised inputs."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from simcore.arrays import Floats
from simcore.learning.regressor import Arrays, DataError, Regressor, Shapes


class NearestNeighbours(Regressor):
    """Learns nothing: keeps the samples. The same tree of the same samples gives the same neighbours."""

    kind = "neighbours"

    def __init__(self, *, neighbours: int = 10) -> None:
        super().__init__()
        if not 1 <= neighbours <= 1000:
            raise DataError(f"neighbours = {neighbours}: must be 1 to 1000")
        self.neighbours = neighbours

    def settings(self) -> dict[str, Any]:
        """What it was made with, as JSON data."""
        return {"neighbours": self.neighbours}

    def shapes(self, inputs: int, outputs: int) -> Shapes:
        """The shape of each array but the scales; -1 = any number of rows."""
        return {"x": (-1, inputs), "y": (-1, outputs)}

    def _fit(self, X: Floats, Y: Floats) -> Arrays:
        self.__dict__.pop("_tree", None)
        return {"x": X, "y": Y}

    @cached_property
    def _tree(self) -> Any:
        return cKDTree(self.arrays["x"])

    def _predict(self, X: Floats) -> Floats:
        near = min(self.neighbours, len(self.arrays["x"]))
        found = self._tree.query(X, k=list(range(1, near + 1)))[1]
        answer: Floats = np.mean(self.arrays["y"][found], axis=1)
        return answer
