"""Trains the small network with scikit-learn, which only this needs: the trained network runs without it."""

from __future__ import annotations

import importlib.util
import warnings

import numpy as np
from numpy.typing import NDArray

from simcore.errors import NeedlebenchError

Vector = NDArray[np.float64]

MAXIMUM_EPOCHS = 300
REGULARISATION = 1e-5
BATCH = 256


class MissingScikitLearnError(NeedlebenchError):
    """scikit-learn is not installed."""


def require_scikit_learn() -> None:
    """Raises MissingScikitLearnError, without importing it."""
    if importlib.util.find_spec("sklearn") is None:
        raise MissingScikitLearnError("training the mlp needs scikit-learn: pip install 'needlebench[baselines]'")


def train_network(features: Vector, outputs: Vector, hidden: tuple[int, ...], seed: int) -> list[tuple[Vector, Vector]]:
    """Weights (from, to) and biases (to,) of each layer, by Adam on the squared error of standardised data.

    features: (rows, from); outputs: (rows, to). Raises MissingScikitLearnError.
    """
    require_scikit_learn()
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.neural_network import MLPRegressor

    network = MLPRegressor(
        hidden_layer_sizes=hidden,
        activation="tanh",
        alpha=REGULARISATION,
        batch_size=min(BATCH, len(features)),
        max_iter=MAXIMUM_EPOCHS,
        random_state=seed,
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # the epochs are bounded on purpose; the test error tells
        network.fit(features, outputs)
    return [(np.array(w), np.array(b)) for w, b in zip(network.coefs_, network.intercepts_, strict=True)]
