"""Lists of jobs: those that are asked for, in any order, page by page."""

from __future__ import annotations

import base64
import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, get_args

from sqlalchemy import ColumnElement, Select, and_, case, exists, false, func, or_, select

from service.store import schema
from service.store.job import OUTCOMES
from service.store.job_queries import JOB, LISTED, JobQueries, to_job
from service.store.paging import Page
from service.store.schema import campaign, campaign_case
from simcore.errors import NeedlebenchError, Problem

if TYPE_CHECKING:
    from service.store.job import Job

Sort = Literal[
    "submitted", "name", "state", "priority", "attempt", "finished", "duration",
    "rmse", "rcm", "push", "lateral", "drag", "strain", "stress",
]  # fmt: skip
SORTS: tuple[Sort, ...] = get_args(Sort)
LONGEST_CURSOR = 1000


def _metric(name: str) -> ColumnElement[Any]:
    value: ColumnElement[Any] = JOB.c.metrics[name].as_float()
    return value


_VALUES: dict[Sort, tuple[ColumnElement[Any], Any]] = {  # what is sorted by, and what stands for none
    "submitted": (JOB.c.seq, 0),
    "name": (func.lower(JOB.c.name), ""),
    "state": (func.coalesce(JOB.c.outcome, JOB.c.state), ""),
    "priority": (JOB.c.priority, 0),
    "attempt": (JOB.c.attempt, 0),
    "finished": (JOB.c.finished_at, 0.0),
    "duration": (JOB.c.finished_at - JOB.c.started_at, 0.0),
    "rmse": (_metric("rmse_commanded_mm"), 0.0),
    "rcm": (_metric("rcm_max_mm"), 0.0),
    "push": (_metric("max_push_n"), 0.0),
    "lateral": (_metric("max_lateral_n"), 0.0),
    "drag": (_metric("entry_drag_mm"), 0.0),
    "strain": (_metric("max_strain"), 0.0),
    "stress": (_metric("max_needle_stress_mpa"), 0.0),
}
_CAMPAIGN_SEQ: ColumnElement[Any] = func.coalesce(
    select(campaign.c.seq)
    .where(campaign_case.c.job_id == JOB.c.id, campaign.c.id == campaign_case.c.campaign_id)
    .scalar_subquery(),
    0,
)


class CursorError(NeedlebenchError):
    """A cursor that is not one of this list in this order; `problems` names it."""

    def __init__(self, cursor: str) -> None:
        one = Problem("cursor", cursor, "must be the next_cursor of a page of this list in this order")
        self.problems = [one]
        super().__init__(f"{one.field}: {one.message}")


@dataclass(frozen=True, kw_only=True)
class JobFilter:
    """Which jobs are asked for.

    name: the whole name. tag: one of its tags. campaign: id of the one that they belong to. alone: only those that
    belong to none. containing: a part of the name or of a tag, whatever its case, or the beginning of the id.
    """

    state: str | None = None
    outcome: str | None = None
    name: str | None = None
    tag: str | None = None
    campaign: str | None = None
    containing: str = ""
    alone: bool = False

    def of(self, query: Select[Any]) -> Select[Any]:
        """The query for these alone."""
        for column, wanted in ((JOB.c.state, self.state), (JOB.c.outcome, self.outcome), (JOB.c.name, self.name)):
            if wanted is not None:
                query = query.where(column == wanted)
        if self.containing:
            text = self.containing.lower()
            within = func.instr(func.lower(JOB.c.name), text) > 0
            begins = JOB.c.id.startswith(self.containing, autoescape=True)
            query = query.where(within | begins | _has_tag(lambda tag: func.instr(func.lower(tag), text) > 0))
        if self.tag is not None:
            query = query.where(_has_tag(lambda tag: tag == self.tag))
        if self.alone:
            query = query.where(~exists().where(campaign_case.c.job_id == JOB.c.id))
        if self.campaign is not None:
            of_it = select(campaign_case.c.job_id).where(campaign_case.c.campaign_id == self.campaign)
            query = query.where(JOB.c.id.in_(of_it))
        return query


def _has_tag(fits: Any) -> ColumnElement[bool]:
    tags = func.json_each(JOB.c.tags).table_valued("value")
    return select(tags.c.value).where(fits(tags.c.value)).exists()


class _Key(NamedTuple):
    """One of the values that an order goes by; never null."""

    value: ColumnElement[Any]
    down: bool


@dataclass(frozen=True, kw_only=True)
class JobOrder:
    """In which order jobs are listed. sort: those without such a value come last, whichever way it goes; of equal ones
    the newest is first. grouped: the jobs of a campaign stand together, the newest campaign first, single ones last."""

    sort: Sort = "submitted"
    down: bool = True
    grouped: bool = False

    @property
    def plain(self) -> bool:
        """Whether it is that of arrival, newest first."""
        return self.sort == "submitted" and self.down and not self.grouped

    def keys(self) -> list[_Key]:
        """What it goes by."""
        value, none = _VALUES[self.sort]
        own = [
            _Key(case((value.is_(None), 1), else_=0), False),
            _Key(func.coalesce(value, none), self.down),
            _Key(JOB.c.seq, True),
        ]
        return [_Key(_CAMPAIGN_SEQ, True), *own] if self.grouped else own

    def cursor_of(self, values: list[Any]) -> str:
        """Where the rows after one with these values of the keys begin."""
        text = json.dumps([self.sort, self.down, self.grouped, *values], separators=(",", ":"))
        return base64.urlsafe_b64encode(text.encode()).decode().rstrip("=")

    def values_of(self, cursor: str) -> list[Any]:
        """The values of the keys that a cursor holds. Raises CursorError for one of another order, or of none."""
        try:
            whole = json.loads(base64.urlsafe_b64decode(cursor + "=" * (-len(cursor) % 4)))
            mine, values = whole[:3], whole[3:]
        except (ValueError, TypeError, KeyError):
            mine, values = [], []
        fits = all(isinstance(value, str | int | float) for value in values)
        if mine != [self.sort, self.down, self.grouped] or len(values) != len(self.keys()) or not fits:
            raise CursorError(cursor)
        return list(values)


EVERY, ARRIVAL = JobFilter(), JobOrder()


def _after(keys: list[_Key], values: list[Any]) -> ColumnElement[bool]:
    """Whether a row comes after one with these values of the keys."""
    later: ColumnElement[bool] = false()
    for key, value in zip(reversed(keys), reversed(values), strict=True):
        beyond = key.value < value if key.down else key.value > value
        later = or_(beyond, and_(key.value == value, later))
    return later


class JobLists(JobQueries):
    """Lists of jobs without their specs and results."""

    def page(
        self, wanted: JobFilter = EVERY, order: JobOrder = ARRIVAL, *, size: int = 50, cursor: str | None = None
    ) -> Page[Job]:
        """A page of jobs. What arrives or ends between two pages makes no other row come twice or be left out.

        Raises CursorError for a cursor of another order.
        """
        keys = [_Key(JOB.c.seq, True)] if order.plain else order.keys()
        values = [key.value.label(f"key_{number}") for number, key in enumerate(keys)]
        query = wanted.of(select(*LISTED, *values))
        if cursor is not None:
            query = query.where(_after(keys, [_number(cursor)] if order.plain else order.values_of(cursor)))
        ordered = query.order_by(*(key.value.desc() if key.down else key.value for key in keys)).limit(size + 1)
        with self.reading() as connection:
            rows = connection.execute(ordered).all()  # one more, to know whether others follow
        following = None
        if len(rows) > size:
            last = list(rows[size - 1][-len(keys) :])
            following = str(last[0]) if order.plain else order.cursor_of(last)
        return Page([to_job(row) for row in rows[:size]], following)

    def counts(self) -> dict[str, int]:
        """How many jobs there are in each state, those with none included."""
        query = select(JOB.c.state, func.count().label("jobs")).group_by(JOB.c.state)
        with self.reading() as connection:
            found = {row.state: row.jobs for row in connection.execute(query)}
        return {state: found.get(state, 0) for state in schema.STATES}

    def outcomes(self) -> dict[str, int]:
        """How many jobs finished with each outcome, those with none left out; in the order of `OUTCOMES`."""
        query = select(JOB.c.outcome, func.count().label("jobs")).where(JOB.c.outcome.is_not(None))
        with self.reading() as connection:
            found = {row.outcome: row.jobs for row in connection.execute(query.group_by(JOB.c.outcome))}
        return {outcome: found[outcome] for outcome in OUTCOMES if outcome in found}


def _number(cursor: str) -> int:
    if not (cursor.isascii() and cursor.isdigit() and len(cursor) <= 18):
        raise CursorError(cursor)
    return int(cursor)
