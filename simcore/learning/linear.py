"""Linear regression with a ridge: what a learned controller without any bend can do."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from simcore.learning.regressor import Arrays, DataError, Regressor, Shapes, ridge_solution
from simcore.linear_algebra.products import product

if TYPE_CHECKING:
    from simcore.arrays import Floats


class LinearModel(Regressor):
    """Y = A X + c; c is in the means of the standardised data."""

    kind = "linear"

    def __init__(self, *, ridge: float = 1e-6) -> None:
        super().__init__()
        if not 0.0 <= ridge <= 1e6:
            raise DataError(f"ridge = {ridge:g}: must be 0 to 1e6")
        self.ridge = ridge

    def settings(self) -> dict[str, Any]:
        """What it was made with, as JSON data."""
        return {"ridge": self.ridge}

    def shapes(self, inputs: int, outputs: int) -> Shapes:
        """The shape of each array but the scales; -1 = any number of rows."""
        return {"a": (inputs, outputs)}

    def _fit(self, X: Floats, Y: Floats) -> Arrays:
        return {"a": ridge_solution(X, Y, self.ridge)}

    def _predict(self, X: Floats) -> Floats:
        answer: Floats = product(X, self.arrays["a"])
        return answer
