"""Controllers: each receives observations and answers with a command for the base. One file each."""

from simcore.controllers.base import Controller
from simcore.controllers.registry import make_controller
from simcore.episode.observation import Observation

__all__ = ["Controller", "Observation", "make_controller"]
