"""Where the service of a data folder listens, and what its own account says to it: a file there, for that account."""

from __future__ import annotations

import json
import secrets
from contextlib import suppress
from typing import TYPE_CHECKING

from service.files.replace_text import replace_text

if TYPE_CHECKING:
    from pathlib import Path

ENDPOINT = "endpoint.json"


def endpoint(data: Path) -> str | None:
    """Where the service of this data folder said that it listens; it may have ended since."""
    return _read(data).get("url")


def local_token(data: Path) -> str | None:
    """What opens a service without keys where the system does not say which account is asking."""
    return _read(data).get("token")


def write_endpoint(data: Path, url: str) -> None:
    """Say where the service listens; its token stays. Raises OSError."""
    replace_text(data / ENDPOINT, json.dumps({**_read(data), "url": url}))


def make_token(data: Path) -> str:
    """The token of this data folder, made if there is none; of no use to others where it cannot be written."""
    token = local_token(data) or secrets.token_urlsafe(32)
    with suppress(OSError):  # a full disk: those who need it are given it after the next start
        replace_text(data / ENDPOINT, json.dumps({**_read(data), "token": token}))
    return token


def _read(data: Path) -> dict[str, str]:
    try:
        content = json.loads((data / ENDPOINT).read_text(encoding="utf-8"))
        return {name: str(content[name]) for name in ("url", "token") if name in content}
    except (OSError, ValueError, TypeError):
        return {}
