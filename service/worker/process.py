"""One worker process at a time, warm and replaceable: what engine slots and crews are made of.

Each worker has a pool of its own. In a shared pool the workers hold a common lock while they fetch and answer: one that
is killed in that moment takes the others with it, and the death of an idle worker breaks the pool. Here a death costs
its owner one worker, at any moment.
"""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
import sys
import threading
from concurrent.futures import CancelledError, Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from multiprocessing.connection import wait as wait_for_end
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pebble

from service.blas_threads import one_thread
from service.files.lock import file_lock
from service.worker.attempt import execute, resolve
from service.worker.failures import described
from service.worker.guard import guard_pid, lead_group
from service.worker.memory import group_mb
from service.worker.pebble_overrides import living_workers, single_worker_pool
from service.worker.processes import Process, descendants, end_process, session_members
from simcore.errors import NeedlebenchError

if TYPE_CHECKING:
    from service.worker.specs import AttemptReport, InsertionSpec, TrainingSpec

_PR_SET_PDEATHSIG = 1
_SCAN_EVERY = 3  # looks at the memory: a scan of the process table costs ten times as much as the rest of a look
_ANSWER_S = 1.0  # that the pool takes from the end of a process to the answer about it, at most


class WorkerDiedError(NeedlebenchError):
    """The worker process died before it answered."""


class WorkerProcess:
    """A worker process that does one attempt at a time: start, wait until it is ready, send, wait, collect, kill.

    runner: `module:function` of the attempts to come; `warm_up` of its module makes the worker ready. warm_lock: one
    worker at a time compiles, the next finds it done. pid: of a warm worker. starts: how often it was started.

    The thread that starts a worker must outlive it: Linux tells a child of the death of its parent's thread.
    """

    def __init__(self, runner: str, warm_lock: Path) -> None:
        self._runner, self._warm_lock = runner, warm_lock
        self._pool: pebble.ProcessPool | None = None
        self._pending: Future[Any] | None = None
        self._group: set[Process] = set()  # seen while it ran, wherever they went since
        self.pid: int | None = None
        self._guard_pid: int | None = None
        self._started: list[Process] = []  # by the attempt, at the last scan
        self._looks = 0
        self.starts = 0

    def start(self) -> None:
        """A new process, in place of the one before, which begins to warm up."""
        self.kill()
        one_thread()  # inherited by the worker, before it imports numpy
        self._pool = single_worker_pool(_prepare, os.getpid())
        self.starts += 1
        self._pending = self.call(_warm, self._runner, str(self._warm_lock))

    @property
    def alive(self) -> bool:
        """Whether calls still get an answer; a worker that dies idle takes its pool along."""
        return self._pool is not None and bool(self._pool.active)

    @property
    def pending(self) -> Future[Any] | None:
        """What it is at: warming up, or an attempt; None once that was collected."""
        return self._pending

    def ready(self, timeout_s: float = 0.0) -> bool:
        """Whether it can be sent an attempt, after waiting for its warm-up. Raises WorkerDiedError."""
        if self.pid is None:
            if self._pending is None or not self.wait(timeout_s):
                return False
            self.pid, self._guard_pid = self._take_answer()
        if not self.alive or self._replaced:
            raise WorkerDiedError("the worker process died while it had nothing to do")
        return True

    def call(self, function: Any, *args: Any) -> Future[Any]:
        """Run `function(*args)` there, apart from attempts. Raises WorkerDiedError when there is no worker any more."""
        try:
            if self._pool is None:
                raise RuntimeError("it was not started, or killed")
            future: Future[Any] = self._pool.schedule(function, args=args)
        except RuntimeError as error:
            raise WorkerDiedError(f"the worker process is gone: {error}") from None
        return future

    def send(self, runner: str, spec: InsertionSpec | TrainingSpec, folder: Path) -> None:
        """Begin an attempt: `runner` in `folder`. Raises WorkerDiedError."""
        self._started, self._looks = [], 0
        self._pending = self.call(execute, runner, spec.to_json(), str(folder))

    def wait(self, timeout_s: float) -> bool:
        """Whether what it is at has ended, after waiting at most so long. Raises WorkerDiedError when it never will."""
        assert self._pending is not None, "nothing was sent"
        if _done(self._pending, timeout_s):
            return True
        if not self.alive or self._replaced:
            if _done(self._pending, _ANSWER_S):
                return True
            raise WorkerDiedError("its worker process ended (exit code 0)" if self.alive else "its worker process died")
        return False

    @property
    def _replaced(self) -> bool:
        """Whether the pool has another process by now than the one that was warm."""
        return self._pool is not None and self.pid is not None and self.pid not in living_workers(self._pool)

    def held_mb(self) -> float | None:
        """Memory of the worker and of all that its attempt has started, MB (10^6 bytes); None where nobody says.

        What it has started is looked up at every third call, and counted as of then.
        """
        if self.pid is None:
            return None
        if self._looks % _SCAN_EVERY == 0:
            self._started = descendants(self.pid)
            self._group.update(self._started)
        self._looks += 1
        return group_mb(self.pid, (one.pid for one in self._started if one.pid != self._guard_pid))

    def collect(self) -> AttemptReport:
        """What an attempt that has ended left. Raises WorkerDiedError, with the signal or exit code."""
        report: AttemptReport = self._take_answer()
        return report

    def kill(self) -> None:
        """End the process, and what it is at: SIGTERM, and SIGKILL after 0.2 s; then whatever it had started.

        On return they are gone.
        """
        pool, self._pool, self._pending = self._pool, None, None
        pid, self.pid = self.pid, None
        group, self._group = self._group, set()
        if pool is None:
            return
        if pid is not None:
            group |= set(descendants(pid))
        pool.stop()  # type: ignore[no-untyped-call]
        pool.join()
        if pid is not None:
            for process in group.union(session_members(pid)):
                end_process(process)

    def _take_answer(self) -> Any:
        assert self._pending is not None, "nothing was sent"
        pending, self._pending = self._pending, None
        return answer(pending)


def _done(future: Future[Any], timeout_s: float) -> bool:
    """Whether it has ended, after waiting at most so long; what it raised is raised elsewhere."""
    with suppress(TimeoutError, CancelledError):
        future.exception(timeout=timeout_s)
    return future.done()


def answer(future: Future[Any]) -> Any:
    """What a finished call returned. Raises WorkerDiedError, with the signal or exit code, if its process died.

    What the call raised is raised here; as WorkerDiedError if it would end a thread or a program (SystemExit).
    """
    failure = future.exception(timeout=0)
    if isinstance(failure, pebble.ProcessExpired):
        code = failure.exitcode
        end = f"signal {-code}" if code < 0 else f"exit code {code}"
        raise WorkerDiedError(f"its worker process died ({end})")
    if isinstance(failure, BrokenProcessPool):
        raise WorkerDiedError("its worker process died")
    if failure is not None and not isinstance(failure, Exception):
        raise WorkerDiedError(f"its worker process raised {described(failure)}")
    return future.result(timeout=0)


# -- in the worker


def _warm(runner: str, lock: str) -> tuple[int, int | None]:
    """Make ready for `runner`; the ids of this process and of its guard."""
    with file_lock(Path(lock), wait=True):
        resolve(f"{runner.partition(':')[0]}:warm_up")()
    return os.getpid(), guard_pid()


def _prepare(parent: int) -> None:
    """First thing in a worker: never outlive the service, however that ends, and lead a group of its own."""
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:  # it died before we asked
            os._exit(1)
    lead_group()
    threading.Thread(target=_die_with_parent, name="parent-watch", daemon=True).start()


def _die_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait_for_end([parent.sentinel])
        os._exit(1)
