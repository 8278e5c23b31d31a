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
    """How a step, and with it a run, ended. Everything but COMPLETED is a failure that has a name."""

    COMPLETED = "completed"
    NOT_CONVERGED = "not_converged"  # residual or violation above tolerance after max_iterations
    INVERTED = "inverted"  # min det F <= 0.1 in some tetrahedron
    NOT_FINITE = "not_finite"  # NaN or infinity in the state
    NOT_POSITIVE_DEFINITE = "not_positive_definite"  # the stiffness could not be factored
    TISSUE_LEFT = "tissue_left"  # the tip went out of the tissue elsewhere than where it came in
    CHANNEL_LEFT = "channel_left"  # a re-entering tip missed the channel that it had cut


class ModelFailureError(NeedlebenchError):
    """What a controller computes from its model failed numerically; the loop ends the run with this status."""

    def __init__(self, status: Status, message: str) -> None:
        self.status, self.message = status, message
        super().__init__(f"{status}: {message}")
