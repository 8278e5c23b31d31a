"""Empty databases for tests. Migrating one waits for the disk longer than most tests that want one take."""

from __future__ import annotations

import tempfile
from functools import cache
from pathlib import Path

from service.store.database import open_database


def lay_down(path: Path) -> Path:
    """Put an empty database of the newest tables there, unless there is a file; the path."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(_empty())
    return path


@cache
def _empty() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "empty.sqlite"
        open_database(path).dispose()
        return path.read_bytes()
