"""What an experiment is made of: cases to run, and the outcome of each."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from simcore.scenario.sensing import without_idle_sensing

Label = str | int | float


@dataclass(frozen=True)
class Case:
    """One insertion of an experiment.

    id: unique within its suite, good as a file name. scenario: fully resolved JSON. labels: what the analyses sort by;
    the paper's suites use `group` ("LIN", "CUR", "DATA"), `arm` (the controller), `young` ("constant", "variable"),
    `noise` ("off", "on"), `end_point` (0 ...; pairs the arms) and `direction` ("", "+x", "-x", "+y", "-y").
    """

    id: str
    scenario: dict[str, Any]
    labels: dict[str, Label]


@dataclass(frozen=True)
class Suite:
    """A named, versioned list of cases. Two suites are the same when their digests are."""

    name: str
    title: str
    cases: tuple[Case, ...]

    @property
    def sha256(self) -> str:
        """Digest over ids, labels and resolved scenarios, in order; a `sensing` block that changes nothing is left
        out, so that suites from before it keep their digests."""
        content = [[case.id, case.labels, without_idle_sensing(case.scenario)] for case in self.cases]
        return hashlib.sha256(json.dumps(content, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


@dataclass(frozen=True)
class Outcome:
    """How one case ended. result: the JSON of `Rollout.result()`: status, message, metrics, timing, solver, digest,
    warnings, provenance."""

    case: Case
    result: dict[str, Any]


RunMany = Callable[[Sequence[Case]], Iterable[Outcome]]  # in any order; a failed run is an outcome like any other
