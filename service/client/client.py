"""The Python client of the service. Documented as `from needlebench import Client`."""

from __future__ import annotations

import json
import secrets
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import httpx2

from service.client.campaigns import CampaignCalls
from service.client.connection import CannotWriteError, ServiceError, UnreachableError, part, refusal
from service.client.job_edits import JobEdits
from service.client.models import ModelCalls
from service.client.records import JobEvent, JobStatus, Progress, UploadedFile
from service.client.uploads import UploadCalls
from service.files.upload_names import references
from simcore.scenario.scenario import Scenario

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from service.local.verify import Verdict
    from simcore.rollout.records import Observer

__all__ = [
    "CannotWriteError",
    "Client",
    "JobEvent",
    "JobStatus",
    "Progress",
    "ServiceError",
    "UnreachableError",
    "UploadedFile",
]

POLL_S = 20.0  # longest wait of one request of `wait`
_RETRIED_S = 30.0
_PAUSE_S = 0.3  # before connecting again


class Client(JobEdits, CampaignCalls, ModelCalls, UploadCalls):
    """A connection to one service. Use it as a context manager, or close it.

    url: as printed by `needlebench serve`. api_key: a key of the service, if it requires one.
    Every call raises ServiceError when the service refuses it and UnreachableError when no service answers.

    Example: run an insertion into softer tissue, and download its recording.

        from pathlib import Path

        from needlebench import Client

        with Client("http://127.0.0.1:8321") as client:
            job = client.submit({"tissue": {"young_kpa": 3.0}})
            job = client.wait(job.id, progress=lambda now: print(f"{now.state} {now.progress.fraction:.0%}"))
            print(job.success, client.metrics(job.id)["metrics"]["rmse_commanded_mm"])
            client.recording(job.id, Path("softer.rrd"))
    """

    def submit(
        self,
        scenario: Scenario | Mapping[str, Any] | str,
        *,
        priority: int = 0,
        timeout_s: float | None = None,
        idempotency_key: str | None = None,
    ) -> JobStatus:
        """Queue a scenario, its JSON data, or a built-in one by name. Higher priority runs first.

        timeout_s: most wall time of an attempt; None = an hour, or four times the service's estimate if that is
        longer. idempotency_key: repeated with the same request, it returns the same job; None = one of its own, so
        that an answer that is lost leads to no second job.
        """
        data = scenario.resolved() if isinstance(scenario, Scenario) else scenario
        body: dict[str, Any] = {"scenario": data, "priority": priority}
        if timeout_s is not None:
            body["timeout_s"] = timeout_s
        headers = {"Idempotency-Key": secrets.token_hex(16) if idempotency_key is None else idempotency_key}
        return JobStatus.of(self._json("POST", "/api/v1/jobs", json=body, headers=headers))

    def job(self, job_id: str) -> JobStatus:
        """The job as it is now."""
        return JobStatus.of(self._json("GET", f"/api/v1/jobs/{part(job_id)}"))

    def jobs(
        self,
        *,
        state: str | None = None,
        outcome: str | None = None,
        tag: str | None = None,
        limit: int | None = None,
    ) -> Iterator[JobStatus]:
        """Jobs, newest first, page by page; only those in a state, that finished with an outcome, or with a tag."""
        left, cursor = limit, None
        while left is None or left > 0:
            size = 100 if left is None else min(100, left)
            params = {"state": state, "outcome": outcome, "tag": tag, "limit": size, "cursor": cursor}
            page = self._json("GET", "/api/v1/jobs", params={k: v for k, v in params.items() if v is not None})
            yield from map(JobStatus.of, page["items"])
            left, cursor = None if left is None else left - len(page["items"]), page["next_cursor"]
            if cursor is None:
                return

    def wait(
        self,
        job_id: str,
        *,
        progress: Callable[[JobStatus], None] | None = None,
        timeout_s: float | None = None,
    ) -> JobStatus:
        """Wait until the job has ended; `progress` is called at each change. Survives a restart of the service.

        Raises TimeoutError after `timeout_s`.
        """
        end = None if timeout_s is None else time.monotonic() + timeout_s
        job, tag = self._changed(job_id, None, 0)
        while True:
            if job is not None and progress is not None:
                progress(job)
            if job is not None and job.terminal:
                return job
            left = POLL_S if end is None else end - time.monotonic()
            if left <= 0:
                raise TimeoutError(f"job {job_id} did not end within {timeout_s:g} s")
            job, tag = self._changed(job_id, tag, min(left, POLL_S))

    def _changed(self, job_id: str, tag: str | None, wait_s: float) -> tuple[JobStatus | None, str | None]:
        """The job once it differs from version `tag`, or None after `wait_s`; its version."""
        headers = {"If-None-Match": tag} if tag else {}
        give_up = time.monotonic() + _RETRIED_S
        while True:
            try:
                path = f"/api/v1/jobs/{part(job_id)}"
                answer = self._request("GET", path, params={"wait": wait_s}, headers=headers)
                break
            except UnreachableError:
                if time.monotonic() > give_up:
                    raise
                time.sleep(0.5)
        if answer.status_code == 304:
            return None, tag
        return JobStatus.of(answer.json()), answer.headers.get("etag")

    def cancel(self, job_id: str) -> JobStatus:
        """Cancel a queued or running job. Idempotent."""
        return JobStatus.of(self._json("POST", f"/api/v1/jobs/{part(job_id)}/cancel"))

    def retry(self, job_id: str) -> JobStatus:
        """Queue a job again that failed, was cancelled or timed out."""
        return JobStatus.of(self._json("POST", f"/api/v1/jobs/{part(job_id)}/retry"))

    def events(self, job_id: str, *, after: int = 0) -> Iterator[JobEvent]:
        """The events of the job as they happen, until it has ended. Survives a restart of the service.

        Each change of state comes once; progress comes at most twice a second.
        """
        known, give_up = after, time.monotonic() + _RETRIED_S
        while True:
            try:
                for event in self._streamed(f"/api/v1/jobs/{part(job_id)}/events", known):
                    if event is None:
                        return
                    known, give_up = event.id or known, time.monotonic() + _RETRIED_S
                    yield event
            except (UnreachableError, httpx2.TransportError):
                if time.monotonic() > give_up:
                    raise UnreachableError(f"the stream of events from {self.url} was interrupted") from None
            time.sleep(_PAUSE_S)

    def history(self, job_id: str) -> list[JobEvent]:
        """The events of the job so far, without progress."""
        items = self._json("GET", f"/api/v1/jobs/{part(job_id)}/events")["items"]
        return [JobEvent.of(item["kind"], item) for item in items]

    def _streamed(self, path: str, known: int) -> Iterator[JobEvent | None]:
        """The events of one connection after number `known`; None once there can be no more."""
        headers = {"Accept": "text/event-stream", **({"Last-Event-ID": str(known)} if known else {})}
        kind, data = "", ""
        with self._http.stream("GET", path, headers=headers) as answer:
            if answer.is_error:
                answer.read()
                raise refusal(answer)
            if answer.status_code == 204:
                yield None
            for line in answer.iter_lines():
                name, _, value = line.partition(": ")
                if name == "event":
                    kind = value
                elif name == "data":
                    data = value
                elif not line and kind == "dropped":
                    return  # too slow: again, after the last event
                elif not line and data:
                    yield JobEvent.of(kind, json.loads(data))
                    kind, data = "", ""

    def train_model(self, data: str, *, kind: str = "elm", **settings: Any) -> JobStatus:
        """Queue a training on the data set that `data` names, artefact:ID. settings: those of its kind, split, samples,
        name, priority, timeout_s. The model of the job that finished is `model(job.metrics["model"])`."""
        return JobStatus.of(self._json("POST", "/api/v1/models/train", json={"data": data, "kind": kind, **settings}))

    def metrics(self, job_id: str) -> dict[str, Any]:
        """Metrics, timing and digest of a finished job."""
        return dict(self._json("GET", f"/api/v1/jobs/{part(job_id)}/metrics"))

    def recording(self, job_id: str, path: Path) -> Path:
        """Download the recording; of a running job, as it grows until the job ends. Returns `path`."""
        return self._download(f"/recordings/{part(job_id)}.rrd", path)

    def series(self, job_id: str, path: Path) -> Path:
        """Download series.npz (open it with numpy.load). Returns `path`."""
        return self._download(f"/api/v1/jobs/{part(job_id)}/series?format=npz", path)

    def archive(self, job_id: str, path: Path) -> Path:
        """Download all of a job that has ended as a ZIP archive: scenario, result, series, recording, log. Returns
        `path`."""
        return self._download(f"/api/v1/jobs/{part(job_id)}/zip", path)

    def verify(self, job_id: str, observer: Observer | None = None) -> Verdict:
        """Run the job's scenario again in this process and compare: identical, equal within 1e-6 mm, or different.

        Uploads that the scenario names are downloaded. Raises CannotVerifyError when the job has no result, trained a
        model, or names an upload that the service no longer has.
        """
        from service.local.verify import CannotVerifyError, load_series, verify

        job = self.job(job_id)
        if job.result is None:
            raise CannotVerifyError(f"job {job_id} is {job.state}: it has no result")
        if job.scenario is None:
            raise CannotVerifyError(f"job {job_id} trained a model: train it again and compare the SHA-256")
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            for field_name, upload_id in references(dict(job.scenario)):
                self._fetch_upload(upload_id, folder, f"{field_name} of job {job_id}")
            series = load_series(self.series(job_id, folder / "series.npz"))
            return verify(job.result, series, observer, uploads=folder)

    def _fetch_upload(self, upload_id: str, folder: Path, what: str) -> Path:
        from service.local.verify import CannotVerifyError

        try:
            return self.upload_file(upload_id, folder / upload_id)
        except ServiceError as error:
            if error.status != 404:
                raise
            raise CannotVerifyError(f"{what} names the upload {upload_id}, which the service no longer has") from None

    def log(self, job_id: str) -> str:
        """The log of the job's last attempt so far."""
        return self._request("GET", f"/api/v1/jobs/{part(job_id)}/log").text

    def artefacts(self, job_id: str) -> list[dict[str, Any]]:
        """The files of the job: kind, name, bytes, sha256 and url of each."""
        return list(self._json("GET", f"/api/v1/jobs/{part(job_id)}/artefacts")["items"])

    def clear(self, *, dry_run: bool = False, **policy: float | None) -> dict[str, Any]:
        """Remove ended jobs by older_than_s, keep_last, max_bytes. Returns what was removed, or would be."""
        body = {**{name: value for name, value in policy.items() if value is not None}, "dry_run": dry_run}
        return dict(self._json("POST", "/api/v1/gc", json=body))

    def scenarios(self) -> dict[str, str]:
        """Built-in scenarios: name -> description."""
        return {item["name"]: item["description"] for item in self._json("GET", "/api/v1/scenarios")["items"]}

    def ready(self) -> dict[str, Any]:
        """The readiness of the service, as /readyz reports it."""
        return dict(self._json("GET", "/readyz"))
