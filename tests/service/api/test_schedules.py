"""Schedules: the clock, missed ticks, overlaps; a tick fires once whatever happens in between."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.admission.campaign_planner import Planner
from service.settings import Limits
from service.store.campaigns import CampaignStore
from service.store.database import open_database
from service.store.jobs import Store
from service.store.schedule import GRACE_S, MOST_TICKS, next_tick, next_ticks, ticks, to_fire
from service.store.schedules import ScheduleStore
from simcore.errors import ScenarioError
from tests.service.databases import lay_down
from tests.service.http import idle_service

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from starlette.testclient import TestClient

    from service.api.context import Service

CAMPAIGN = {"grid": {"seed": [0]}}
HOUR = 3600.0


class Clock:
    """Stands still until it is moved."""

    def __init__(self, start: str) -> None:
        self.now = at(start)

    def __call__(self) -> float:
        return self.now


def at(text: str) -> float:
    return datetime.fromisoformat(text).replace(tzinfo=UTC).timestamp()


class Rig:
    """A store, its campaigns and schedules, and their clock; `reopen` is a server that was killed."""

    def __init__(self, path: Path) -> None:
        self.path, self.clock = path, Clock("2026-03-01T12:00")
        self.open()

    def open(self) -> None:
        self.store = Store(open_database(lay_down(self.path)), now=self.clock)
        self.campaigns = CampaignStore(self.store)
        self.schedules = ScheduleStore(self.store, self.campaigns)
        limits = Limits()
        self.planner = Planner(self.path.parent / "uploads", limits)

    def reopen(self) -> None:
        self.store.close()
        self.open()

    def add(self, **more: Any) -> str:
        values = {"name": "nightly", "cron": "0 * * * *", "timezone": "UTC", "catchup": "skip", "overlap": "allow"}
        return self.schedules.create({**values, "request": CAMPAIGN, "enabled": True, **more}).id

    def look(self, at_hours: float) -> list[str]:
        """Outcomes of the ticks that are due so many hours after the start."""
        self.clock.now = at("2026-03-01T12:00") + at_hours * HOUR
        return [run.outcome for run in self.schedules.fire_due(self.planner.of_stored)]

    def end_all(self) -> None:
        for one in self.campaigns.newest():
            self.campaigns.cancel(one.id)
        self.campaigns.settle()


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Rig]:
    made = Rig(tmp_path / "a.sqlite")
    yield made
    made.store.close()


# ---- the clock


@pytest.mark.parametrize(
    ("after", "expected"),
    [
        ("2026-03-28T12:00", "2026-03-29T01:00"),  # 02:30 does not exist in Berlin that night: 03:00 summer time
        ("2026-10-24T12:00", "2026-10-25T00:30"),  # 02:30 comes twice that night: the first
        ("2026-10-25T00:30", "2026-10-26T01:30"),  # and not the second
    ],
)
def test_clocks_that_are_put_forward_and_back(after: str, expected: str) -> None:
    assert next_tick("30 2 * * *", "Europe/Berlin", at(after)) == at(expected)


@pytest.mark.parametrize(
    ("cron", "zone", "field"),
    [
        ("every day", "UTC", "cron"),
        ("61 * * * *", "UTC", "cron"),
        ("* * * * * *", "UTC", "cron"),
        ("0 0 30 2 *", "UTC", "cron"),
        ("0 2 * * *", "Mars/Olympus", "timezone"),
        ("0 2 * * *", "../../etc/passwd", "timezone"),
    ],
)
def test_a_line_or_zone_that_is_wrong_is_named(cron: str, zone: str, field: str) -> None:
    with pytest.raises(ScenarioError) as refused:
        next_tick(cron, zone, 0.0)
    assert [problem.field for problem in refused.value.problems] == [field]


@pytest.mark.slow
@given(st.integers(1, 59), st.floats(0, 1e5))
def test_ticks_are_in_order_and_end_with_one_to_come(minutes: int, gap_s: float) -> None:
    line, start = f"*/{minutes} * * * *", at("2026-03-01T00:00")
    *due, following = ticks(line, "UTC", start, start + gap_s)
    assert due == sorted(set(due))
    assert due[0] == start
    assert following > due[-1]
    assert following > start + gap_s or len(due) == MOST_TICKS


def test_which_missed_ticks_are_run() -> None:
    due = [0.0, 100.0, 200.0]
    assert to_fire(due, 200.0 + GRACE_S, "skip") == {200.0}
    assert to_fire(due, 500.0, "skip") == set()
    assert to_fire(due, 500.0, "latest") == {200.0}
    assert to_fire(due, 500.0, "all") == set(due)


# ---- firing


def test_a_tick_fires_once_across_a_restart(rig: Rig) -> None:
    schedule = rig.add()
    assert rig.look(0.5) == []
    assert rig.look(1.0) == ["started"]
    rig.reopen()
    assert rig.look(1.01) == []
    assert rig.look(2.0) == ["started"]
    runs = rig.schedules.runs(schedule)
    assert [run.scheduled_for for run in runs] == [at("2026-03-01T14:00"), at("2026-03-01T13:00")]
    assert [one.schedule_id for one in rig.campaigns.newest()] == [schedule] * 2


def test_nothing_is_written_when_a_tick_breaks_half_way(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    schedule = rig.add()

    def broken(*_: Any, **__: Any) -> None:
        raise OSError("disk full")

    with monkeypatch.context() as patched:
        patched.setattr(CampaignStore, "_insert_jobs", broken)
        with pytest.raises(OSError, match="disk full"):
            rig.look(1.0)
    assert rig.campaigns.newest() == []
    assert rig.schedules.runs(schedule) == []
    assert rig.look(1.01) == ["started"]


def test_a_clock_that_is_set_back_fires_nothing_twice(rig: Rig) -> None:
    rig.add()
    assert rig.look(1.0) == ["started"]
    assert rig.look(-5.0) == []
    assert rig.look(1.0) == []


@pytest.mark.parametrize(
    ("catchup", "outcomes"),
    [
        ("skip", ["missed", "missed", "missed"]),
        ("latest", ["missed", "missed", "started"]),
        ("all", ["started", "started", "started"]),
    ],
)
def test_ticks_missed_while_the_server_was_down(rig: Rig, catchup: str, outcomes: list[str]) -> None:
    rig.add(catchup=catchup)
    assert rig.look(3.5) == outcomes
    assert rig.look(3.6) == []


def test_all_missed_ticks_one_after_the_other(rig: Rig) -> None:
    rig.add(catchup="all", overlap="forbid")
    assert rig.look(3.5) == ["started"]
    assert rig.look(3.6) == []  # the first still runs
    rig.end_all()
    assert rig.look(3.7) == ["started"]


def test_a_tick_that_meets_the_campaign_before(rig: Rig) -> None:
    rig.add(overlap="forbid")
    assert [rig.look(1.0), rig.look(2.0)] == [["started"], ["overlap"]]
    rig.end_all()
    assert rig.look(3.0) == ["started"]


def test_a_tick_that_replaces_the_campaign_before(rig: Rig) -> None:
    rig.add(overlap="replace")
    assert [rig.look(1.0), rig.look(2.0)] == [["started"], ["started"]]
    rig.campaigns.settle()
    assert [one.state for one in rig.campaigns.newest()] == ["running", "cancelled"]


def test_a_campaign_that_cannot_be_made_any_more_is_told(rig: Rig) -> None:
    schedule = rig.add(request={"suite": "gone-v1"})
    assert rig.look(1.0) == ["failed"]
    assert "gone-v1" in (rig.schedules.runs(schedule)[0].message or "")
    assert rig.look(2.0) == ["failed"]  # and tried again at the next tick


# ---- over HTTP


@pytest.fixture
def http(tmp_path: Path) -> Iterator[tuple[TestClient, Service]]:
    with idle_service(tmp_path) as both:
        yield both


def test_the_life_of_a_schedule(http: tuple[TestClient, Service]) -> None:
    client, _ = http
    body = {"name": "nightly", "cron": "0 2 * * *", "timezone": "Europe/Paris", "campaign": CAMPAIGN}
    made = client.post("/api/v1/schedules", json=body)
    assert made.status_code == 201
    url, tag = made.headers["location"], made.headers["etag"]
    assert client.post("/api/v1/schedules", json=body).status_code == 409
    changed = client.patch(url, json={"enabled": False}, headers={"If-Match": tag})
    assert changed.json()["next_run_at"] is None
    assert client.patch(url, json={"cron": "0 3 * * *"}, headers={"If-Match": tag}).status_code == 412
    assert client.patch(url, json={"cron": "0 3 * *"}).status_code == 422
    fired = client.post(f"{url}/trigger").json()
    assert fired["outcome"] == "started"
    assert client.get(f"{url}/runs").json()["items"] == [fired]
    assert client.get(f"/api/v1/campaigns/{fired['campaign']}").json()["schedule"] == made.json()["id"]
    assert client.post(f"{url}/trigger").json()["outcome"] == "overlap"
    assert client.delete(url).status_code == 204
    assert client.get(url).status_code == 404


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"cron": "* * *"}, "five fields"),
        ({"timezone": "Nowhere"}, "IANA"),
        ({"catchup": "some"}, "catchup"),
        ({"campaign": {"suite": "none-v1"}}, "none-v1"),
        ({"name": ""}, "name"),
    ],
)
def test_a_wrong_schedule_is_refused(http: tuple[TestClient, Service], change: dict[str, Any], words: str) -> None:
    client, _ = http
    body = {"name": "nightly", "cron": "0 2 * * *", "campaign": CAMPAIGN, **change}
    answer = client.post("/api/v1/schedules", json=body)
    assert answer.status_code == 422
    assert words in answer.text


def test_the_next_ticks_are_told_before_they_come() -> None:
    assert next_ticks("0 2 * * *", "UTC", 0.0, 3) == [7200.0, 93_600.0, 180_000.0]
    assert next_ticks("0 2 * * *", "UTC", 0.0, 0) == []
