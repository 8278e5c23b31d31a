"""What the list of jobs shows, and the address that keeps it: search, order, groups, columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import Annotated, Any, Literal, NamedTuple
from urllib.parse import urlencode

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from service.api.schemas.jobs import JobSummary, Outcome, State
from service.store.job_lists import LONGEST_CURSOR, JobFilter, JobOrder, Sort

ColumnName = Literal[
    "state", "progress", "depth", "tip_error", "rmse", "rcm", "push", "lateral", "drag", "strain", "stress",
    "note", "priority", "attempt", "submitted", "finished", "duration",
]  # fmt: skip


class Column(NamedTuple):
    """A column of the list. sort: what a click on its title sorts by, None for nothing; down: the largest first at the
    first click. spare: left out where there is little space, unless it was chosen. usual: shown where none is chosen.
    """

    heading: str
    sort: Sort | None = None
    down: bool = False
    numeric: bool = True
    spare: bool = True
    usual: bool = True


COLUMNS: dict[ColumnName, Column] = {
    "state": Column("State", "state", numeric=False, spare=False),
    "progress": Column("Progress", numeric=False, spare=False),
    "depth": Column("Depth", usual=False),
    "tip_error": Column("Tip error", spare=False),
    "rmse": Column("RMSE", "rmse", spare=False),
    "rcm": Column("RCM error, mm", "rcm"),
    "push": Column("Push, N", "push"),
    "lateral": Column("Lateral force, N", "lateral"),
    "drag": Column("Entry drag, mm", "drag"),
    "strain": Column("Strain", "strain"),
    "stress": Column("Needle stress, MPa", "stress"),
    "note": Column("Note", numeric=False, usual=False),
    "priority": Column("Priority", "priority", down=True, usual=False),
    "attempt": Column("Attempts", "attempt", down=True, usual=False),
    "submitted": Column("Submitted", "submitted", down=True, numeric=False),
    "finished": Column("Ended", "finished", down=True, numeric=False, usual=False),
    "duration": Column("Took", "duration", down=True, usual=False),
}
_USUAL = [name for name, column in COLUMNS.items() if column.usual]


def _absent(value: Any) -> Any:
    return None if value == "" else value


class JobList(BaseModel):
    """The list as its address says it.

    every: with the jobs of campaigns, one by one. group: those of a campaign stand together. sort: None for the newest
    first, what runs before all others. column: what is shown, none for the usual ones.
    """

    model_config = ConfigDict(frozen=True, populate_by_name=True)

    state: Annotated[State | None, BeforeValidator(_absent)] = None
    outcome: Annotated[Outcome | None, BeforeValidator(_absent)] = None
    search: Annotated[str, Field(alias="q", max_length=100)] = ""
    tag: Annotated[str | None, Field(max_length=40), BeforeValidator(_absent)] = None
    every: Annotated[bool, Field(alias="all")] = False
    group: Annotated[Literal["campaign"] | None, BeforeValidator(_absent)] = None
    sort: Annotated[Sort | None, BeforeValidator(_absent)] = None
    down: bool = False
    column: Annotated[list[ColumnName], Field(max_length=50)] = []
    cursor: Annotated[str | None, Field(pattern="^[0-9A-Za-z_-]+$", max_length=LONGEST_CURSOR)] = None

    @property
    def filtered(self) -> bool:
        """Whether it is a part of the jobs by what they are."""
        return bool(self.search.strip() or self.state or self.outcome or self.tag)

    @property
    def alone(self) -> bool:
        """Whether the jobs of campaigns are left out: each campaign is one line above the list."""
        return not (self.every or self.group or self.filtered)

    @property
    def running_first(self) -> bool:
        """Whether what runs stands before all others."""
        return not (self.cursor or self.state or self.outcome or self.sort or self.group)

    def filter(self, **changes: Any) -> JobFilter:
        """Which jobs it asks the store for."""
        wanted = {"state": self.state, "outcome": self.outcome, "tag": self.tag}
        return JobFilter(**{**wanted, "containing": self.search.strip(), "alone": self.alone, **changes})

    def order(self) -> JobOrder:
        """In which order."""
        grouped = self.group is not None
        return (
            JobOrder(grouped=grouped)
            if self.sort is None
            else JobOrder(sort=self.sort, down=self.down, grouped=grouped)
        )

    def columns(self) -> dict[ColumnName, Column]:
        """What is shown, by name."""
        chosen = set(self.column or _USUAL)
        return {name: column for name, column in COLUMNS.items() if name in chosen}

    def url(self, **changes: Any) -> str:
        """The address of the list with some changes, from its first page on."""
        now = self.model_copy(update={"cursor": None, **changes})
        usual = not now.column or set(now.column) == set(_USUAL)
        said: list[tuple[str, Any]] = [
            ("state", now.state),
            ("outcome", now.outcome),
            ("q", now.search.strip()),
            ("tag", now.tag),
            ("all", "1" if now.every else None),
            ("group", now.group),
            ("sort", now.sort),
            ("down", "1" if now.sort and now.down else None),
            *(("column", name) for name in (() if usual else now.columns())),
            ("cursor", now.cursor),
        ]
        query = urlencode([(name, value) for name, value in said if value])
        return f"/?{query}" if query else "/"

    def sorted_url(self, column: Column) -> str:
        """The address behind the title of a column: sorted by it, the other way round at the second click."""
        down = not self.down if self.sort == column.sort else column.down
        return self.url(sort=column.sort, down=down)


class Group(NamedTuple):
    """Jobs below one heading. campaign: id and name; None for single jobs, and where nothing is grouped."""

    campaign: tuple[str, str] | None
    jobs: list[JobSummary]


def grouped(jobs: Sequence[JobSummary], campaign_of: Mapping[str, tuple[str, str]], shown: JobList) -> list[Group]:
    """The jobs in their order, under a heading for each campaign where that is asked for."""
    if shown.group is None:
        return [Group(None, list(jobs))]
    return [Group(one, list(members)) for one, members in groupby(jobs, lambda job: campaign_of.get(job.id))]
