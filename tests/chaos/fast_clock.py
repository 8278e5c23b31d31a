"""A server whose clock runs fast, so that a minute of a schedule takes two seconds; a restart does not set it back."""

from __future__ import annotations

import functools
import os
import time

from service.api import context as core
from service.store.jobs import Store
from tests.acceptance import server

SPEED = 30.0  # seconds of the server in one of ours
STARTED = "NEEDLEBENCH_CHAOS_STARTED"  # environment: when both clocks showed the same, UTC seconds since 1970


def now() -> float:
    """UTC seconds since 1970, by the fast clock."""
    started = float(os.environ[STARTED])
    return started + SPEED * (time.time() - started)


def main() -> None:
    """What the process of `Server` runs."""
    core.Store = functools.partial(Store, now=now)  # type: ignore[attr-defined,assignment]
    server.main()
