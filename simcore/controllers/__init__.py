"""Controllers: each receives observations and answers with a command for the base. One file each."""

from simcore.controllers.base import Controller, Observation
from simcore.controllers.registry import make_controller

__all__ = ["Controller", "Observation", "make_controller"]
