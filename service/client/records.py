"""What the Python client returns: jobs, their progress and events, uploads."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Self

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

TERMINAL = frozenset({"finished", "failed", "cancelled", "timed_out"})


@dataclass(frozen=True, kw_only=True)
class Progress:
    """How far a running job is; values that are not known yet are None."""

    fraction: float
    step: int
    steps: int
    depth_mm: float | None
    tip_error_mm: float | None
    cross_track_mm: float | None
    insertion_force_n: float | None
    eta_s: float | None

    @classmethod
    def of(cls, raw: Mapping[str, Any]) -> Self:
        """The progress of a job."""
        return cls(**{name: raw.get(name) for name in cls.__dataclass_fields__})  # type: ignore[arg-type]


@dataclass(frozen=True, kw_only=True)
class JobStatus:
    """A job as the service reported it; `raw` is its JSON. `scenario` and `result` are None in lists.

    kind: insertion, or training, which has no scenario. outcome: of a job that finished: success, missed, or the
    status with which its run ended early.
    """

    id: str
    kind: str
    name: str
    state: str
    outcome: str | None
    attempt: int
    progress: Progress
    metrics: Mapping[str, Any] | None
    error: Mapping[str, str] | None
    scenario: Mapping[str, Any] | None
    result: Mapping[str, Any] | None
    created_at: str
    tags: Sequence[str]
    note: str
    raw: Mapping[str, Any] = field(repr=False)

    @classmethod
    def of(cls, raw: Mapping[str, Any]) -> Self:
        """From the JSON of the service."""
        named = {name: raw.get(name) for name in cls.__dataclass_fields__ if name not in ("raw", "progress")}
        return cls(**named, progress=Progress.of(raw["progress"]), raw=raw)  # type: ignore[arg-type]

    @property
    def terminal(self) -> bool:
        """Whether it has ended."""
        return self.state in TERMINAL

    @property
    def success(self) -> bool:
        """Whether the run completed and met its own definition of success; a training, whether there is a model."""
        return self.outcome == "success"


@dataclass(frozen=True, kw_only=True)
class JobEvent:
    """Something that happened to a job. `progress` for the kind "progress", which has no id; else `data` and `at`."""

    id: int | None
    kind: str
    job: str
    attempt: int
    at: str | None = None
    data: Mapping[str, Any] | None = None
    progress: Progress | None = None

    @classmethod
    def of(cls, kind: str, raw: Mapping[str, Any]) -> Self:
        """From the JSON of the service; `kind` as the stream gives it."""
        if kind != "progress":
            return cls(**raw)
        progress = Progress.of(raw)
        return cls(id=None, kind=kind, job=raw["job"], attempt=raw["attempt"], progress=progress)


@dataclass(frozen=True, kw_only=True)
class UploadedFile:
    """An uploaded file; a scenario refers to it by `reference`."""

    id: str
    reference: str
    kind: str
    name: str
    bytes: int
    sha256: str
    content: Mapping[str, Any]

    @classmethod
    def of(cls, raw: Mapping[str, Any]) -> Self:
        """From the JSON of the service."""
        return cls(**{name: raw[name] for name in cls.__dataclass_fields__})
