"""Where the service of a data folder listens: it says so in a file there."""

from __future__ import annotations

import json
from pathlib import Path

from service.files.replace_text import replace_text
from service.settings import DEFAULT_PORT

ENDPOINT = "endpoint.json"


def endpoint(data: Path) -> str | None:
    """Where the service of this data folder said that it listens; it may have ended since."""
    try:
        url = json.loads((data / ENDPOINT).read_text(encoding="utf-8"))["url"]
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return str(url)


def write_endpoint(data: Path, url: str) -> None:
    """Say where the service listens. Raises OSError."""
    replace_text(data / ENDPOINT, json.dumps({"url": url}))


def port_notice(port: int | None, url: str) -> str | None:
    """What to say when the default port was taken."""
    if port is not None or url.endswith(f":{DEFAULT_PORT}"):
        return None
    return f"port {DEFAULT_PORT} is taken: using {url.rpartition(':')[2]}"
