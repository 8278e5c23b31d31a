"""Whether the file that a command is to write can be written, said before the work."""

from __future__ import annotations

import tempfile
from typing import TYPE_CHECKING

from simcore.errors import Problem, ScenarioError

if TYPE_CHECKING:
    from pathlib import Path


def free_to_write(path: Path, *, force: bool) -> None:
    """Raises ScenarioError before the work, and not after it."""
    if path.exists() and not force:
        raise ScenarioError([Problem("--out", str(path), "exists; use --force to replace it")])
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        raise ScenarioError([Problem("--out", str(path), f"cannot be written: {error.strerror}")]) from None
