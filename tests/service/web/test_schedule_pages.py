"""Cron lines in words, and what the pages of trends say of what could not be judged."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Any

import pytest

from service.api.schemas.campaigns import Trend, TrendLoss, TrendPoint
from service.store.schedule import in_words
from service.web.schedules import verdict_of
from tests.service.http import idle_service

if TYPE_CHECKING:
    from pathlib import Path

AT = datetime(2026, 11, 1, tzinfo=UTC)


@pytest.mark.parametrize(
    ("cron", "words"),
    [
        ("0 2 * * *", "At 02:00 every day"),
        ("*/15 8-17 * * 1-5", "Every 15th minute from 08:00 through 17:59 on Monday through Friday"),
        ("30 3 L * *", "At 03:30 on the last day of every month"),
    ],
)
def test_a_cron_line_in_words(cron: str, words: str) -> None:
    assert in_words(cron, "Europe/Paris") == words


@pytest.mark.slow
def test_the_page_and_the_preview_say_a_cron_line_in_words_with_its_next_moments(tmp_path: Path) -> None:
    with idle_service(tmp_path) as (http, service):
        body = {"name": "n", "cron": "0 2 * * 1", "timezone": "Europe/Paris", "campaign": {"suite": "lin100-v2-quick"}}
        assert http.post("/api/v1/schedules", json=body).json()["words"] == "At 02:00 on Monday"
        page = http.get("/schedules").text
        assert "At 02:00 on Monday, Europe/Paris <code>0 2 * * 1</code>" in page
        found = http.get("/api/v1/schedules/preview", params={"cron": "0 2 * * *"}).json()
        moments = [datetime.fromisoformat(one) for one in found["next"]]
        assert found["words"] == "At 02:00 every day"
        assert [moment - moments[0] for moment in moments] == [timedelta(days=n) for n in range(3)]
        assert 0 < moments[0].timestamp() - service.store.now <= 86_400
        for wrong, field in (({"cron": "0 25 * * *"}, "cron"), ({"cron": "0 2 * * *", "timezone": "x"}, "timezone")):
            answer = http.get("/api/v1/schedules/preview", params=wrong)
            assert (answer.status_code, answer.json()["errors"][0]["field"]) == (422, field)


def trend(losses: tuple[TrendLoss, ...] = (), **marks: str) -> Trend:
    whole: dict[str, Any] = {
        "campaign": "a", "at": AT, "commit": "c", "machine": "m", "cases": 4, "successes": 4, "median_rmse_mm": 0.1,
        "beside": {}, "step_ms": None, "accuracy_why": "1", "success_why": "2", "time_why": "3",
    }  # fmt: skip
    given = {"accuracy": "same", "success": "same", "time": "same", **marks}
    point = TrendPoint(**whole, **given, regression="worse" in given.values())
    return Trend(suite="s", points=[point], losses=list(losses))


@pytest.mark.parametrize(
    ("marks", "text", "open_"),
    [
        ({}, "no regression", []),
        ({"time": "better"}, "no regression", []),
        ({"time": "unjudged"}, "no regression in accuracy and success", ["time"]),
        ({"time": "unjudged", "accuracy": "unjudged"}, "no regression in success", ["accuracy", "time"]),
        (dict.fromkeys(("accuracy", "success", "time"), "unjudged"), "not judged yet", ["accuracy", "success", "time"]),
        ({"time": "worse", "accuracy": "unjudged"}, "got worse", ["accuracy"]),
    ],
)
def test_no_regression_is_said_of_what_could_be_judged_alone(
    marks: dict[str, str], text: str, open_: list[str]
) -> None:
    found = verdict_of(trend(**marks))
    assert (found.text, [name for name, _ in found.open]) == (text, open_)
    assert (found.state == "done") == text.startswith("no regression")


def test_a_loss_that_lasts_is_said() -> None:
    loss = TrendLoss(figure="accuracy", campaign="b", at=AT, commit=None, good_commit=None, why="w")
    assert verdict_of(trend((loss,))).text == "worse since 2026-11-01 00:00:00"
