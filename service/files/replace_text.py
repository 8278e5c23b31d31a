"""A small text file that is replaced as a whole, for readers that look at any moment."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path


def replace_text(path: Path, text: str) -> None:
    """Replace a file as a whole; a reader sees the old text or the new one."""
    draft = path.with_name(f"{path.name}.tmp")
    draft.write_text(text, encoding="utf-8")
    with suppress(PermissionError):  # Windows: the reader has it open just now; the next one will do
        draft.replace(path)
