"""From a request to a campaign: the suite or grid that it names, its jobs, and what they will cost."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, model_validator

from benchmarks.grid.suite import grid
from benchmarks.suites.catalogue import suite
from service.admission.admission import checked_apart, names_mesh
from service.admission.cost import Cost, check_cost, time_limit_s
from service.files.upload_names import UploadLookup
from service.store.campaign import CampaignPlan, PlannedJob
from service.store.job import TIME_LIMIT, Label, TimeLimit, content_hash
from simcore.errors import Problem, ScenarioError
from simcore.file_names import names_mean
from simcore.scenario.presets import start
from simcore.scenario.scenario import Scenario

if TYPE_CHECKING:
    from pathlib import Path

    from benchmarks.cases import Case, Suite
    from service.settings import Limits

MOST_POSES = 200_000  # inline, of all cases of a campaign together: about 10 MB
LOW_PRIORITY = -10  # single jobs, which people wait for, go first


class CampaignRequest(BaseModel):
    """What a campaign runs: a named suite, or a grid over a scenario."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={
            "examples": [
                {"suite": "lin100-v2-smoke"},
                {
                    "name": "gain and stiffness",
                    "scenario": "line",
                    "grid": {"controller.gain": [0.5, 1.0], "tissue.young_kpa": [3.0, 6.3]},
                },
            ]
        },
    )

    name: Label | None = Field(None, description="Its name in lists; default: the suite's name, or grid.")
    suite: Annotated[str, StringConstraints(min_length=1, max_length=100)] | None = Field(
        None, description="Name of a suite; /api/v1/suites lists them."
    )
    model: Annotated[str, StringConstraints(min_length=1, max_length=200)] = Field(
        "default", description="Model of the suite's learned controllers: default, or artefact:ID of an upload."
    )
    scenario: dict[str, Any] | str | None = Field(
        None, description="Scenario under the grid, or the name of a built-in one; default: all defaults."
    )
    grid: dict[str, list[Any]] | None = Field(
        None, description="Dotted path of a scenario field or block -> its values; every combination is a job."
    )
    priority: Annotated[int, Field(strict=True, ge=-100, le=100)] = Field(
        LOW_PRIORITY, description="Of each job; higher runs first. Single jobs have 0 by default."
    )
    timeout_s: TimeLimit | None = Field(None, description=f"Of each job. {TIME_LIMIT}")

    @model_validator(mode="after")
    def _suite_or_grid(self) -> CampaignRequest:
        if (self.suite is None) == (self.grid is None):
            raise ValueError("must have either suite or grid")
        if self.suite is not None and self.scenario is not None:
            raise ValueError("has a scenario, which only a grid may have; a suite brings its own")
        return self


def suite_of(request: CampaignRequest) -> Suite:
    """The requested cases. Raises ScenarioError."""
    if request.suite is not None:
        return suite(request.suite, model=request.model)
    base = request.scenario or {}
    data = start(base) if isinstance(base, str) else base
    return grid(data, request.grid or {}, name=request.name or "grid")


@dataclass(frozen=True)
class Planner:
    """Turns requests into campaigns. uploads: folder of the files that scenarios may name; limits: of each job."""

    uploads: Path
    limits: Limits

    def plan(self, request: CampaignRequest) -> CampaignPlan:
        """The campaign with all of its jobs. Raises ScenarioError, also for a job that would cost too much, and
        AdmissionBusyError."""
        asked = request.model_dump(mode="json", exclude_defaults=True)
        if not names_mesh(asked):
            return planned(request, self.uploads, self.limits)
        told = checked_apart("campaign", asked, self.uploads, self.limits)
        jobs = tuple(PlannedJob(**job) for job in told["jobs"])
        return CampaignPlan(**{**told, "jobs": jobs, "uploads": tuple(told["uploads"])})

    def of_stored(self, request: dict[str, Any]) -> CampaignPlan:
        """The campaign of a stored request. Raises ScenarioError."""
        return self.plan(CampaignRequest.model_validate(request))


def planned(request: CampaignRequest, uploads: Path, limits: Limits) -> CampaignPlan:
    """`Planner.plan` in this process."""
    with names_mean(lookup := UploadLookup(uploads)):
        plan = _plan(request, limits)
    return replace(plan, uploads=tuple(sorted(lookup.used)))


def _plan(request: CampaignRequest, limits: Limits) -> CampaignPlan:
    cases = suite_of(request)
    if not cases.cases:
        raise ScenarioError([Problem("suite", cases.name, "has no cases")])
    _check_poses(cases)
    jobs, costs = zip(*(_job(case, limits) for case in cases.cases), strict=True)
    return CampaignPlan(
        name=request.name or cases.name,
        request=request.model_dump(mode="json", exclude_defaults=True),
        suite=cases.name,
        suite_sha256=cases.sha256,
        priority=request.priority,
        timeout_s=time_limit_s(request.timeout_s, *costs),
        cost_s=sum(cost.time_s for cost in costs),
        jobs=jobs,
    )


def _check_poses(cases: Suite) -> None:
    """Raises ScenarioError for a campaign that would keep a list of poses with each of very many jobs."""
    total = 0
    for case in cases.cases:
        controller = case.scenario.get("controller")
        inline = controller.get("poses") if isinstance(controller, dict) else None
        total += len(inline) if isinstance(inline, list | tuple) else 0
    if total > MOST_POSES:
        message = f"are repeated by each case, {total} in all, at most {MOST_POSES}: name them in controller.poses_file"
        raise ScenarioError([Problem("scenario.controller.poses", f"{len(cases.cases)} cases", message)])


def _job(case: Case, limits: Limits) -> tuple[PlannedJob, Cost]:
    scenario = Scenario.load(case.scenario)
    cost = check_cost(scenario, limits)
    job = PlannedJob(
        case_id=case.id,
        labels=case.labels,
        name=case.id[:100],
        spec={"scenario": case.scenario},
        spec_hash=content_hash(case.scenario),
        steps=scenario.steps,
    )
    return job, cost
