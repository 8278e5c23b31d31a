"""The steps that a job takes, each within a transaction of the caller's."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from service.store.job import LEGAL, IllegalTransitionError, Job, Outcome, outcome_of
from service.store.job_lists import JobLists
from service.store.job_queries import (
    ARTEFACT,
    BRIEF,
    CLAIM,
    END,
    EVENT,
    FILE_FIELDS,
    HIGHEST,
    LANES,
    MOVE,
    read,
    to_job,
)
from service.store.turns import Turns

if TYPE_CHECKING:
    from collections.abc import Callable

    from sqlalchemy import Connection, Engine


class Transitions(JobLists):
    """What changes the state of a job and logs it; `service.store.jobs` says when."""

    def __init__(self, engine: Engine, *, now: Callable[[], float]) -> None:
        super().__init__(engine, now=now)
        self._turns = Turns()

    def _take(self, connection: Connection) -> Job | None:
        priority = connection.execute(HIGHEST).scalar_one_or_none()
        if priority is None:
            return None
        oldest = {row.lane: row.oldest for row in connection.execute(LANES, {"of_priority": priority})}
        lane = self._turns.choose(oldest)
        row = connection.execute(CLAIM, {"now": self._now(), "of_seq": oldest[lane]}).one()
        self._turns.serve(lane)
        return to_job(row)

    def _end(self, connection: Connection, job: Job, outcome: Outcome) -> Job:
        values: dict[str, Any] = {
            "state": outcome.state,
            "outcome": outcome_of(job.kind, outcome.result),
            "result": outcome.result,
            "metrics": None if outcome.result is None else outcome.result.get("metrics"),
            "error_kind": outcome.error_kind,
            "error": outcome.error,
            "cpu_s": outcome.cpu_s,
            "max_rss_mb": outcome.max_rss_mb,
            "finished_at": self._now(),
        }
        if outcome.progress is not None:
            values["progress"] = outcome.progress
        row = None
        if outcome.state in LEGAL[job.state]:
            row = connection.execute(END, {**attempt_key(job), **values}).one_or_none()
        if row is None:
            raise IllegalTransitionError(job.id, read(connection, job.id, BRIEF).state, outcome.state)
        rows = [{"job_id": job.id, **{n: getattr(file, n) for n in FILE_FIELDS}} for file in outcome.artefacts]
        if rows:
            connection.execute(ARTEFACT, rows)
        return replace(job, **{**values, **row._mapping})

    def _move(self, connection: Connection, job: Job, state: str, values: dict[str, Any]) -> Job:
        """Change the state of `job` as it was read."""
        if state in LEGAL[job.state]:
            row = connection.execute(MOVE, {**attempt_key(job), **values, "state": state}).one_or_none()
            if row is not None:
                return to_job(row)
        raise IllegalTransitionError(job.id, read(connection, job.id).state, state)

    def _log(self, connection: Connection, job: Job, kind: str, data: dict[str, Any] | None = None) -> None:
        connection.execute(EVENT, self._entry(job, kind, data))

    def _entry(self, job: Job, kind: str, data: dict[str, Any] | None = None) -> dict[str, Any]:
        return {"job_id": job.id, "at": self._now(), "kind": kind, "attempt": job.attempt, "data": data}


def end_data(done: Job) -> dict[str, Any] | None:
    """What the log says about an end: the error of a failure, the outcome of a job that finished."""
    if done.error_kind:
        return {"error_kind": done.error_kind, "error": done.error}
    return {"outcome": done.outcome} if done.outcome else None


def attempt_key(job: Job) -> dict[str, Any]:
    """What `OF_ATTEMPT` asks for: the job as it was read; the attempt is the fence against an earlier owner."""
    return {"of_id": job.id, "of_attempt": job.attempt, "of_state": job.state}
