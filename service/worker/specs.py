"""What a worker process is asked for and what it hands back; the JSON form of a request is made and read here alone."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

Names = Literal["uploads", "paths"]


@dataclass(frozen=True, kw_only=True)
class InsertionSpec:
    """One insertion.

    scenario: its resolved JSON. files: folder of the files that the scenario may name. names: how it names them, as
    uploads (`artefact:ID`) and nothing else, or by paths relative to `files`. full_series: where only series are kept,
    all of them, or the state alone in single precision.
    """

    job_id: str
    scenario: dict[str, Any]
    files: Path
    names: Names = "uploads"
    full_series: bool = True

    def to_json(self) -> dict[str, Any]:
        """What a runner is given."""
        return {
            "job_id": self.job_id,
            "scenario": self.scenario,
            "files": str(self.files),
            "names": self.names,
            "full_series": self.full_series,
        }

    @classmethod
    def from_json(cls, spec: dict[str, Any]) -> Self:
        """What `to_json` made."""
        return cls(**{**spec, "files": Path(spec["files"])})

    def file_names(self) -> AbstractContextManager[None]:
        """While it is open, file names in scenarios mean what this specification says."""
        from service.files.upload_names import UploadLookup
        from simcore.file_names import names_mean

        return names_mean(UploadLookup(self.files) if self.names == "uploads" else lambda name: self.files / name)


@dataclass(frozen=True, kw_only=True)
class TrainingSpec:
    """One model to be trained. training: the resolved request. files: folder of the uploaded data sets."""

    job_id: str
    training: dict[str, Any]
    files: Path

    def to_json(self) -> dict[str, Any]:
        """What a runner is given."""
        return {"job_id": self.job_id, "training": self.training, "files": str(self.files)}

    @classmethod
    def from_json(cls, spec: dict[str, Any]) -> Self:
        """What `to_json` made."""
        return cls(**{**spec, "files": Path(spec["files"])})


@dataclass(frozen=True, kw_only=True)
class AttemptReport:
    """What one attempt left: a result, or the kind and message of an error in its place.

    artefacts: kind, name, SHA-256 and size of each file. max_rss_mb: None where the system does not count.
    leftovers: what it left in its process, as in `1 thread`; if there is any, another job needs another process.
    """

    result: Any = None
    error_kind: str | None = None
    error: str | None = None
    artefacts: tuple[dict[str, Any], ...] = ()
    cpu_s: float
    max_rss_mb: float | None
    leftovers: tuple[str, ...] = ()
