"""A service without keys is for the account that started it: others of this machine neither read nor talk to it."""

from __future__ import annotations

import http.client
import json
import os
import socket
import stat
import sys
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

import pytest

from service.api.middleware.key_guard import PEER
from service.files.endpoint import endpoint, local_token
from service.files.private import private_folder
from service.server.peer_account import account_of, is_own
from tests.acceptance.server import running_server
from tests.service.http import HERE, idle_service

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.slow

JOBS = "/api/v1/jobs"
NOBODY = 65534
linux = pytest.mark.skipif(sys.platform != "linux", reason="only Linux says which account holds a connection")


@linux
@pytest.mark.parametrize(("family", "host"), [(socket.AF_INET, "127.0.0.1"), (socket.AF_INET6, "::1")])
def test_the_account_behind_a_connection_is_found_until_it_is_closed(family: socket.AddressFamily, host: str) -> None:
    try:
        listener = socket.create_server((host, 0), family=family)
    except OSError:
        pytest.skip(f"there is no {host} here")
    with listener:
        client = socket.create_connection(listener.getsockname()[:2])
        with listener.accept()[0] as accepted:
            ends = (accepted.getpeername()[:2], accepted.getsockname()[:2])
            assert account_of(*ends) == os.getuid()
            client.close()
            assert account_of(*ends) is None


def test_a_table_of_the_kernel_is_read_as_it_is_written(tmp_path: Path) -> None:
    head = "  sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid  timeout inode\n"
    one = "   0: {} {} {} 00000000:00000000 00:00000000 00000000  {} 0 {} 1 00000000af118621 100 0 0 10 0\n"
    table = tmp_path / "tcp"
    ends = ("0100007F:94AE", "0100007F:2081") if sys.byteorder == "little" else ("7F000001:94AE", "7F000001:2081")
    client, server = ("127.0.0.1", 0x94AE), ("127.0.0.1", 0x2081)
    table.write_text(head + one.format(*ends[::-1], "01", 0, 7) + one.format(*ends, "01", 1234, 8))
    assert account_of(client, server, (table,)) == 1234
    assert account_of(server, client, (table,)) == 0
    table.write_text(head + one.format(*ends, "06", 0, 0))  # closed: it belongs to nobody
    assert account_of(client, server, (table,)) is None
    assert account_of(client, server, (tmp_path / "none",)) is None
    assert not is_own(None)
    assert is_own(os.getuid())
    assert not is_own(os.getuid() + 1)


def as_nobody(url: str, path: str) -> bytes:
    """The answer that another account of this machine gets."""
    place = urlsplit(url)
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.setgroups([])
            os.setgid(NOBODY)
            os.setuid(NOBODY)
            with socket.create_connection((place.hostname or "", place.port or 0), timeout=30) as connection:
                request = f"GET {path} HTTP/1.1\r\nHost: {place.netloc}\r\nConnection: close\r\n\r\n"
                connection.sendall(request.encode())
                while part := connection.recv(65_536):
                    os.write(writing, part)
        finally:
            os._exit(0)
    os.close(writing)
    with os.fdopen(reading, "rb") as pipe:
        answer = pipe.read()
    os.waitpid(child, 0)
    return answer


@linux
def test_files_are_for_their_account_and_so_is_a_service_without_keys(tmp_path: Path) -> None:
    data = tmp_path / "data"
    data.mkdir(mode=0o755)
    with running_server(data, workers=1) as server:
        job = server.client.submit({"name": "quick"})
        server.client.wait(job.id)
        connection = http.client.HTTPConnection(urlsplit(server.url).netloc, timeout=30)  # as curl or a browser
        connection.request("GET", JOBS)
        assert connection.getresponse().status == 200
        connection.close()
        paths = [data, *data.rglob("*")]
        open_to_others = [path for path in paths if stat.S_IMODE(path.stat().st_mode) & 0o077]
        assert open_to_others == []
        assert any(path.suffix == ".sqlite" for path in paths)
        if os.getuid() == 0:
            answer = as_nobody(server.url, JOBS)
            assert answer.startswith(b"HTTP/1.1 403 ")
            assert b'"account-foreign"' in answer
            assert b"200 OK" in as_nobody(server.url, "/healthz")


def test_a_folder_that_everybody_may_write_to_stays_as_it_is(tmp_path: Path) -> None:
    shared = tmp_path / "shared"
    shared.mkdir()
    shared.chmod(0o1777)
    private_folder(shared)
    assert stat.S_IMODE(shared.stat().st_mode) == 0o1777
    mine = tmp_path / "mine"
    mine.mkdir(mode=0o755)
    private_folder(mine)
    assert stat.S_IMODE(mine.stat().st_mode) == 0o700


@pytest.mark.parametrize(("own", "code"), [(False, "account-foreign"), (None, "account-unknown")])
def test_the_token_of_the_data_folder_opens_what_the_system_does_not(
    tmp_path: Path, own: bool | None, code: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    from service.api.middleware.key_guard import KeyGuard

    handle = KeyGuard.__call__

    async def with_peer(self: KeyGuard, scope: dict[str, object], receive: object, send: object) -> None:
        await handle(self, {**scope, PEER: lambda: own}, receive, send)  # type: ignore[arg-type]

    monkeypatch.setattr(KeyGuard, "__call__", with_peer)
    with idle_service(tmp_path) as (http_client, service):
        service.keys.take_local_token("token-of-the-folder")
        refused = http_client.get(JOBS)
        assert (refused.status_code, refused.json()["code"]) == (403 if own is False else 401, code)
        assert http_client.get(JOBS, headers={"Authorization": "Bearer another"}).status_code == refused.status_code
        assert http_client.get(JOBS, headers={"Authorization": "Bearer token-of-the-folder"}).status_code == 200
        form = {"key": "token-of-the-folder", "next": "/"}
        entered = http_client.post("/login", data=form, headers={"Origin": HERE}, follow_redirects=False)
        assert entered.status_code == 303
        assert http_client.get(JOBS).status_code == 200  # by the cookie
        service.keys.create(scope="admin")
        assert http_client.get(JOBS).status_code == 401
        assert http_client.get(JOBS, headers={"Authorization": "Bearer token-of-the-folder"}).status_code == 401


def test_the_token_stays_when_the_address_changes(tmp_path: Path) -> None:
    from service.files.endpoint import make_token, write_endpoint

    token = make_token(tmp_path)
    write_endpoint(tmp_path, "http://127.0.0.1:1")
    write_endpoint(tmp_path, "http://127.0.0.1:2")
    assert make_token(tmp_path) == local_token(tmp_path) == token
    assert endpoint(tmp_path) == json.loads((tmp_path / "endpoint.json").read_text())["url"] == "http://127.0.0.1:2"
