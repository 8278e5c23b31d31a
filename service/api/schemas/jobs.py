"""The JSON of jobs, their events and their results. The scenario itself is described once, in simcore."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, WithJsonSchema, field_validator

from service.admission.admission import AdmittedScenario
from service.admission.pace import Pace
from service.api.root_path import rooted
from service.api.schemas.timestamps import utc
from service.store.job import FINISHED, INSERTION, TIME_LIMIT, TRAINING, Artefact, Event, Job, TimeLimit

State = Literal["queued", "running", "finished", "failed", "cancelled", "timed_out"]
Outcome = Literal[
    "success",
    "missed",
    "not_converged",
    "inverted",
    "not_finite",
    "not_positive_definite",
    "tissue_left",
    "channel_left",
    "target_lost",
    "buckled",
    "authority_lost",
    "shaft_beside",
    "controller_failed",
]

ScenarioInput = Annotated[
    Any,
    WithJsonSchema(
        {
            "anyOf": [{"type": "object", "additionalProperties": True}, {"type": "string", "maxLength": 100}],
            "description": "A scenario (JSON, schema needlebench/scenario/1) or the name of a built-in one.",
            "examples": ["demo", {"name": "softer", "tissue": {"young_kpa": 3.0}}],
        }
    ),
]


class JobRequest(BaseModel):
    """A job to be queued."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={
            "examples": [
                {"scenario": "demo"},
                {"scenario": {"name": "softer", "tissue": {"young_kpa": 3.0}}, "priority": 10, "timeout_s": 600},
            ]
        },
    )

    scenario: ScenarioInput
    priority: Annotated[int, Field(strict=True, ge=-100, le=100, description="Higher runs first.")] = 0
    timeout_s: TimeLimit | None = Field(None, description=TIME_LIMIT)

    @field_validator("scenario")
    @classmethod
    def _object_or_name(cls, value: Any) -> Any:
        if not isinstance(value, dict | str):
            raise ValueError("must be a scenario (an object) or the name of a built-in one")
        return value


class JobDryRun(BaseModel):
    """What a job would take. seconds: wall time once it runs, with the band in which it lies by the pace of the last
    `measured_on` insertions of this service; without any, by the processors that the estimate was fitted on."""

    name: str
    steps: int
    nodes: int
    memory_mb: float
    seconds: float
    seconds_low: float
    seconds_high: float
    measured_on: int

    @classmethod
    def of(cls, admitted: AdmittedScenario, pace: Pace) -> Self:
        """The JSON of a scenario that may be queued."""
        cost = admitted.cost
        low, seconds, high = pace.seconds(cost.time_s)
        return cls(
            name=admitted.name,
            steps=admitted.steps,
            nodes=cost.nodes,
            memory_mb=cost.memory_mb,
            seconds=seconds,
            seconds_low=low,
            seconds_high=high,
            measured_on=pace.insertions,
        )


class Progress(BaseModel):
    """How far a running job is. eta_s is null before the first step and while it does not run.

    tip_error_mm: of the tip from the target that its step was commanded for, as in rmse_commanded_mm.
    cross_track_mm: of the tip from the path; null where the tissue carries the path. insertion_force_n: along the
    needle's base, positive pushes.
    """

    fraction: float = Field(0.0, ge=0, le=1)
    step: int = 0
    steps: int
    depth_mm: float | None = None
    tip_error_mm: float | None = None
    cross_track_mm: float | None = None
    insertion_force_n: float | None = None
    eta_s: float | None = None

    @classmethod
    def of(cls, job: Job) -> Self:
        """The progress of a job."""
        progress = cls(**{"steps": job.steps, **(job.progress or {})})
        if job.state == FINISHED and progress.step == progress.steps:
            return progress.model_copy(update={"eta_s": 0.0})
        return progress if job.state == "running" else progress.model_copy(update={"eta_s": None})


class JobError(BaseModel):
    """Why a job did not succeed. kind: exception, disk, out_of_memory, worker_died, timed_out."""

    kind: str
    message: str


class Links(BaseModel):
    """Addresses of everything else about a job; null while there is nothing."""

    self: str
    cancel: str
    events: str
    log: str
    metrics: str | None
    series: str | None
    recording: str | None
    model: str | None = Field(description="The model that a training produced.")
    artefacts: str


class JobSummary(BaseModel):
    """A job in a list: without its scenario and its result, which can be large."""

    id: str
    kind: Literal["insertion", "training"] = Field(description="What it does: simulate, or train a model.")
    name: str
    state: State
    outcome: Outcome | None = Field(
        description="Of a job that finished: success, missed (completed, without success), or why its run ended early."
    )
    attempt: int = Field(description="How many times it was started.")
    priority: int
    timeout_s: float
    pinned: bool = Field(description="Kept when old jobs are removed.")
    tags: list[str]
    note: str = Field(description="What somebody wrote down about it.")
    progress: Progress
    metrics: dict[str, Any] | None
    error: JobError | None
    links: Links
    key: str | None = Field(description="Id of the API key that submitted it; null if none was required.")
    created_at: datetime
    started_at: datetime | None
    finished_at: datetime | None

    @classmethod
    def fields_of(cls, job: Job) -> dict[str, Any]:
        """Its fields by name, for this class and those that extend it."""
        kind = job.error_kind
        return {
            "id": job.id,
            "kind": job.kind,
            "name": job.name,
            "state": job.state,
            "outcome": job.outcome,
            "attempt": job.attempt,
            "priority": job.priority,
            "timeout_s": job.timeout_s,
            "pinned": job.pinned,
            "tags": list(job.tags),
            "note": job.note,
            "progress": Progress.of(job),
            "metrics": job.metrics,
            "error": None if kind is None else JobError(kind=kind, message=job.error or ""),
            "links": links_of(job),
            "key": job.owner,
            "created_at": utc(job.created_at),
            "started_at": utc(job.started_at),
            "finished_at": utc(job.finished_at),
        }

    @classmethod
    def of(cls, job: Job) -> Self:
        """The JSON of a job in a list."""
        return cls(**cls.fields_of(job))


class JobView(JobSummary):
    """A job with all of its data. A run that missed or did not converge has an outcome; `failed` means a crash."""

    scenario: dict[str, Any] | None = Field(description="The fully resolved scenario; null for a training.")
    training: dict[str, Any] | None = Field(description="The training; null for an insertion.")
    result: dict[str, Any] | None = Field(description="The content of result.json, once there is one.")

    @classmethod
    def of(cls, job: Job) -> Self:
        """The JSON of a job."""
        spec = job.spec or {}
        return cls(
            **cls.fields_of(job), scenario=spec.get("scenario"), training=spec.get("training"), result=job.result
        )


class EventView(BaseModel):
    """One entry of the log of a job. id: increases over all jobs."""

    id: int
    job: str
    kind: str
    attempt: int
    at: datetime
    data: dict[str, Any] | None

    @classmethod
    def of(cls, event: Event) -> Self:
        """The JSON of an event."""
        at = utc(event.at)
        return cls(id=event.seq, job=event.job_id, kind=event.kind, attempt=event.attempt, at=at, data=event.data)


class EventList(BaseModel):
    """Events, oldest first, at most 1000; for the next ones, `after` = the id of the last."""

    items: list[EventView]


class JobPage(BaseModel):
    """Jobs, newest first; next_cursor leads to the older ones, null at the end."""

    items: list[JobSummary]
    next_cursor: str | None


class MetricsView(BaseModel):
    """What a finished run achieved."""

    job: str
    status: str | None
    metrics: dict[str, Any]
    timing: dict[str, Any] | None
    digest: Any


class ArtefactView(BaseModel):
    """A file that a job wrote."""

    kind: str
    name: str
    bytes: int
    sha256: str
    url: str

    @classmethod
    def of(cls, job_id: str, artefact: Artefact) -> Self:
        """The JSON of a file of a job."""
        url = rooted(f"/api/v1/jobs/{job_id}/artefacts/{artefact.name}")
        return cls(**{name: getattr(artefact, name) for name in ("kind", "name", "bytes", "sha256")}, url=url)


class ArtefactList(BaseModel):
    """The files of a job."""

    items: list[ArtefactView]


def links_of(job: Job) -> Links:
    """The addresses of a job that answer now."""
    base = rooted(f"/api/v1/jobs/{job.id}")
    done = job.state == FINISHED
    return Links(
        self=base,
        cancel=f"{base}/cancel",
        events=f"{base}/events",
        log=f"{base}/log",
        metrics=f"{base}/metrics" if done else None,
        series=f"{base}/series" if done and job.kind == INSERTION else None,
        recording=rooted(f"/recordings/{job.id}.rrd") if job.started_at is not None and job.kind == INSERTION else None,
        model=rooted(f"/api/v1/models/{(job.metrics or {})['model']}") if done and job.kind == TRAINING else None,
        artefacts=f"{base}/artefacts",
    )
