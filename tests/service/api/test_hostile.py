"""Input that means harm, over real HTTP: refused with the right code, and nothing outside the data folder touched."""

from __future__ import annotations

import http.client
import io
import json
import pickle
import socket
from contextlib import suppress
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

import numpy as np
import pytest

from tests.acceptance.server import Server, running_server
from tests.service.learned import dataset_bytes, model_bytes, npz_bomb, npz_member

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

pytestmark = pytest.mark.slow

JOBS, UPLOADS, MODELS = "/api/v1/jobs", "/api/v1/uploads", "/api/v1/models"
CHUNKED = (
    b"POST /api/v1/jobs HTTP/1.1\r\nHost: 127.0.0.1\r\n"
    b"Content-Type: application/json\r\nTransfer-Encoding: chunked\r\n\r\n"
)
JSON = {"Content-Type": "application/json"}
OCTETS = {"Content-Type": "application/octet-stream"}
OWN_FILES = {"endpoint.json", "needlebench.sqlite", "needlebench.sqlite-shm", "needlebench.sqlite-wal", "server.lock",
             "warm.lock", "uploads", "jobs", "backups"}  # fmt: skip


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a secret beside the data folder."""
    folder = tmp_path_factory.mktemp("place")
    (folder / "secret.vtk").write_text("not to be read")
    (folder / "secret.json").write_text('{"not": "to be read"}')
    return folder


@pytest.fixture(scope="module")
def server(place: Path) -> Iterator[Server]:
    with running_server(place / "data", workers=1) as running:
        yield running


@pytest.fixture(autouse=True)
def _nothing_else_is_touched(place: Path, server: Server) -> Iterator[None]:
    before = snapshot(place)
    yield
    assert snapshot(place) == before
    assert {path.name for path in server.data.iterdir()} <= OWN_FILES
    assert list((server.data / "uploads").glob("*")) == []
    assert server.process.poll() is None
    assert server.client.ready()["status"] in ("ready", "starting")


def snapshot(place: Path) -> dict[str, bytes]:
    """Names and contents of everything beside the data folder."""
    found = (path for path in place.rglob("*") if not path.is_relative_to(place / "data"))
    return {str(path): path.read_bytes() if path.is_file() else b"" for path in found}


def ask(server: Server, method: str, path: str, body: Any = None, headers: dict[str, str] | None = None) -> int:
    """The status; every refusal is a problem. The path is sent as it stands, dots and all."""
    connection = http.client.HTTPConnection(urlsplit(server.url).netloc, timeout=60)
    try:
        with suppress(BrokenPipeError, ConnectionResetError):  # a body that is too long is not read to its end
            connection.request(method, path, body=body, headers=headers or {})
        answer = connection.getresponse()
        content = answer.read()
    finally:
        connection.close()
    if answer.status >= 400:
        assert answer.headers["content-type"] == "application/problem+json", (answer.status, content[:200])
        told = json.loads(content)
        assert told["status"] == answer.status
        assert "not to be read" not in content.decode()
    return answer.status


def submit(server: Server, scenario: Any) -> int:
    return ask(server, "POST", JOBS, json.dumps({"scenario": scenario}), JSON)


@pytest.mark.parametrize(
    "name",
    [
        "{place}/secret.vtk", "../secret.vtk", "file://{place}/secret.vtk", "artefact:../../secret.vtk",
        "artefact:{place}/secret.vtk", "artefact:" + "0" * 64 + ".vtk/../../secret.vtk",
        "artefact:" + "0" * 64 + ".vtk",
        "artefact:", "ARTEFACT:" + "0" * 64 + ".vtk", "artefact:" + "0" * 64 + ".vtk\n", "/dev/zero", "/proc/self/mem",
        "artefact:needlebench.sqlite", "\x00",
    ],
)  # fmt: skip
def test_a_scenario_names_no_file_of_the_servers_disk(server: Server, place: Path, name: str) -> None:
    assert submit(server, {"tissue": {"mesh_file": name.format(place=place)}}) == 422


@pytest.mark.parametrize(
    "path",
    [
        f"{JOBS}/../../../secret.json", f"{JOBS}/%2e%2e%2f%2e%2e%2fsecret.json", f"{JOBS}/..%5c..%5csecret.json",
        "/recordings/../secret.rrd", "/recordings/%2e%2e%2fsecret.rrd",
        f"{UPLOADS}/%2e%2e%2fneedlebench.sqlite/content",
        f"{UPLOADS}/../needlebench.sqlite", f"{UPLOADS}/{'0' * 64}.vtk%00/content", f"{JOBS}/{'a' * 33}",
        f"{JOBS}/a'%20OR%201=1--", "//secret.json", "/login/../secret.json",
        f"{MODELS}/../../../secret.json", f"{MODELS}/%2e%2e%2fsecret.json/content", f"{MODELS}/elm%00",
        f"{MODELS}/{'0' * 64}.json", f"{MODELS}/{'0' * 64}.json/content", f"{MODELS}/{'0' * 64}.npz", f"{MODELS}/train",
        f"{MODELS}/elm.json", f"{MODELS}/forest/content", f"{MODELS}/{'a' * 200}", f"{UPLOADS}/{'0' * 64}.vtk/content",
    ],
)  # fmt: skip
def test_no_path_leads_out_of_the_data_folder(server: Server, path: str) -> None:
    assert ask(server, "GET", path) in (404, 422)
    assert ask(server, "DELETE", path) in (404, 405, 422)


@pytest.mark.parametrize(
    ("body", "status"),
    [
        (b'{"scenario": ' + b"[" * 200_000 + b"]" * 200_000 + b"}", (400, 422)),
        (b'{"scenario": ' + b'{"tissue":' * 100_000 + b"1" + b"}" * 100_001, (413,)),
        (b'{"scenario": ' + b'{"tissue":' * 80_000 + b"1" + b"}" * 80_001, (400, 422)),
        (b'{"scenario": {"tissue": ' + b"[" * 900 + b"]" * 900 + b"}}", (422,)),
        (b'{"scenario": {"dt_s": NaN}}', (422,)),
        (b'{"scenario": {"dt_s": -Infinity}}', (422,)),
        (b'{"scenario": {"dt_s": 1e999}}', (422,)),
        (b'{"scenario": {"seed": ' + b"9" * 4000 + b"}}", (422,)),
        (b'{"scenario": {"seed": ' + b"9" * 990_000 + b"}}", (400, 422)),
        (b'{"scenario": {"tissue": {"element_size_mm": 1, "size_mm": [500, 500, 500]}}}', (422,)),
        (b'{"scenario": {"dt_s": 0.0001, "trajectory": {"speed_mm_s": 0.1}}}', (422,)),
        (b'{"scenario": {"name": "\\u0000"}}', (422,)),
        (b'{"scenario": "demo", "scenario": 5}', (422,)),
        (b'{"__proto__": {}, "scenario": "demo"}', (422,)),
        (b" " * 1_000_001, (413,)),
        (b" " * 33_000_000, (413,)),
    ],
    ids=["deep list", "deep object", "deeper object", "deep block", "nan", "infinity", "1e999", "long seed",
         "longer seed", "huge mesh", "endless", "zero byte", "twice", "proto", "just too long", "long body"],
)  # fmt: skip
def test_a_hostile_body_is_refused(server: Server, body: bytes, status: tuple[int, ...]) -> None:
    assert ask(server, "POST", JOBS, body, JSON) in status


def objects() -> bytes:
    file = io.BytesIO()
    np.savez(file, w=np.array([{}], dtype=object))
    return file.getvalue()


@pytest.mark.parametrize(
    ("name", "kind", "body", "status"),
    [
        ("data.npz", "dataset", npz_bomb, 422),
        ("data.npz", "dataset", objects(), 422),
        ("data.npz", "dataset", npz_member(b"{}", name="../../../secret.json"), 422),
        ("data.npz", "dataset", pickle.dumps({"a": 1}), 422),
        ("data.npz", "dataset", dataset_bytes()[:-2000], 422),
        ("model.pkl", "model", pickle.dumps({"a": 1}), 415),
        ("model.json", "model", b"[" * 1_000_000, 422),
        ("model.json", "model", pickle.dumps({"a": 1}), 422),
        ("model.json", "model", b'{"format": "needlebench/model", "version": 1, "kind": "__class__"}', 422),
        ("model.json", "model", model_bytes("elm", nodes=3).replace(b'"inputs": 6', b'"inputs": 60'), 422),
        ("model.json", "model", model_bytes("elm", nodes=3).replace(b'"nodes": 3', b'"nodes": 9999'), 422),
        ("mesh.msh", "mesh", b"$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 999999999999 1 999999999999\n", 422),
        ("mesh.vtk", "mesh", b"# vtk DataFile Version 3.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 9e99 f\n", 422),
        ("mesh.vtu", "mesh", b'<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/passwd">]><VTKFile>&b;</VTKFile>', 422),
        ("mesh.inp", "mesh", b"*INCLUDE, INPUT=/etc/passwd\n", 422),
        ("../mesh.msh", "mesh", b"x", 422),
        ("mesh.msh", "mesh", b"x" * 65_000_000, 413),
    ],
    ids=["npz bomb", "objects", "path inside", "pickle as npz", "cut npz", "pickle", "deep json", "pickle as json",
         "strange kind", "wide model", "short model", "endless nodes", "huge count", "entity", "include", "path",
         "long"],
)  # fmt: skip
def test_a_hostile_file_is_refused(
    server: Server, name: str, kind: str, body: bytes | Callable[[], bytes], status: int
) -> None:
    path = f"{UPLOADS}?kind={kind}&name={name}"
    assert ask(server, "POST", path, body() if callable(body) else body, OCTETS) == status


DATA = "artefact:" + "0" * 64 + ".npz"


@pytest.mark.parametrize(
    "body",
    [
        {}, {"data": None}, {"data": "{place}/secret.json"}, {"data": "../secret.npz"}, {"data": DATA},
        {"data": DATA + "/../../secret.npz"}, {"data": DATA + "\n"}, {"data": DATA, "kind": "os"},
        {"data": DATA, "nodes": 10**30}, {"data": DATA, "nodes": True}, {"data": DATA, "nodes": 25.5},
        {"data": DATA, "ridge": "1"}, {"data": DATA, "hidden": [[1]]}, {"data": DATA, "hidden": []},
        {"data": DATA, "kind": "mlp", "hidden": [1] * 6}, {"data": DATA, "samples": -1}, {"data": DATA, "seed": -1},
        {"data": DATA, "kind": "linear", "nodes": 5}, {"data": DATA, "name": "\u0000"},
        {"data": DATA, "name": "a" * 101},
        {"data": DATA, "timeout_s": 1e9}, {"data": DATA, "priority": 1e300}, {"data": DATA, "trainer": "os.system"},
        [DATA], "train", None,
    ],
)  # fmt: skip
def test_a_hostile_training_is_refused(server: Server, place: Path, body: Any) -> None:
    text = json.dumps(body).replace("{place}", str(place))
    assert ask(server, "POST", f"{MODELS}/train", text, JSON) == 422


@pytest.mark.parametrize("body", [b'{"ridge": NaN}', b'{"nodes": 1e999}', b"[" * 100_000, b'{"data": "\xff"}', b""])
def test_a_training_that_is_no_json_is_refused(server: Server, body: bytes) -> None:
    assert ask(server, "POST", f"{MODELS}/train", body, JSON) in (400, 422)


@pytest.mark.parametrize(
    ("method", "headers", "status"),
    [
        ("GET", {"Host": "evil.example"}, 421),
        ("POST", {"Origin": "http://evil.example"}, 403),
        ("POST", {"Origin": "null"}, 403),
        ("GET", {"X-Long": "x" * 20_000}, 431),
        ("GET", {"Cookie": "needlebench_session=" + "x" * 18_000}, 431),
        ("POST", {"Content-Type": "text/plain"}, 415),
        ("POST", {"Content-Type": "application/x-www-form-urlencoded"}, 415),
        ("POST", {"Content-Type": "multipart/form-data; boundary=x"}, 415),
        ("POST", {"Content-Type": "application/json; charset=utf-7", "Idempotency-Key": ""}, 422),
        ("TRACE", {}, 405),
    ],
)
def test_hostile_headers_are_refused(server: Server, method: str, headers: dict[str, str], status: int) -> None:
    body = '{"scenario": "demo"}' if method == "POST" else None
    assert ask(server, method, JOBS, body, {**(JSON if method == "POST" else {}), **headers}) == status


@pytest.mark.parametrize(
    "raw",
    [
        b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX: " + b"x" * 200_000 + b"\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX: " + b"x" * 200_000,
        b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n" + b"X: y\r\n" * 20_000,
        b"GET /" + b"x" * 200_000,
        CHUNKED + b"1;" + b"x" * 200_000,
        CHUNKED + b"2\r\n{}\r\n0\r\n" + b"X: y\r\n" * 20_000,
        b"\x16\x03\x01 this is TLS\r\n\r\n",
        b"GET / HTTP/1.1\r\n\r\n",
        b"POST /api/v1/jobs HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: -5\r\n\r\n",
        b"POST /api/v1/jobs HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 5\r\nContent-Length: 6\r\n\r\nhello!",
    ],
    ids=[
        "long header",
        "endless header",
        "endless headers",
        "endless address",
        "endless chunk",
        "endless trailers",
        "tls",
        "no host",
        "negative length",
        "two lengths",
    ],
)
def test_what_is_no_http_is_refused_and_closed(server: Server, raw: bytes) -> None:
    place = urlsplit(server.url)
    with socket.create_connection((place.hostname or "", place.port or 0), timeout=30) as connection:
        try:
            connection.sendall(raw)
            answer = connection.recv(65536)
        except ConnectionResetError:
            answer = b""
    assert answer == b"" or answer.split(b" ")[1][:1] == b"4"
    assert answer == b"" or b"content-type: application/problem+json" in answer
