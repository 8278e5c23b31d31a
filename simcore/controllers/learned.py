"""Learned control [paper]: T = P + Delta P(P, e_p), e_p = n_traj - n; the base's axis through the initial entry."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from simcore.controllers.remote_centre import pose_through
from simcore.learning import Regressor, load_model

if TYPE_CHECKING:
    from simcore.arrays import Floats
    from simcore.episode.observation import Observation
    from simcore.insertion.state import Pose
    from simcore.scenario.scenario import Learned


class LearnedController:
    """Runs any regressor; the paper's is the ELM. The orientation is a rule and not learned."""

    limited = True

    def __init__(self, regressor: Regressor, entry_m: Floats) -> None:
        self.regressor, self.entry_m = regressor, entry_m

    @classmethod
    def load(cls, kind: str, settings: Learned, entry_m: Floats) -> LearnedController:
        """With the model that the scenario's block names. Raises ScenarioError."""
        assert settings.model_sha256 is not None
        return cls(load_model(kind, settings.model, settings.model_sha256).regressor, entry_m)

    def command(self, observation: Observation) -> Pose:
        """The learned move of the base."""
        base = observation.base
        inputs = np.concatenate([base.position_m, observation.target_m - observation.tip_m])
        move = self.regressor.predict(inputs[None, :])[0]
        return pose_through(self.entry_m, base.position_m + move, base.rotation)
