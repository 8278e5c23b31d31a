"""What the store is told of an attempt: what is asked of its worker, how it ended, which files it left."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from service.store.job import FAILED, FINISHED, TRAINING, Artefact, Job, Outcome
from service.worker.specs import AttemptReport, InsertionSpec, TrainingSpec

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path


def spec_of(job: Job, uploads: Path) -> InsertionSpec | TrainingSpec:
    """What the worker is asked for. uploads: folder of the files that it may name."""
    given = job.spec or {}
    if job.kind == TRAINING:
        return TrainingSpec(job_id=job.id, training=given["training"], files=uploads)
    return InsertionSpec(job_id=job.id, scenario=given["scenario"], files=uploads)


def outcome_of(job: Job, report: AttemptReport, progress: dict[str, Any] | None) -> Outcome:
    """The end of an attempt that its worker reported. progress: the last one."""
    failed = report.error is not None
    return Outcome(
        state=FAILED if failed else FINISHED,
        result=None if failed else report.result,
        error_kind=report.error_kind,
        error=report.error,
        artefacts=artefacts_of(job, report.artefacts),
        cpu_s=report.cpu_s,
        max_rss_mb=report.max_rss_mb,
        progress=progress,
    )


def artefacts_of(job: Job, described: Iterable[dict[str, Any]]) -> tuple[Artefact, ...]:
    """The files of the current attempt, from kind, name, SHA-256 and size of each."""
    return tuple(Artefact(**file, path=f"{job.folder}/{file['name']}") for file in described)


def named(job: Job) -> dict[str, Any]:
    """The fields of a log line that say which attempt it is about."""
    return {"job": job.id, "attempt": job.attempt}
