"""What every regressor has in common: `fit(X, Y)`, `predict(X)`, inputs and outputs standardised, arrays to keep."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar, Self

import numpy as np

from simcore.arrays import Floats
from simcore.errors import NeedlebenchError

Arrays = dict[str, Floats]
Shapes = dict[str, tuple[int, ...]]

SCALES = ("input_mean", "input_scale", "output_mean", "output_scale")


class DataError(NeedlebenchError, ValueError):
    """Data that cannot be learned from or predicted with; the message has the numbers."""


class Regressor(ABC):
    """Y (n, outputs) from X (n, inputs). The arrays are those of standardised data, and the means and scales."""

    kind: ClassVar[str]

    def __init__(self) -> None:
        self.arrays: Arrays = {}

    @abstractmethod
    def settings(self) -> dict[str, Any]:
        """What the constructor was given, as JSON data."""

    @abstractmethod
    def shapes(self, inputs: int, outputs: int) -> Shapes:
        """The shape of each array but the scales; -1 = any number of rows, at least one."""

    @abstractmethod
    def _fit(self, X: Floats, Y: Floats) -> Arrays:
        """Learn from standardised data."""

    @abstractmethod
    def _predict(self, X: Floats) -> Floats:
        """Answer standardised inputs (n, inputs)."""

    def fit(self, X: Floats, Y: Floats) -> Self:
        """Learn Y (n, outputs) from X (n, inputs). Raises DataError for rows that do not match or are not finite."""
        X, Y = finite(X, "X"), finite(Y, "Y")
        if len(X) != len(Y):
            raise DataError(f"X has {len(X)} rows, Y has {len(Y)}: they must be as many")
        if len(X) < 2:
            raise DataError(f"X has {len(X)} rows, at least 2 are needed")
        scales = (X.mean(axis=0), spread_of(X), Y.mean(axis=0), spread_of(Y))
        learned = self._fit((X - scales[0]) / scales[1], (Y - scales[2]) / scales[3])
        return self.keep({**dict(zip(SCALES, scales, strict=True)), **learned})

    def keep(self, arrays: Arrays) -> Self:
        """Take what was learned before."""
        self.arrays = arrays
        return self

    def predict(self, X: Floats) -> Floats:
        """Y (n, outputs) at X (n, inputs). Raises DataError for another width."""
        a = self.arrays
        if not a:
            raise DataError(f"the {self.kind} model has learned nothing yet: call fit first")
        if X.ndim != 2 or X.shape[1] != self.inputs:
            raise DataError(f"X has the shape {X.shape}, the {self.kind} model takes (n, {self.inputs})")
        standard = self._predict((X - a["input_mean"]) / a["input_scale"])
        return standard * a["output_scale"] + a["output_mean"]

    @property
    def inputs(self) -> int:
        """Number of inputs that it was trained with."""
        return len(self.arrays["input_mean"])

    @property
    def outputs(self) -> int:
        """Number of outputs that it was trained with."""
        return len(self.arrays["output_mean"])


def finite(values: Floats, name: str) -> Floats:
    """A finite table (n, width) of float64. Raises DataError with the first row that is not finite."""
    table = np.asarray(values, dtype=np.float64)
    if table.ndim != 2:
        raise DataError(f"{name} has the shape {table.shape}, it must be a table (rows, columns)")
    bad = np.flatnonzero(~np.isfinite(table).all(axis=1))
    if bad.size:
        raise DataError(f"{name} has {bad.size} of {len(table)} rows that are not finite, the first is row {bad[0]}")
    return table


def spread_of(table: Floats) -> Floats:
    """Standard deviation of each column; 1 for a column that does not change."""
    spread = table.std(axis=0)
    constant = spread <= 1e-12 * np.abs(table).max(axis=0)
    return np.where(constant, 1.0, spread)


def ridge_solution(H: Floats, Y: Floats, ridge: float) -> Floats:
    """(columns, outputs): argmin |H B - Y|^2 + ridge n |B|^2, by a QR-based least-squares solve of the stacked system.

    The normal equations would square the condition number of H, which is large for random sigmoid features.
    """
    from simcore.linear_algebra.least_squares import least_squares  # slow to import, and no prediction needs it

    columns = H.shape[1]
    stacked = np.vstack([H, np.sqrt(ridge * len(H)) * np.eye(columns)])
    right = np.vstack([Y, np.zeros((columns, Y.shape[1]))])
    solution: Floats = least_squares(stacked, right)
    return solution
