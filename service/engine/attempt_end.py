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


def last_report(job: Job, progress: dict[str, Any] | None) -> str:
    """How far an insertion was when it last said so, and what steers it, as "; its last report was step 3 of 50,
    controller 'pi'"; empty for a training and before the first report."""
    scenario = (job.spec or {}).get("scenario")
    step, steps = ((progress or {}).get(name) for name in ("step", "steps"))
    if not isinstance(scenario, dict) or not (isinstance(step, int) and isinstance(steps, int)):
        return ""
    controller = scenario.get("controller") or {}
    name = controller.get("name") or controller.get("kind") or "ifem"
    return f"; its last report was step {step} of {steps}, controller {name!r}"


def artefacts_of(job: Job, described: Iterable[dict[str, Any]]) -> tuple[Artefact, ...]:
    """The files of the current attempt, from kind, name, SHA-256 and size of each."""
    return tuple(Artefact(**file, path=f"{job.folder}/{file['name']}") for file in described)


def named(job: Job) -> dict[str, Any]:
    """The fields of a log line that say which attempt it is about."""
    return {"job": job.id, "attempt": job.attempt}
