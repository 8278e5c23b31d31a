"""The insertions of a campaign that has ended, downloaded: see `service.local.insertion_sets`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from benchmarks.cases import Case, Outcome
from service.client.connection import ServiceError
from service.files.upload_names import SCHEME
from service.local.insertion_sets import KEPT
from simcore.errors import Problem, ScenarioError
from simcore.file_names import NoSuchFileError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from service.client.client import Client

Json = dict[str, Any]


@dataclass
class CampaignInsertions:
    """Insertions of a campaign. scratch: folder of downloads."""

    client: Client
    suite: str
    outcomes: tuple[Outcome, ...]
    scratch: Path
    jobs: dict[str, str]  # case id -> job
    _digests: dict[str, str | None] = field(default_factory=dict)

    @property
    def kept(self) -> Path:
        """Where runs that are made again stay for a while."""
        return self.scratch / KEPT

    @property
    def folders(self) -> tuple[Path, ...]:
        """Where uploads are, once they were asked for."""
        return (self.scratch / "uploads",)

    @property
    def lookup(self) -> Callable[[str], Path]:
        """What names of files mean: uploads of the service."""
        return self._upload

    def _upload(self, name: str) -> Path:
        if not name.startswith(SCHEME):
            raise NoSuchFileError("is no upload of the service")
        file = self.scratch / "uploads" / name.removeprefix(SCHEME)
        if not file.is_file():
            file.parent.mkdir(parents=True, exist_ok=True)
            try:
                self.client.upload_file(file.name, file)
            except ServiceError as error:
                raise NoSuchFileError(f"is an upload that the service does not give: {error}") from None
        return file

    def series_file(self, case_id: str) -> Path | None:
        """The series of a case, downloaded."""
        if self.series_sha256(case_id) is None:
            return None
        file = self.scratch / "series" / f"{case_id}.npz"
        if not file.is_file():
            file.parent.mkdir(parents=True, exist_ok=True)
            self.client.series(self.jobs[case_id], file)
        return file

    def series_sha256(self, case_id: str) -> str | None:
        """SHA-256 of it, as the service says; None of a case that left none."""
        if case_id not in self._digests:
            found = [one for one in self.client.artefacts(self.jobs[case_id]) if one["kind"] == "series"]
            self._digests[case_id] = str(found[0]["sha256"]) if found else None
        return self._digests[case_id]


def download_campaign(client: Client, campaign_id: str, scratch: Path) -> CampaignInsertions:
    """All results of a campaign. Raises ScenarioError for one that is running, or of which a job was deleted."""
    campaign = client.campaign(campaign_id)
    if not campaign.terminal:
        message = f"is {campaign.state}: {campaign.ended} of {campaign.cases} jobs have ended; wait for the others"
        raise ScenarioError([Problem("CAMPAIGN", campaign_id, message)])
    outcomes, jobs = list[Outcome](), dict[str, str]()
    for one in client.campaign_cases(campaign_id):
        if one["job"] is None:
            message = f"the job of case {one['case']} was deleted: its suite is not whole any more"
            raise ScenarioError([Problem("CAMPAIGN", campaign_id, message)])
        jobs[one["case"]] = one["job"]
        outcomes.append(_outcome(client, one))
    return CampaignInsertions(client, campaign.suite, tuple(outcomes), scratch, jobs)


def _outcome(client: Client, one: Json) -> Outcome:
    job = client.job(one["job"])
    case = Case(one["case"], dict(job.scenario or {}), one["labels"])
    if job.result is not None:
        return Outcome(case, dict(job.result))
    error = job.error or {}
    status, metrics = str(error.get("kind") or job.state), {"stable": False, "success": False}
    result = {"status": status, "message": str(error.get("message", "")), "metrics": metrics, "digest": None}
    return Outcome(case, {**result, "timing": {}, "warnings": [], "provenance": {"scenario": case.scenario}})
