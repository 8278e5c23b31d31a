"""The application without its engine: jobs stay queued, and a test moves them on through the store."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
from starlette.testclient import TestClient

from service.api.context import Service
from service.app import create_app
from service.settings import Settings
from service.store.job import Artefact, Job, Outcome
from service.worker.attempt import describe
from service.worker.training_job import MODEL, train_job
from tests.service.databases import lay_down

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

HERE = "http://127.0.0.1:8321"


@contextmanager
def idle_service(data: Path, **settings: Any) -> Iterator[tuple[TestClient, Service]]:
    made = Settings(data=data, **settings)
    lay_down(made.database)
    service = Service.open(made)
    try:
        yield TestClient(create_app(service), base_url=HERE, raise_server_exceptions=False), service
    finally:
        service.store.close()


def finish_training(service: Service) -> Job:
    """Claim the next job, a training, and do it as a worker and its slot would."""
    job = service.store.claim()
    assert job is not None
    folder = service.settings.data / job.folder
    folder.mkdir(parents=True)
    result = train_job({**(job.spec or {}), "job_id": job.id, "files": str(service.settings.uploads)}, folder)
    service.uploads.keep_made(folder / MODEL, job, result["model"])
    found = tuple(Artefact(**file, path=f"{job.folder}/{file['name']}") for file in describe(folder))
    return service.store.finish(job, Outcome(state="finished", result=result, artefacts=found))


def finish(service: Service, *, files: bool = True) -> Job:
    """Claim the next job and end it with a small result, as a worker would."""
    job = service.store.claim()
    assert job is not None
    folder = service.settings.data / job.folder
    folder.mkdir(parents=True)
    if files:
        (folder / "recording.rrd").write_bytes(b"0123456789")
        (folder / "result.json").write_text("{}")
        tip = np.arange(6.0).reshape(2, 3)
        np.savez(folder / "series.npz", t_s=np.array([0.0, np.nan]), tip_m=tip, tissue_rest_m=np.zeros((5, 3)))
    found = tuple(Artefact(**file, path=f"{job.folder}/{file['name']}") for file in describe(folder))
    result = {
        "status": "completed",
        "metrics": {"success": True, "rmse_commanded_mm": 0.5},
        "timing": {},
        "digest": "ab",
    }
    return service.store.finish(job, Outcome(state="finished", result=result, artefacts=found))
