"""What workers leave on the shared disk for whoever runs the campaign: every result at once and for good.

    token              who reads the same number sees the same disk
    attempts/KEY.N     attempt N of a case, begun by the worker that made this file
    files/KEY.N.NAME   series and recordings of attempt N
    results/KEY.json   how a case ended; made once, and never changed

A result that only a worker's memory holds dies with it, and the insertion is run again (distributed#7870). Here the
future of a task holds a receipt alone. KEY stands for case, scenario, runner and code, so what an earlier call left is
taken up only for the same insertion.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import shutil
import time
import uuid
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from simcore.errors import NeedlebenchError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

FOLDER = ".cluster"
_PATIENCE_S = 60.0  # a network file system may show a new file so much later
_NO_LINKS = (errno.EPERM, errno.ENOTSUP, errno.ENOSYS, errno.EMLINK)


class StoreError(NeedlebenchError):
    """A file that a worker reported cannot be read here."""


@dataclass(frozen=True)
class SharedStore:
    """The folder on the shared disk. Workers `begin` and `publish`; whoever runs the campaign takes and forgets."""

    path: Path

    def open(self) -> str:
        """Make the folder, or go on with it: results stay, attempts are counted anew. Returns its token."""
        shutil.rmtree(self.path / "attempts", ignore_errors=True)
        for part in ("attempts", "files", "results"):
            (self.path / part).mkdir(parents=True, exist_ok=True)
        token = uuid.uuid4().hex
        (self.path / "token").write_text(token)
        return token

    def shows(self, token: str) -> bool:
        """Whether this is the folder in which `open` left this token."""
        for _ in _until(_PATIENCE_S / 6):
            with suppress(OSError):
                if (self.path / "token").read_text() == token:
                    return True
        return False

    # ---- what workers do

    def begin(self, key: str, worker: str) -> int:
        """The number of a new attempt, from 1; no other worker has the same."""
        number = 1
        while True:
            with suppress(FileExistsError), (self.path / "attempts" / f"{key}.{number}").open("x") as file:
                file.write(worker)
                return number
            number += 1

    def give_back(self, key: str, number: int) -> None:
        """Take an attempt out of the count: it was ended from outside."""
        (self.path / "attempts" / f"{key}.{number}").unlink(missing_ok=True)

    def keep_file(self, source: Path, key: str, number: int) -> dict[str, str]:
        """Copy a file of an attempt into the store: the name that it has there, and its SHA-256."""
        stored = f"{key}.{number}.{source.name}"
        with self._draft() as draft:
            shutil.copyfile(source, draft)
            sha256 = _sha256(draft)
            draft.replace(self.path / "files" / stored)
        return {"stored": stored, "sha256": sha256}

    def publish(self, key: str, ended: dict[str, Any]) -> dict[str, Any]:
        """Say how a case ended, unless another attempt was first; what counts, the first one's."""
        target = self.path / "results" / f"{key}.json"
        with self._draft() as draft:
            draft.write_text(json.dumps(ended, allow_nan=False))
            try:
                os.link(draft, target)
            except FileExistsError:
                for kept in ended["files"].values():
                    (self.path / "files" / kept["stored"]).unlink(missing_ok=True)
                return self.ended(key) or ended
            except OSError as error:
                if error.errno not in _NO_LINKS:
                    raise
                draft.replace(target)
        return ended

    def ended(self, key: str) -> dict[str, Any] | None:
        """How a case ended; None if none of its attempts has said so."""
        with suppress(FileNotFoundError):
            found: dict[str, Any] = json.loads((self.path / "results" / f"{key}.json").read_bytes())
            return found
        return None

    # ---- what the campaign does

    def keys(self) -> set[str]:
        """Of all cases that have ended and were not taken yet."""
        return {name.removesuffix(".json") for name in os.listdir(self.path / "results")}  # noqa: PTH208  (10^5 names)

    def take(self, key: str, home: Path) -> dict[str, Any]:
        """How a case ended, with its files moved to `home` under their names. Raises StoreError."""
        for _ in _until(_PATIENCE_S):
            if (ended := self.ended(key)) is not None and self._moved(ended["files"], home):
                return ended
            self.keys()  # a listing makes a network file system look again
        raise StoreError(f"{self.path}: the result {key} was reported by a worker and is not to be seen here")

    def forget(self, key: str, attempts: int) -> None:
        """The case is kept elsewhere by now."""
        (self.path / "results" / f"{key}.json").unlink(missing_ok=True)
        for number in range(1, attempts + 1):
            self.give_back(key, number)

    def remove(self) -> None:
        """All is kept elsewhere. An attempt that nobody waits for any more finds no folder, and leaves nothing."""
        shutil.rmtree(self.path, ignore_errors=True)

    def _moved(self, files: dict[str, dict[str, str]], home: Path) -> bool:
        for name, kept in files.items():
            target = home / name
            try:
                (self.path / "files" / kept["stored"]).replace(target)
            except FileNotFoundError:  # an earlier call was ended between this and the note that it was kept
                if not (target.is_file() and _sha256(target) == kept["sha256"]):
                    return False
        return True

    def _draft(self) -> _Draft:
        return _Draft(self.path / f"draft-{uuid.uuid4().hex}")


class _Draft:
    """A name that nobody else has, on whatever machine; no file of that name is left."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __enter__(self) -> Path:
        return self.path

    def __exit__(self, *_: object) -> None:
        self.path.unlink(missing_ok=True)


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _until(seconds: float) -> Iterator[None]:
    """A few turns, further and further apart, at least one."""
    deadline, pause = time.monotonic() + seconds, 0.02
    yield
    while time.monotonic() < deadline:
        time.sleep(pause)
        pause = min(2.0, 1.6 * pause)
        yield
