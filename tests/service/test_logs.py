from __future__ import annotations

import io
import json
import logging
import re
import warnings
from typing import TYPE_CHECKING

import pytest

from service import logs
from service.logs import configure, job_log, request_id
from tests.service.http import idle_service

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

LOG = logging.getLogger("needlebench")


@pytest.fixture(autouse=True)
def _as_before() -> Iterator[None]:
    root = logging.getLogger()
    handlers, level, own = root.handlers[:], root.level, LOG.level
    yield
    root.handlers[:] = handlers
    root.setLevel(level)
    LOG.setLevel(own)


def test_json_lines_name_the_job_and_the_request() -> None:
    stream = io.StringIO()
    configure("json", stream=stream)
    token = request_id.set("abc")
    LOG.info("job %s begins", "j1", extra={"job": "j1", "attempt": 2})
    request_id.reset(token)
    try:
        raise ValueError("asked to")
    except ValueError:
        LOG.exception("failed")
    first, second = (json.loads(line) for line in stream.getvalue().splitlines())
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z", first.pop("time"))
    assert first == {
        "level": "info",
        "logger": "needlebench",
        "message": "job j1 begins",
        "job": "j1",
        "attempt": 2,
        "request_id": "abc",
    }
    assert "ValueError: asked to" in second["exception"]


def test_text_holds_warnings_only() -> None:
    stream = io.StringIO()
    configure("text", stream=stream)
    LOG.info("quiet")
    LOG.warning("loud")
    assert stream.getvalue() == "WARNING loud\n"


def test_a_job_log_holds_what_is_logged_warned_and_printed(tmp_path: Path) -> None:
    with job_log(tmp_path / "job.log"):
        LOG.info("begun")
        print("half a ", end="")
        print("line")
        warnings.simplefilter("always")
        warnings.warn("careful", stacklevel=1)
    LOG.warning("afterwards")
    lines = (tmp_path / "job.log").read_text().splitlines()
    assert [line.partition(" ")[2] for line in lines] == [
        "INFO begun",
        "INFO half a line",
        "WARNING UserWarning: careful",
    ]


def test_a_job_log_stops_growing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(logs, "MAXIMUM_BYTES", 2000)
    with job_log(tmp_path / "job.log"):
        for _ in range(1000):
            print("x" * 50)
    text = (tmp_path / "job.log").read_text()
    assert len(text) < 3000
    assert text.endswith("the log is full: the rest is left out\n")


def test_a_job_log_takes_any_text_and_cuts_a_trace_that_is_too_long(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(logs, "MAXIMUM_BYTES", 2000)
    with job_log(tmp_path / "job.log"):
        LOG.error("half a pair: %s", "\ud800")
        LOG.error("it failed", exc_info=ValueError("x" * 10_000))
    text = (tmp_path / "job.log").read_text()
    assert "half a pair: \\ud800\n" in text
    assert "it failed\nValueError: xxx" in text
    assert len(text) < 2100
    assert text.endswith("the log is full: the rest is left out\n")


def test_a_request_has_an_id_in_its_answer_and_in_the_log(tmp_path: Path) -> None:
    stream = io.StringIO()
    configure("json", stream=stream)
    with idle_service(tmp_path) as (http, _):
        assert http.get("/healthz", headers={"X-Request-Id": "mine-1"}).headers["x-request-id"] == "mine-1"
        made = http.get("/nothing", headers={"X-Request-Id": "bad id\t"}).headers["x-request-id"]
    assert re.fullmatch("[0-9a-f]{16}", made)
    told = [json.loads(line) for line in stream.getvalue().splitlines()]
    found = [(line["path"], line["status"], line["request_id"]) for line in told if "path" in line]
    assert found == [("/healthz", 200, "mine-1"), ("/nothing", 404, made)]
