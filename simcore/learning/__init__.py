"""Regressors from (P, e_p) to Delta P, and the files that keep them."""

from simcore.learning.elm import ExtremeLearningMachine
from simcore.learning.linear import LinearModel
from simcore.learning.mlp import MultilayerPerceptron
from simcore.learning.neighbours import NearestNeighbours
from simcore.learning.regressor import Regressor
from simcore.learning.trained import TrainedModel, load_model, model_digest, parse_model

__all__ = [
    "ExtremeLearningMachine",
    "LinearModel",
    "MultilayerPerceptron",
    "NearestNeighbours",
    "Regressor",
    "TrainedModel",
    "load_model",
    "model_digest",
    "parse_model",
]
