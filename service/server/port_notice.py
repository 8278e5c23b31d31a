"""What to say about the port that a service took."""

from __future__ import annotations

from service.settings import DEFAULT_PORT


def port_notice(port: int | None, url: str) -> str | None:
    """What to say when the default port was taken."""
    if port is not None or url.endswith(f":{DEFAULT_PORT}"):
        return None
    return f"port {DEFAULT_PORT} is taken: using {url.rpartition(':')[2]}"
