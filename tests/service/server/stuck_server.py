"""A service in which a thread and a request never end."""

from __future__ import annotations

import threading

from service.engine.housekeeper import Keeper
from service.server import server as started
from service.store.keys import Keys
from tests.acceptance import server


def hang(*_given: object) -> None:
    """Nobody gets on here."""
    threading.Event().wait()


def main() -> None:
    """With a keeper that hangs in its tick, and a list of keys that never comes."""
    Keeper.tick = hang  # type: ignore[method-assign, assignment]
    Keys.all = hang  # type: ignore[method-assign, assignment]
    started.STOP_S = 2.0  # type: ignore[attr-defined]
    server.main()
