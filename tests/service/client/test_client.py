"""The client against addresses, ids and answers that are not what they should be."""

from __future__ import annotations

from typing import TYPE_CHECKING

import httpx2
import pytest

from service.client.client import CannotWriteError, Client, ServiceError, UnreachableError
from service.client.connection import LONGER, TRIES, part
from simcore.errors import ScenarioError

if TYPE_CHECKING:
    from pathlib import Path

URL = "http://127.0.0.1:8321"
UPLOAD = {"id": "a.npy", "reference": "artefact:a.npy", "kind": "poses", "name": "a", "bytes": 1, "sha256": "0"}


def client_that_gets(answer: httpx2.Response) -> tuple[Client, list[httpx2.Request]]:
    asked: list[httpx2.Request] = []

    def reply(request: httpx2.Request) -> httpx2.Response:
        asked.append(request)
        return answer

    client = Client(URL)
    client._http = httpx2.Client(base_url=URL, transport=httpx2.MockTransport(reply))
    return client, asked


@pytest.mark.slow
@pytest.mark.parametrize("name", ["a/pin", "..", ".", "a?wait=60", "", "../../etc", "ä b", "%2e%2e"])
def test_an_id_stays_one_part_of_the_address(name: str) -> None:
    client, asked = client_that_gets(httpx2.Response(204))
    client.delete(name)
    path = asked[0].url.raw_path
    assert path.startswith(b"/api/v1/jobs/")
    assert path.count(b"/") == 4
    assert b"?" not in path
    assert path != b"/api/v1/jobs/"


def test_an_id_of_ours_is_left_as_it_is() -> None:
    assert part("5f2b8c0d9e1a4b37") == "5f2b8c0d9e1a4b37"


def test_an_answer_that_is_no_json_is_of_no_service() -> None:
    client, _ = client_that_gets(httpx2.Response(200, text="<html>hello</html>"))
    with pytest.raises(ServiceError, match="is not a needlebench service"):
        client.job("a")


@pytest.mark.parametrize("url", ["http://[::1", "http://[x]:1"])
def test_a_broken_address_is_named(url: str) -> None:
    with pytest.raises(UnreachableError, match="is not the address of a service"):
        Client(url)


def test_a_key_that_no_header_can_hold_is_bad_input() -> None:
    with pytest.raises(ScenarioError, match="printable ASCII"):
        Client(URL, "nb_ü")


def test_a_download_into_no_folder_says_which(tmp_path: Path) -> None:
    client, _ = client_that_gets(httpx2.Response(200, content=b"0123"))
    with pytest.raises(CannotWriteError, match="cannot be written: No such file or directory"):
        client.recording("a", tmp_path / "nothing" / "a.rrd")
    assert client.recording("a", tmp_path / "a.rrd").read_bytes() == b"0123"


def client_of_a_busy_service(late: int, answer: httpx2.Response) -> tuple[Client, list[httpx2.Request]]:
    """The first `late` answers do not come in time."""
    asked: list[httpx2.Request] = []

    def reply(request: httpx2.Request) -> httpx2.Response:
        asked.append(request)
        if len(asked) <= late:
            raise httpx2.ReadTimeout("timed out", request=request)
        return answer

    client = Client(URL, timeout_s=2.0)
    client._http = httpx2.Client(base_url=URL, transport=httpx2.MockTransport(reply))
    return client, asked


def waited_s(request: httpx2.Request) -> float:
    return float(request.extensions["timeout"]["read"])


def test_a_read_is_asked_again_when_no_answer_comes_in_time() -> None:
    client, asked = client_of_a_busy_service(TRIES - 1, httpx2.Response(200, json={"items": []}))
    assert client.history("a") == []
    assert [(request.method, waited_s(request)) for request in asked] == [("GET", 2.0)] * TRIES


def test_a_submission_is_sent_again_as_the_same_one() -> None:
    client, asked = client_of_a_busy_service(2, httpx2.Response(422, json={"detail": "no", "errors": []}))
    with pytest.raises(ServiceError, match="no"):
        client.submit("demo")
    keys = {request.headers["Idempotency-Key"] for request in asked}
    assert (len(asked), len(keys)) == (3, 1)


def test_what_may_not_be_repeated_is_waited_for_longer_and_once() -> None:
    client, asked = client_of_a_busy_service(1, httpx2.Response(204))
    with pytest.raises(UnreachableError, match=r"does not answer, within 20 s: is the machine very busy\?"):
        client.delete("a")
    assert [waited_s(request) for request in asked] == [2.0 * LONGER]


def test_lists_are_fetched_to_their_end() -> None:
    """However long they are: a page of the service holds a thousand at most."""
    item = {**UPLOAD, "content": {}}
    pages: list[dict[str, object]] = [{"items": [item], "next_cursor": "7"}, {"items": [item], "next_cursor": None}]
    answers = iter([httpx2.Response(200, json=page) for page in pages])
    asked: list[str] = []

    def reply(request: httpx2.Request) -> httpx2.Response:
        asked.append(request.url.query.decode())
        return next(answers)

    client = Client(URL)
    client._http = httpx2.Client(base_url=URL, transport=httpx2.MockTransport(reply))
    assert [upload.id for upload in client.uploads()] == ["a.npy", "a.npy"]
    assert asked == ["limit=1000", "limit=1000&cursor=7"]


def test_an_upload_is_sent_and_waited_for_longer(tmp_path: Path) -> None:
    client, asked = client_that_gets(httpx2.Response(201, json={**UPLOAD, "content": {}}))
    file = tmp_path / "a.npy"
    file.write_bytes(b"abc")
    assert client.upload(file).id == "a.npy"
    assert asked[0].extensions["timeout"]["read"] == 300.0
