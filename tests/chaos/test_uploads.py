"""kill -9 of the server under uploads: what was acknowledged is there, byte for byte, and nothing half."""

from __future__ import annotations

import hashlib
import io
import signal
import threading
import time
from typing import TYPE_CHECKING

import httpx2
import numpy as np

from tests.acceptance.server import Server, running_server, until

if TYPE_CHECKING:
    import random
    from collections.abc import Iterator
    from pathlib import Path

    import pytest

_SENDERS = 3
_LONGEST_S = 1.5  # of a server, from its start or from its first upload to its end
_PIECE = 65_536


def poses(number: int, rows: int) -> bytes:
    """A file of poses, another one for each number."""
    file = io.BytesIO()
    array = np.zeros((rows, 7))
    array[:, 3] = 1.0
    array[:, 2] = np.linspace(0.0, 0.01, rows) + 1e-6 * number
    np.save(file, array)
    return file.getvalue()


class Sender(threading.Thread):
    """Sends one file after the other to whatever server there is, in pieces with pauses between them."""

    def __init__(self, number: int, seed: int) -> None:
        super().__init__(daemon=True)
        self._number, self._rows = number, np.random.default_rng(seed)
        self.url: str | None = None
        self.ending = threading.Event()
        self.acknowledged: dict[str, str] = {}  # upload -> SHA-256 of what was sent
        self.cut = 0
        self.problems: list[str] = []

    def run(self) -> None:
        count = 0
        while not self.ending.is_set():
            if (url := self.url) is None:
                time.sleep(0.02)
                continue
            count += 1
            data = poses(_SENDERS * count + self._number, int(self._rows.integers(1, 20_000)))
            try:
                self._send(url, data)
            except httpx2.HTTPError:
                self.cut += 1

    def _send(self, url: str, data: bytes) -> None:
        params = {"kind": "poses", "name": f"{self._number}.npy"}
        with httpx2.Client(trust_env=False, timeout=120.0) as client:
            answer = client.post(f"{url}/api/v1/uploads", params=params, content=_pieces(data))
        if answer.status_code in (200, 201):
            self.acknowledged[answer.json()["id"]] = hashlib.sha256(data).hexdigest()
        elif answer.status_code != 503:
            self.problems.append(answer.text[:300])


def _pieces(data: bytes) -> Iterator[bytes]:
    for start in range(0, len(data), _PIECE):
        yield data[start : start + _PIECE]
        time.sleep(0.005)


def _let(senders: list[Sender], url: str | None) -> None:
    """All of them send there from now on; None = nowhere."""
    for sender in senders:
        sender.url = url


def test_uploads_are_killed(
    tmp_path: Path, moments: int, chance: random.Random, figures: dict[str, object], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NEEDLEBENCH_RATE_PER_KEY", "0")
    senders = [Sender(number, chance.getrandbits(32)) for number in range(_SENDERS)]
    for sender in senders:
        sender.start()
    for _ in range(moments):
        server = Server(tmp_path)
        try:
            before = sum(len(sender.acknowledged) for sender in senders)
            _let(senders, server.url)
            if chance.random() < 0.5:  # else also while the first of its files come in
                until(lambda: sum(len(sender.acknowledged) for sender in senders) > before)  # noqa: B023
            time.sleep(chance.uniform(0, _LONGEST_S))
        finally:
            _let(senders, None)
            server.stop(signal.SIGKILL)
    with running_server(tmp_path) as server:
        for sender in senders:
            sender.ending.set()
        for sender in senders:
            sender.join()
        acknowledged = {name: sha256 for sender in senders for name, sha256 in sender.acknowledged.items()}
        listed = {upload.id: upload for upload in server.client.uploads()}
        assert acknowledged.keys() <= listed.keys()
        for name, sha256 in acknowledged.items():
            assert listed[name].sha256 == sha256
            fetched = server.client.upload_file(name, tmp_path / "fetched.npy").read_bytes()
            assert hashlib.sha256(fetched).hexdigest() == sha256
        names = {path.name for path in (tmp_path / "uploads").iterdir()}
        assert listed.keys() <= names
        assert not [name for name in names if ".part" in name]
        unlisted = names - listed.keys()  # whole files, of which the row was not written any more
        for name in unlisted:
            assert hashlib.sha256((tmp_path / "uploads" / name).read_bytes()).hexdigest() == name.partition(".")[0]
        server.client._json("POST", "/api/v1/gc", json={"older_than_s": 86_400})
        assert {path.name for path in (tmp_path / "uploads").iterdir()} == listed.keys()
    assert not [problem for sender in senders for problem in sender.problems]
    cut = sum(sender.cut for sender in senders)
    figures.update(kills=moments, acknowledged=len(acknowledged), cut=cut, lost=0, half=0, without_a_row=len(unlisted))
