"""The coupled problem of tissue and needle: all that a run never changes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from simcore.contact.kernels import Inertia, frame_along
from simcore.insertion.residuals import Constants

if TYPE_CHECKING:
    from simcore.arrays import Floats
    from simcore.contact.channel import ChannelModel
    from simcore.contact.laws import ContactLaw
    from simcore.contact.line import LineCoupling
    from simcore.needle.model import NeedleModel
    from simcore.tissue.model import TissueModel


@dataclass(frozen=True)
class Tolerances:
    """When a step counts as converged. Results must not depend on it: see the convergence tests.

    force_n: largest nodal force residual and largest distance from a contact law. violation_m: largest gap of an active
    constraint. max_iterations: corrections of a step before it is a failure.
    """

    force_n: float = 1e-5
    violation_m: float = 1e-8
    max_iterations: int = 60


@dataclass(frozen=True)
class CoupledModel:
    """Both bodies, the channel between them, the laws of contact, and how well and in what steps all is solved."""

    tissue: TissueModel
    needle: NeedleModel
    channel: ChannelModel
    law: ContactLaw
    line: LineCoupling
    tolerances: Tolerances
    entry_m: Floats  # (3,) m, on the surface: where the needle enters
    dt_s: float
    linearised: bool = False  # one linear solve a step, whatever it leaves; False = to the tolerances

    @cached_property
    def surface_frame(self) -> Floats:
        """(3, 3) rows n1, n2 and the inward normal of the surface at the entry: the frame of the surface contact."""
        frame = np.empty((3, 3))
        frame_along(self.channel.inward, frame)
        return frame

    @cached_property
    def constants(self) -> Constants:
        """What kernels know of the model."""
        tissue, needle, law = self.tissue, self.needle, self.law
        inertia = Inertia(tissue.masses_kg, tissue.mass_damping_per_s, tissue.stiffness_damping_s)
        lengths = (needle.length_m, law.adhesion_n_per_m)
        return Constants(
            inertia, tissue.unknown, self.channel.rest_m, needle.section, *lengths, law.friction, self.line
        )
