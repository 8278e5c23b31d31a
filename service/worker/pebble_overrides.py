"""What is set or relied on inside pebble, the library of worker processes; written for the versions named here."""

from __future__ import annotations

import multiprocessing
from typing import TYPE_CHECKING, Any

import pebble

if TYPE_CHECKING:
    from collections.abc import Callable

WRITTEN_FOR = ("pebble", "5.2", "5.3")  # from this version, below that one
TERM_TIMEOUT_S = 0.2  # between SIGTERM and SIGKILL; pebble's own 3 s block whoever waits meanwhile
LOOK_S = 0.2  # between two looks at a worker that may have died; pebble's own 0.1 s cost more than they tell


def single_worker_pool(initializer: Callable[..., None], *arguments: Any) -> pebble.ProcessPool:
    """A pool of one process, started by spawn, which runs `initializer(*arguments)` first."""
    pebble.CONSTS.term_timeout = TERM_TIMEOUT_S
    pebble.CONSTS.sleep_unit = LOOK_S
    return pebble.ProcessPool(
        max_workers=1,
        initializer=initializer,
        initargs=arguments,
        context=multiprocessing.get_context("spawn"),
    )


def living_workers(pool: pebble.ProcessPool) -> set[int]:
    """The process ids of a pool's workers that it believes to live.

    A worker that ended with exit code 0 is replaced without a word, and its task is never answered.
    """
    return set(pool._pool_manager.worker_manager.workers)  # noqa: SLF001  (no public way)
