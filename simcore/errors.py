"""What can go wrong, by name. Input errors are raised; numerical failures are statuses carried by results."""

from __future__ import annotations

import tokenize
import zipfile
import zlib
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

# What reading an .npz raises that was cut off or changed: of the archive, its compression, the headers of its arrays.
ARCHIVE_ERRORS = (
    OSError, EOFError, ValueError, KeyError, SyntaxError, NotImplementedError, tokenize.TokenError, zlib.error,
    zipfile.BadZipFile,
)  # fmt: skip


class NeedlebenchError(Exception):
    """Base of every error that this package raises on purpose."""


@dataclass(frozen=True)
class Problem:
    """One thing wrong with one field of an input."""

    field: str
    value: Any
    message: str

    def __str__(self) -> str:
        shown = repr(self.value)
        shown = shown if len(shown) <= 80 else shown[:77] + "..."
        return f"{self.field} = {shown}: {self.message}"


class ScenarioError(NeedlebenchError, ValueError):
    """A scenario that cannot be run; `problems` names each field, its value and the allowed range."""

    def __init__(self, problems: list[Problem]) -> None:
        self.problems = problems
        super().__init__("\n".join(str(problem) for problem in problems))


class Status(StrEnum):
    """How a step, and with it a run, ended. Everything but COMPLETED is a failure that has a name: see STATUSES."""

    COMPLETED = "completed"
    NOT_CONVERGED = "not_converged"
    INVERTED = "inverted"
    NOT_FINITE = "not_finite"
    NOT_POSITIVE_DEFINITE = "not_positive_definite"
    TISSUE_LEFT = "tissue_left"
    CHANNEL_LEFT = "channel_left"
    TARGET_LOST = "target_lost"
    BUCKLED = "buckled"
    AUTHORITY_LOST = "authority_lost"
    SHAFT_BESIDE = "shaft_beside"
    CONTROLLER_FAILED = "controller_failed"


STATUSES = {
    Status.COMPLETED: "every step converged; whether the tip followed its path is `success`",
    Status.NOT_CONVERGED: "a step's residual or constraint violation stayed above its tolerance, or no contact state "
    "was consistent",
    Status.INVERTED: "a tetrahedron of the tissue collapsed: min det F at 0.1 or below; the message says where",
    Status.NOT_FINITE: "a state held NaN or infinity",
    Status.NOT_POSITIVE_DEFINITE: "the stiffness matrix could not be factored",
    Status.TISSUE_LEFT: "the tip left the tissue elsewhere than where it came in",
    Status.CHANNEL_LEFT: "a tip that was pushed in again missed the channel that it had cut",
    Status.TARGET_LOST: "the tip was farther from the target of its command than max(10 mm, 5 `success_mm`); not "
    "judged for prescribed poses and for targets without a path",
    Status.BUCKLED: "the needle, as base and tissue hold it, was pushed to the limit point of its free shaft: its "
    "equilibrium was unstable, or a step within a tenth of that load found none",
    Status.AUTHORITY_LOST: "the RCM authority vanished on the way (its smallest singular value fell to 0.02, or its "
    "determinant changed sign), and then a step did not converge with the tip more than 2 mm from its target, the "
    "target was lost, or the base came beside the tissue",
    Status.SHAFT_BESIDE: "the base or the free shaft came beside the tissue or into it, more than 1 mm deeper than "
    "where the shaft enters: contact is modelled at the channel alone",
    Status.CONTROLLER_FAILED: "the controller raised or did not answer in time, or a command was no finite pose "
    "within 10 m of the base; the message names controller, step and value",
}


class ControllerError(NeedlebenchError):
    """A controller that cannot be asked, or that answers with something else than a pose: the run ends as
    `controller_failed`."""


class ModelFailureError(NeedlebenchError):
    """What a controller computes from its model failed numerically; the loop ends the run with this status."""

    def __init__(self, status: Status, message: str) -> None:
        self.status, self.message = status, message
        super().__init__(f"{status}: {message}")
