"""kill -9 of the server around the ticks of schedules: each tick has one outcome, as its catch-up rule says."""

from __future__ import annotations

import signal
import sqlite3
import time
from collections import Counter, defaultdict
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from service.store.schedule import GRACE_S, MISSED, STARTED
from tests.acceptance.server import Server, until
from tests.chaos import fast_clock

if TYPE_CHECKING:
    import random
    from pathlib import Path

    import pytest

MINUTE_S = 60.0
SLACK_S = 60.0  # of the fast clock, between reading it for a look and writing what was fired
RULES = ("skip", "latest", "all")
Runs = list[dict[str, Any]]


def started(data: Path) -> Server:
    return Server(data, main=fast_clock.__name__)


def add_schedules(server: Server) -> None:
    """One for each catch-up rule, each due every minute, each tick a campaign of one short job."""
    campaign = {"grid": {"name": ["quick"]}}  # an axis of names keeps them
    for rule in RULES:
        body = {"name": rule, "cron": "* * * * *", "catchup": rule, "overlap": "allow", "campaign": campaign}
        server.client._json("POST", "/api/v1/schedules", json=body)


def wait_for_a_tick(chance: random.Random) -> None:
    """Until a little before or after the next look at the clock that finds a tick."""
    left_s = (MINUTE_S - fast_clock.now() % MINUTE_S) / fast_clock.SPEED
    time.sleep(max(0.0, left_s + chance.uniform(-0.3, 1.3)))


def ask(data: Path, query: str) -> Runs:
    connection = sqlite3.connect(data / "needlebench.sqlite")
    connection.row_factory = sqlite3.Row
    try:
        return [dict(row) for row in connection.execute(query)]
    finally:
        connection.close()


def history(data: Path) -> dict[str, Runs]:
    """Ticks by the schedule's name, in their order."""
    query = """SELECT s.name, r.* FROM schedule_run r JOIN schedule s ON s.id = r.schedule_id
    ORDER BY r.scheduled_for"""
    found: dict[str, Runs] = defaultdict(list)
    for row in ask(data, query):
        found[row["name"]].append(row)
    return found


def check_rule(rule: str, runs: Runs) -> None:
    """No minute is left out and none is there twice; what was not in time is fired as the rule says."""
    moments = [run["scheduled_for"] for run in runs]
    assert all(later - one == MINUTE_S for one, later in pairwise(moments)), (rule, moments)
    for run in runs:
        late = run["fired_at"] - run["scheduled_for"] > GRACE_S + SLACK_S
        in_time = run["fired_at"] - run["scheduled_for"] <= GRACE_S
        if rule == "all" or in_time:
            assert run["outcome"] == STARTED, (rule, run)
        elif rule == "skip" and late:
            assert run["outcome"] == MISSED, (rule, run)
    if rule == "latest":
        assert runs[-1]["outcome"] == STARTED
        for one, later in pairwise(runs):
            if one["outcome"] == MISSED:  # only because a later one of the same look was fired
                assert later["fired_at"] - one["fired_at"] < SLACK_S, (one, later)


def check_campaigns(data: Path, ticks: dict[str, Runs]) -> int:
    """Each started tick has one campaign with one job, and no campaign is of another tick; how many."""
    query = """SELECT c.id, c.schedule_id, c.scheduled_for, c.state, COUNT(k.job_id) AS jobs
    FROM campaign c LEFT JOIN campaign_case k ON k.campaign_id = c.id GROUP BY c.id"""
    campaigns = {row["id"]: row for row in ask(data, query)}
    fired = [run for runs in ticks.values() for run in runs if run["outcome"] == STARTED]
    assert sorted(run["campaign_id"] for run in fired) == sorted(campaigns)
    for run in fired:
        made = campaigns[run["campaign_id"]]
        assert (made["schedule_id"], made["scheduled_for"]) == (run["schedule_id"], run["scheduled_for"])
        assert (made["state"], made["jobs"]) == ("done", 1)
    return len(campaigns)


def test_killed_around_ticks(
    tmp_path: Path, moments: int, chance: random.Random, figures: dict[str, object], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(fast_clock.STARTED, str(time.time()))
    server = started(tmp_path)
    add_schedules(server)
    for _ in range(moments):
        wait_for_a_tick(chance)
        server.stop(signal.SIGKILL)
        time.sleep(chance.choice([0.0, 0.0, 2.0, 5.0]))  # the longer ones miss ticks
        server = started(tmp_path)
    try:
        wait_for_a_tick(chance)
        for one in server.client._json("GET", "/api/v1/schedules")["items"]:
            server.client._json("PATCH", f"/api/v1/schedules/{one['id']}", json={"enabled": False})
        until(lambda: not ask(tmp_path, "SELECT 1 FROM campaign WHERE state = 'running'"), patience_s=300, pause_s=0.5)
    finally:
        server.stop()
    ticks = history(tmp_path)
    assert set(ticks) == set(RULES)
    for rule, runs in ticks.items():
        check_rule(rule, runs)
    outcomes = Counter(run["outcome"] for runs in ticks.values() for run in runs)
    assert set(outcomes) <= {STARTED, MISSED}
    figures.update(kills=moments, ticks=outcomes.total(), fired=outcomes[STARTED], missed=outcomes[MISSED])
    figures.update(campaigns=check_campaigns(tmp_path, ticks), twice=0, left_out=0)
