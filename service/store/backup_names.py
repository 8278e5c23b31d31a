"""Where the backups of a data folder are, and which is the newest."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

BACKUPS = "backups"  # folder in the data folder
CONTENTS = "contents.json"  # in a backup: what it holds


def newest_backup(folder: Path) -> Path | None:
    """The newest of the backups in a folder; None when there is none."""
    found = [(path.stat().st_mtime, path.parent) for path in folder.glob(f"*/{CONTENTS}") if path.parent.name[0] != "."]
    return max(found)[1] if found else None
