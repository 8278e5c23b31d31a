"""Talks to the service from Python: submit, follow, fetch. Documented as `from needlebench import Client`."""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import httpx2

from service.client.campaigns import CampaignCalls
from service.client.connection import CannotWrite, ServiceError, Unreachable, part, refusal
from service.client.models import ModelCalls
from service.client.records import JobEvent, JobStatus, Progress, Uploaded
from service.files.upload_names import references
from simcore.scenario.scenario import Scenario

if TYPE_CHECKING:
    from service.local.verify import Verdict
    from simcore.rollout.records import Observer

__all__ = ["CannotWrite", "Client", "JobEvent", "JobStatus", "Progress", "ServiceError", "Unreachable", "Uploaded"]

POLL_S = 20.0  # longest wait for an answer to one question of `wait`
_RETRIED_S = 30.0
_PAUSE_S = 0.3  # before connecting again


class Client(CampaignCalls, ModelCalls):
    """A connection to one service. Use it as a context manager, or close it.

    url: as printed by `needlebench serve`. api_key: what the service was started with, on any address but loopback.
    Raises ServiceError when the service refuses and Unreachable when there is none.
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
        longer. idempotency_key: sent again with the same request, it gives the same job.
        """
        data = scenario.resolved() if isinstance(scenario, Scenario) else scenario
        body: dict[str, Any] = {"scenario": data, "priority": priority}
        if timeout_s is not None:
            body["timeout_s"] = timeout_s
        headers = {"Idempotency-Key": idempotency_key} if idempotency_key is not None else {}
        return JobStatus.of(self._json("POST", "/api/v1/jobs", json=body, headers=headers))

    def job(self, job_id: str) -> JobStatus:
        """The job as it is now."""
        return JobStatus.of(self._json("GET", f"/api/v1/jobs/{part(job_id)}"))

    def jobs(self, *, state: str | None = None, limit: int | None = None) -> Iterator[JobStatus]:
        """Jobs, newest first, page by page."""
        left, cursor = limit, None
        while left is None or left > 0:
            size = 100 if left is None else min(100, left)
            params = {"state": state, "limit": size, "cursor": cursor}
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
        """Until the job has ended; `progress` sees each change. Outlasts a restart of the service.

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
            except Unreachable:
                if time.monotonic() > give_up:
                    raise
                time.sleep(0.5)
        if answer.status_code == 304:
            return None, tag
        return JobStatus.of(answer.json()), answer.headers.get("etag")

    def cancel(self, job_id: str) -> JobStatus:
        """Cancel a queued or running job; once more is no error."""
        return JobStatus.of(self._json("POST", f"/api/v1/jobs/{part(job_id)}/cancel"))

    def retry(self, job_id: str) -> JobStatus:
        """Queue a job again that failed, was cancelled or ran out of time."""
        return JobStatus.of(self._json("POST", f"/api/v1/jobs/{part(job_id)}/retry"))

    def pin(self, job_id: str) -> JobStatus:
        """Keep the job and its files whatever is cleared away."""
        return JobStatus.of(self._json("POST", f"/api/v1/jobs/{part(job_id)}/pin"))

    def unpin(self, job_id: str) -> None:
        """Keep it no longer."""
        self._request("DELETE", f"/api/v1/jobs/{part(job_id)}/pin")

    def events(self, job_id: str, *, after: int = 0) -> Iterator[JobEvent]:
        """What happens to the job, as it happens, until it has ended. Outlasts a restart of the service.

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
            except (Unreachable, httpx2.TransportError):
                if time.monotonic() > give_up:
                    raise Unreachable(f"the events from {self.url} broke off") from None
            time.sleep(_PAUSE_S)

    def history(self, job_id: str) -> list[JobEvent]:
        """What has happened to the job so far, without progress."""
        items = self._json("GET", f"/api/v1/jobs/{part(job_id)}/events")["items"]
        return [JobEvent.of(item["kind"], item) for item in items]

    def _streamed(self, path: str, known: int) -> Iterator[JobEvent | None]:
        """The events of one connection after number `known`; None when there will be no more of them."""
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
                elif not line and data:
                    yield JobEvent.of(kind, json.loads(data))
                    kind, data = "", ""

    def train_model(self, data: str, *, kind: str = "elm", **settings: Any) -> JobStatus:
        """Queue a training on the data set that `data` names, artefact:ID. settings: those of its kind, split, samples,
        name, priority, timeout_s. The model of the job that succeeded is `model(job.metrics["model"])`."""
        return JobStatus.of(self._json("POST", "/api/v1/models/train", json={"data": data, "kind": kind, **settings}))

    def delete(self, job_id: str) -> None:
        """Forget a job that has ended, with all its files."""
        self._request("DELETE", f"/api/v1/jobs/{part(job_id)}")

    def metrics(self, job_id: str) -> dict[str, Any]:
        """Metrics, timing and digest of a finished job."""
        return dict(self._json("GET", f"/api/v1/jobs/{part(job_id)}/metrics"))

    def recording(self, job_id: str, path: Path) -> Path:
        """Download the recording; of a running job, as it grows until the job ends. Returns `path`."""
        return self._download(f"/recordings/{part(job_id)}.rrd", path)

    def series(self, job_id: str, path: Path) -> Path:
        """Download series.npz (open it with numpy.load). Returns `path`."""
        return self._download(f"/api/v1/jobs/{part(job_id)}/series?format=npz", path)

    def verify(self, job_id: str, observer: Observer | None = None) -> Verdict:
        """Run the job's scenario again in this process and compare: identical, equal within 1e-6 mm, or different.

        Uploads that the scenario names are fetched. Raises CannotVerifyError when the job has no result, trained a
        model, or names an upload that the service no longer has.
        """
        from service.local.verify import CannotVerifyError, load_series, verify

        job = self.job(job_id)
        if job.result is None:
            raise CannotVerifyError(f"job {job_id} is {job.state}: it has no result")
        if job.scenario is None:
            raise CannotVerifyError(f"job {job_id} trained a model: train it again, the same SHA-256 must come out")
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            for field_name, upload_id in references(dict(job.scenario)):
                self._fetched(upload_id, folder, f"{field_name} of job {job_id}")
            series = load_series(self.series(job_id, folder / "series.npz"))
            return verify(job.result, series, observer, uploads=folder)

    def _fetched(self, upload_id: str, folder: Path, what: str) -> Path:
        from service.local.verify import CannotVerifyError

        try:
            return self.upload_file(upload_id, folder / upload_id)
        except ServiceError as error:
            if error.status != 404:
                raise
            raise CannotVerifyError(f"{what} names the upload {upload_id}, which the service no longer has") from None

    def log(self, job_id: str) -> str:
        """What the job's last attempt logged so far."""
        return self._request("GET", f"/api/v1/jobs/{part(job_id)}/log").text

    def artefacts(self, job_id: str) -> list[dict[str, Any]]:
        """The files that the job left: kind, name, bytes, sha256 and url of each."""
        return list(self._json("GET", f"/api/v1/jobs/{part(job_id)}/artefacts")["items"])

    def clear(self, *, dry_run: bool = False, **policy: float | None) -> dict[str, Any]:
        """Clear away jobs that have ended: older_than_s, keep_last, max_bytes. What went, or would go."""
        body = {**{name: value for name, value in policy.items() if value is not None}, "dry_run": dry_run}
        return dict(self._json("POST", "/api/v1/gc", json=body))

    def upload(self, path: Path, *, kind: str | None = None) -> Uploaded:
        """Send a tissue mesh, a model or a data set; kind: mesh, model or dataset, by default what the suffix says. The
        same content sent again is the same upload. A scenario or a training names it by its `reference`."""
        kind = kind or {".json": "model", ".npz": "dataset"}.get(path.suffix.lower(), "mesh")
        with path.open("rb") as file:
            headers = {"Content-Type": "application/octet-stream"}
            params = {"kind": kind, "name": path.name}
            raw = self._json("POST", "/api/v1/uploads", params=params, content=file, headers=headers, timeout=300.0)
        return Uploaded.of(raw)

    def upload_file(self, upload_id: str, path: Path) -> Path:
        """Download what was sent in. Returns `path`."""
        return self._download(f"/api/v1/uploads/{part(upload_id)}/content", path)

    def pin_upload(self, upload_id: str) -> Uploaded:
        """Keep it whatever is cleared away."""
        return Uploaded.of(self._json("POST", f"/api/v1/uploads/{part(upload_id)}/pin"))

    def unpin_upload(self, upload_id: str) -> None:
        """Keep it no longer."""
        self._request("DELETE", f"/api/v1/uploads/{part(upload_id)}/pin")

    def uploads(self) -> list[Uploaded]:
        """What was sent in, newest first."""
        return [Uploaded.of(raw) for raw in self._json("GET", "/api/v1/uploads", params={"limit": 1000})["items"]]

    def delete_upload(self, upload_id: str) -> None:
        """Delete an upload that is not pinned and that no queued or running job names."""
        self._request("DELETE", f"/api/v1/uploads/{part(upload_id)}")

    def scenarios(self) -> dict[str, str]:
        """Built-in scenarios: name -> one line on it."""
        found = self._json("GET", "/api/v1/scenarios")["items"]
        return {item["name"]: item["description"] for item in found}

    def ready(self) -> dict[str, Any]:
        """What /readyz says."""
        return dict(self._json("GET", "/readyz"))
