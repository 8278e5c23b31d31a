"""The text of an API key: `nb_<id>_<secret>`. The id may be shown; of the secret only its hash is kept."""

from __future__ import annotations

import hashlib
import re
import secrets
import sqlite3
from contextlib import closing
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

_FORM = re.compile(r"nb_([0-9a-f]{10})_[A-Za-z0-9_-]{43}")


def new_key() -> tuple[str, str]:
    """A fresh key and its id; 256 random bits, which need no slow hash."""
    key_id = secrets.token_hex(5)
    return f"nb_{key_id}_{secrets.token_urlsafe(32)}", key_id


def id_of(key: str) -> str | None:
    """The id in the text of a key; None for what has not the form of one."""
    match = _FORM.fullmatch(key)
    return match[1] if match else None


def digest_of(secret: str) -> str:
    """SHA-256, hexadecimal, of a key or of the token of a session."""
    return hashlib.sha256(secret.encode("utf-8", "replace")).hexdigest()


def keys_exist(database: Path) -> bool:
    """Whether the database holds a key that is not revoked. Opens it for reading only; makes nothing."""
    if not database.is_file():
        return False
    try:
        with closing(sqlite3.connect(f"{database.absolute().as_uri()}?mode=ro", uri=True)) as connection:
            return connection.execute("SELECT 1 FROM api_key WHERE revoked_at IS NULL LIMIT 1").fetchone() is not None
    except sqlite3.Error:  # of a version without keys, or none of ours
        return False
