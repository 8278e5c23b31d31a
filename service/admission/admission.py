"""Checks a scenario or a campaign before it is queued. One that names an uploaded mesh is checked in a process of its
own: the mesh is never in the memory of the server, and its time and memory have limits."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from service.admission.cost import Cost, check_cost
from service.files.upload_names import SUFFIXES, UploadLookup, references
from simcore.errors import NeedlebenchError, Problem, ScenarioError
from simcore.file_names import names_mean
from simcore.scenario.presets import preset
from simcore.scenario.scenario import Scenario

if TYPE_CHECKING:
    from collections.abc import Iterator

    from service.settings import Limits

MEMORY_MB = 4000  # address space, half of which the libraries take
TIME_S = 120
AT_ONCE = 2  # such processes
MOST_WAITING = 8  # requests that wait for one


class AdmissionBusyError(NeedlebenchError):
    """Too many scenarios with meshes are being checked."""


@dataclass(frozen=True, kw_only=True)
class AdmittedScenario:
    """A scenario that may be queued. resolved: with every default. uploads: ids of the files that it names."""

    name: str
    resolved: dict[str, Any]
    steps: int
    cost: Cost
    uploads: tuple[str, ...]


def admit(value: Any, uploads: Path, limits: Limits) -> AdmittedScenario:
    """Check a scenario as JSON data, or the name of a built-in one. uploads: folder of the files that it may name.

    Raises ScenarioError, also for one that costs too much, and AdmissionBusyError.
    """
    if not names_mesh(value):
        return admitted(value, uploads, limits)
    told = checked_apart("scenario", value, uploads, limits)
    return AdmittedScenario(**{**told, "cost": Cost(**told["cost"]), "uploads": tuple(told["uploads"])})


def admitted(value: Any, uploads: Path, limits: Limits) -> AdmittedScenario:
    """`admit` in this process."""
    with names_mean(lookup := UploadLookup(uploads)):
        scenario = preset(value) if isinstance(value, str) else Scenario.load(value)
        cost = check_cost(scenario, limits)
    return AdmittedScenario(
        name=scenario.name,
        resolved=scenario.resolved(),
        steps=scenario.steps,
        cost=cost,
        uploads=tuple(sorted(lookup.used)),
    )


def names_mesh(value: Any) -> bool:
    """Whether JSON data names an uploaded mesh, wherever."""
    return any(Path(upload).suffix in SUFFIXES["mesh"] for _, upload in references(value))


class _Gate:
    """Lets `AT_ONCE` in at a time; at most `MOST_WAITING` wait, for each keeps a thread of the server."""

    def __init__(self) -> None:
        self._free = threading.Semaphore(AT_ONCE)
        self._lock = threading.Lock()
        self.waiting = 0

    @contextmanager
    def passed(self) -> Iterator[None]:
        """Within, it is one's turn. Raises AdmissionBusyError."""
        with self._lock:
            if self.waiting >= MOST_WAITING:
                raise AdmissionBusyError("too many scenarios with meshes are being checked: try again")
            self.waiting += 1
        try:
            with self._free:
                yield
        finally:
            with self._lock:
                self.waiting -= 1


gate = _Gate()


def checked_apart(kind: str, value: Any, uploads: Path, limits: Limits) -> Any:
    """What `service.admission.admission_process` says of a scenario or the request of a campaign.

    Raises ScenarioError, AdmissionBusyError.
    """
    asked = {"kind": kind, "value": value, "uploads": str(uploads), "limits": limits.model_dump(mode="json")}
    command = [sys.executable, "-m", "service.admission.admission_process"]
    with gate.passed():
        try:
            asked_text = json.dumps(asked).encode()
            done = subprocess.run(command, input=asked_text, capture_output=True, timeout=2 * TIME_S, check=False)
        except subprocess.TimeoutExpired:
            raise _too_large(value) from None
    try:
        told = json.loads(done.stdout)
    except ValueError:
        raise _too_large(value) from None
    if "problems" in told:
        raise ScenarioError([Problem(*problem) for problem in told["problems"]])
    return told["answer"]


def _too_large(value: Any) -> ScenarioError:
    field, upload = next((f, u) for f, u in references(value) if Path(u).suffix in SUFFIXES["mesh"])
    message = f"takes more than {TIME_S} s or {MEMORY_MB} MB to check"
    return ScenarioError([Problem(field, f"artefact:{upload}", message)])
