"""One worker process at a time, warm, replaceable: what the engine's slots are made of.

Each slot has a pool of its own with a single worker. In a shared pool the workers hold a common lock while they
fetch and answer: one that is killed in that moment takes the others with it, and the death of an idle worker breaks
the pool. Here a death costs one slot its worker, at any moment.
"""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
import sys
import threading
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import wait
from pathlib import Path
from typing import Any

import pebble

from service.blas_threads import one_thread
from service.files.lock import file_lock
from service.worker import attempt as worker
from simcore.errors import NeedlebenchError


class Lost(NeedlebenchError):
    """The worker process died before it answered."""


TERM_TIMEOUT_S = 0.2  # between SIGTERM and SIGKILL
pebble.CONSTS.term_timeout = TERM_TIMEOUT_S
_PR_SET_PDEATHSIG = 1


class Worker:
    """A worker process that does one call at a time; started at once, warm after `warm()` has answered."""

    def __init__(self) -> None:
        one_thread()  # inherited by the worker, before it imports numpy
        self._pool = pebble.ProcessPool(
            max_workers=1,
            initializer=_prepare,
            initargs=(os.getpid(),),
            context=multiprocessing.get_context("spawn"),
        )

    def call(self, function: Any, *args: Any) -> Future[Any]:
        """Run `function(*args)` in the worker. Raises Lost when there is no worker any more."""
        try:
            future: Future[Any] = self._pool.schedule(function, args=args)
        except RuntimeError as error:
            raise Lost(f"the worker process is gone: {error}") from None
        return future

    @property
    def alive(self) -> bool:
        """Whether calls still get an answer; a worker that dies idle takes its pool along."""
        return bool(self._pool.active)

    def stop(self) -> None:
        """End the process: SIGTERM, and SIGKILL after 0.2 s. On return it is gone."""
        self._pool.stop()  # type: ignore[no-untyped-call]
        self._pool.join()


def answer(future: Future[Any]) -> Any:
    """What a finished call returned. Raises Lost, with the signal or exit code, when the process died instead."""
    try:
        return future.result(timeout=0)
    except pebble.ProcessExpired as death:
        code = death.exitcode
        end = f"signal {-code}" if code < 0 else f"exit code {code}"
        raise Lost(f"its worker process died ({end})") from None
    except BrokenProcessPool:
        raise Lost("its worker process died") from None


def warm(runner: str, lock: str) -> int:
    """In the worker: make ready for `runner`; the process id. One worker at a time compiles, the next finds it done."""
    with file_lock(Path(lock), wait=True):
        worker.resolve(f"{runner.partition(':')[0]}:warm_up")()
    return os.getpid()


def _prepare(parent: int) -> None:
    """First thing in a worker: never outlive the service, however that ends."""
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:  # it died before we asked
            os._exit(1)
    threading.Thread(target=_die_with_parent, name="parent-watch", daemon=True).start()


def _die_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)
