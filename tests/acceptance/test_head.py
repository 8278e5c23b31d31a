"""HEAD on every address that can be read: what GET answers, without its body, and at once for what has no end."""

from __future__ import annotations

from typing import TYPE_CHECKING

import httpx2
import pytest

from tests.acceptance.server import PATIENCE_S, Server, running_server

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = pytest.mark.slow

OF_THE_ANSWER = {"date", "x-request-id", "transfer-encoding"}  # differ from one answer to the next


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    with running_server(tmp_path_factory.mktemp("data")) as running:
        yield running


@pytest.fixture(scope="module")
def http(server: Server) -> Iterator[httpx2.Client]:
    with httpx2.Client(base_url=server.url, timeout=PATIENCE_S) as client:
        yield client


def readable(server: Server, http: httpx2.Client) -> list[str]:
    """Every address of the document that takes GET, with what there is in place of its parameters, and the pages."""
    job = server.client.submit({"name": "quick"}).id
    server.client.wait(job)
    campaign = http.post("/api/v1/campaigns", json={"grid": {"seed": [0]}, "name": "one"}).json()["id"]
    server.client.wait_campaign(campaign)  # an insertion that runs changes what is answered
    nightly = {"name": "nightly", "cron": "0 2 29 2 *", "campaign": {"grid": {"seed": [0]}}}
    schedule = http.post("/api/v1/schedules", json=nightly).json()["id"]
    known = {"job_id": job, "campaign_id": campaign, "schedule_id": schedule, "name": "demo", "suite": "one"}
    known["model_id"] = "elm"
    paths = [path for path, methods in http.get("/openapi.json").json()["paths"].items() if "get" in methods]
    pages = ["/", "/submit", "/jobs/{job_id}", "/campaigns", "/campaigns/{campaign_id}", "/schedules"]
    pages += ["/trends", "/models", "/models/{model_id}"]
    blank = {"upload_id": "0", "key_id": "0", "artefact_id": "0"}
    return [path.format_map({**blank, **known}) for path in [*paths, *pages, "/openapi.json", "/nothing"]]


def test_every_address_answers_as_get_without_a_body(server: Server, http: httpx2.Client) -> None:
    addresses = readable(server, http)
    assert len(addresses) > 30
    for address in addresses:
        whole, head = http.get(address), http.head(address)
        assert head.status_code == whole.status_code, address
        assert head.content == b"", address
        found, wanted = ({k: v for k, v in a.headers.items() if k not in OF_THE_ANSWER} for a in (head, whole))
        if address not in ("/metrics", "/readyz"):  # whose length depends on the moment
            assert found == wanted, address
        assert found.keys() == wanted.keys(), address


def test_what_has_no_end_is_answered_at_once(server: Server, http: httpx2.Client) -> None:
    job = server.running("long")
    for address in (f"/api/v1/jobs/{job.id}/events", "/api/v1/events", f"/recordings/{job.id}.rrd"):
        for _ in range(3):
            head = http.head(address, headers={"Accept": "text/event-stream"})
            assert head.status_code == 200
            assert head.headers["content-type"].startswith(
                "text/event-stream" if "events" in address else "application/"
            )
        assert http.get("/healthz").status_code == 200
    server.client.cancel(job.id)


def test_only_what_can_be_read(http: httpx2.Client) -> None:
    assert http.head("/api/v1/comparisons").status_code == 405
    refused = http.put("/version")
    assert (refused.status_code, refused.headers["allow"]) == (405, "GET, HEAD")
