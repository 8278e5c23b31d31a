"""The steps of a job's life that the tests take again and again."""

from typing import Any

from service.store.job import (
    Job,
    Outcome,
)
from service.store.jobs import Store


def submit(store: Store, name: str = "a", **more: Any) -> Job:
    given_fields = {"spec": {"scenario": {}}, "spec_hash": "0", "steps": 10, "priority": 0, "timeout_s": 60.0}
    return store.submit(name=name, **{**given_fields, **more})


def claim(store: Store) -> Job:
    job = store.claim()
    assert job is not None
    return job


RESULT = Outcome(state="finished", result={"status": "completed", "metrics": {"rmse_commanded_mm": 0.5}})


def kinds(store: Store, job: Job) -> list[str]:
    return [event.kind for event in store.events(job.id)]
