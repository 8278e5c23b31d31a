"""What the RFCs of HTTP ask of a server, and one code for each kind of problem."""

from __future__ import annotations

import ast
import gzip
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from service.api import problems
from service.api.middleware.compression import accepts_gzip
from service.api.problem_codes import CODES, code_of
from tests.service.http import finish, idle_service

if TYPE_CHECKING:
    from collections.abc import Iterator

    from starlette.testclient import TestClient

    from service.api.context import Service

JOBS, CAMPAIGNS, SCHEDULES, UPLOADS = (f"/api/v1/{name}" for name in ("jobs", "campaigns", "schedules", "uploads"))
SERVICE = Path(__file__).resolve().parents[3] / "service"
Both = tuple["TestClient", "Service"]


@pytest.fixture
def both(tmp_path: Path) -> Iterator[Both]:
    with idle_service(tmp_path) as pair:
        yield pair


@pytest.fixture
def http(both: Both) -> TestClient:
    return both[0]


# ---- codes


def test_each_kind_of_problem_has_a_code_of_its_own() -> None:
    codes = list(problems.CODE_OF.values())
    assert len(codes) == len(set(codes))
    assert set(codes) <= set(CODES)
    assert len({meaning for _, meaning in CODES.values()}) == len(CODES)


def test_every_code_that_is_written_down_is_known_and_every_known_one_is_used() -> None:
    used = set(problems.CODE_OF.values())
    for path in (SERVICE / "api").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Constant) and node.value in CODES and path.name != "problem_codes.py":
                used.add(node.value)
            if isinstance(node, ast.keyword) and node.arg == "code" and isinstance(node.value, ast.Constant):
                assert node.value.value in CODES, f"{path.name}: {node.value.value!r}"
    general = {code_of(status, None) for status in {status for status, _ in CODES.values()} - {409, 410, 429}}
    assert set(CODES) - used - general == set()


def test_a_code_and_a_status_that_disagree_are_refused() -> None:
    with pytest.raises(ValueError, match="queue-full has the status 429, not 503"):
        code_of(503, "queue-full")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "path", "code"),
    [
        ("GET", "/nothing", "not-found"),
        ("GET", f"{JOBS}/unknown", "job-unknown"),
        ("GET", f"{CAMPAIGNS}/unknown", "campaign-unknown"),
        ("GET", f"{SCHEDULES}/unknown", "schedule-unknown"),
        ("GET", f"{UPLOADS}/{'0' * 64}.msh", "upload-unknown"),
        ("GET", "/api/v1/models/nothing", "model-unknown"),
        ("GET", "/api/v1/keys/unknown", "key-unknown"),
        ("PUT", JOBS, "method-not-allowed"),
        ("GET", f"{JOBS}?limit=0", "invalid"),
        ("POST", "/api/v1/keys", "body-type"),
    ],
)
def test_a_problem_names_its_kind(http: TestClient, method: str, path: str, code: str) -> None:
    assert http.request(method, path).json()["code"] == code


# ---- requests


def test_two_host_headers_are_400(http: TestClient) -> None:
    answer = http.get(JOBS, headers=[("Host", "localhost"), ("Host", "evil.example")])
    assert (answer.status_code, answer.json()["code"]) == (400, "bad-host")


@pytest.mark.parametrize("path", [JOBS, f"{UPLOADS}?kind=model&name=a.json"])
def test_a_compressed_body_is_415(http: TestClient, path: str) -> None:
    body = gzip.compress(json.dumps({"scenario": "line"}).encode())
    headers = {"Content-Encoding": "gzip", "Content-Type": "application/json"}
    answer = http.post(path, content=body, headers=headers)
    assert (answer.status_code, answer.json()["code"]) == (415, "body-encoding")
    assert answer.headers["accept-encoding"] == "identity"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["a\r\nb", "a\x00b", "a\u202eb", "a\u2066b", "\u200f"])
def test_a_name_holds_no_line_ends_and_no_marks_of_direction(http: TestClient, name: str) -> None:
    campaign = {"name": name, "grid": {"seed": [0]}}
    schedule = {"name": name, "cron": "0 2 * * *", "campaign": {"grid": {"seed": [0]}}}
    training = {"name": name, "data": f"artefact:{'0' * 64}.npz"}
    requests: tuple[tuple[str, dict[str, Any]], ...] = (
        (CAMPAIGNS, campaign),
        (SCHEDULES, schedule),
        ("/api/v1/models/train", training),
        (JOBS, {"scenario": {"name": name}}),
    )
    for path, body in requests:
        answer = http.post(path, json=body)
        assert answer.status_code == 422, path
        assert any("name" in error["field"] for error in answer.json()["errors"]), path


def test_allow_names_every_method_of_the_address(http: TestClient) -> None:
    assert http.put(JOBS).headers["allow"] == "GET, HEAD, POST"
    assert http.put(f"{JOBS}/abc").headers["allow"] == "DELETE, GET, HEAD, PATCH"
    assert http.put(f"{SCHEDULES}/abc").headers["allow"] == "DELETE, GET, HEAD, PATCH"


# ---- answers


def test_lists_are_not_kept_by_caches(http: TestClient) -> None:
    for path in (JOBS, CAMPAIGNS, SCHEDULES, UPLOADS, "/api/v1/models", "/api/v1/suites", "/version", "/nothing"):
        assert http.get(path).headers["cache-control"] == "no-store"


@pytest.mark.slow
def test_text_is_compressed_for_those_who_take_it(both: Both) -> None:
    http, service = both
    job, *_ = [http.post(JOBS, json={"scenario": "line"}).json() for _ in range(3)]
    finish(service)
    for path in (JOBS, f"{JOBS}/{job['id']}", "/openapi.json", "/"):
        plain = http.get(path, headers={"Accept-Encoding": "identity"})
        packed = http.get(path, headers={"Accept-Encoding": "br, gzip"})
        assert "content-encoding" not in plain.headers
        assert packed.headers["content-encoding"] == "gzip"
        assert packed.headers["vary"] == plain.headers["vary"] == "Accept-Encoding"
        assert packed.text == plain.text
        assert int(packed.headers["content-length"]) < len(plain.content)
        head = http.head(path, headers={"Accept-Encoding": "gzip"})
        assert head.headers["content-length"] == packed.headers["content-length"]
    one = http.get(f"{JOBS}/{job['id']}", headers={"Accept-Encoding": "gzip"})
    assert one.headers["etag"].startswith('W/"')
    assert http.get(f"{JOBS}/{job['id']}", headers={"If-None-Match": one.headers["etag"]}).status_code == 304
    recording = http.get(f"/recordings/{job['id']}.rrd", headers={"Accept-Encoding": "gzip"})
    assert "content-encoding" not in recording.headers


@pytest.mark.parametrize(
    ("header", "taken"),
    [
        ("gzip", True),
        ("br;q=1.0, gzip;q=0.8", True),
        ("*", True),
        ("gzip;q=0", False),
        ("br", False),
        ("", False),
        ("*;q=0, gzip", True),
        ("gzip; Q=0.000, *", False),
        ("gzip;q=x", False),
        (" GZIP ;q=0.1,br", True),
    ],
)
def test_an_accept_encoding_is_read_as_it_is_meant(header: str, taken: bool) -> None:
    assert accepts_gzip(header) is taken


@pytest.mark.slow
def test_who_has_a_file_already_gets_304(both: Both) -> None:
    http, service = both
    job = http.post(JOBS, json={"scenario": "line"}).json()
    finish(service)
    base = f"{JOBS}/{job['id']}"
    for path in (f"{base}/artefacts/result.json", f"{base}/series?format=npz", f"/recordings/{job['id']}.rrd"):
        tag = http.get(path).headers["etag"]
        again = http.get(path, headers={"If-None-Match": tag})
        assert (again.status_code, again.content, again.headers["etag"]) == (304, b"", tag)
        assert http.get(path, headers={"If-None-Match": '"other"'}).status_code == 200


def test_a_range_in_an_unknown_unit_is_ignored(both: Both) -> None:
    http, service = both
    job = http.post(JOBS, json={"scenario": "line"}).json()
    finish(service)
    answer = http.get(f"/recordings/{job['id']}.rrd", headers={"Range": "lines=1-2"})
    assert (answer.status_code, answer.content) == (200, b"0123456789")
    assert http.get(f"/recordings/{job['id']}.rrd", headers={"Range": "bytes=1-2"}).content == b"12"


@pytest.mark.slow
@pytest.mark.parametrize("damage", ["cut", "changed"])
def test_a_damaged_file_is_a_problem_and_never_served_under_its_digest(both: Both, damage: str) -> None:
    http, service = both
    job = http.post(JOBS, json={"scenario": "line"}).json()
    done = finish(service)
    base = f"{JOBS}/{job['id']}"
    paths = (f"{base}/artefacts/series.npz", f"{base}/series", f"{base}/series?format=npz")
    assert [http.get(path).status_code for path in paths] == [200, 200, 200]
    file = service.settings.data / done.folder / "series.npz"
    data = file.read_bytes()
    file.write_bytes(data[: len(data) // 2] if damage == "cut" else data[:60] + bytes([data[60] ^ 1]) + data[61:])
    for path in paths:
        answer = http.get(path)
        assert (answer.status_code, answer.json()["code"]) == (410, "file-damaged")
        assert "etag" not in answer.headers
    file.unlink()
    for path in paths:
        answer = http.get(path)
        assert (answer.status_code, answer.json()["code"]) == (404, "file-missing")


@pytest.mark.parametrize("asked", ["bytes=+1-+3", "bytes=1_0-2_0", "bytes =0-3", "bytes=0x1-0x2", "bytes=\xb2-\xb3"])
def test_a_range_whose_numbers_are_none_of_http_is_refused(both: Both, asked: str) -> None:
    http, service = both
    http.post(JOBS, json={"scenario": "line"})
    job = finish(service)
    answer = http.get(f"/recordings/{job.id}.rrd", headers=[(b"Range", asked.encode("latin-1"))])
    assert (answer.status_code, answer.json()["code"]) == (400, "bad-request")


@pytest.mark.parametrize(
    "host", ["user@127.0.0.1", "127.0.0.1:99999", "127.0.0.1:8a", "127.0.0.1/x", "[::1", "a b", "localhost:1:2"]
)
def test_a_host_that_is_none_is_refused(http: TestClient, host: str) -> None:
    answer = http.get("/healthz", headers={"Host": host})
    assert (answer.status_code, answer.json()["code"]) == (400, "bad-host")


def test_a_transfer_coding_other_than_chunked_is_not_implemented(http: TestClient) -> None:
    answer = http.post(JOBS, content=b"{}", headers={"Transfer-Encoding": "gzip, chunked"})
    assert (answer.status_code, answer.json()["code"]) == (501, "transfer-coding")


@pytest.mark.parametrize("coding", ["utf-16", "utf-32", "utf-16-le"])
def test_json_is_utf_8(http: TestClient, coding: str) -> None:
    body = '{"scenario": "demo"}'.encode(coding)
    answer = http.post(JOBS, content=body, headers={"Content-Type": "application/json"})
    assert (answer.status_code, answer.json()["code"]) == (400, "json-invalid")
