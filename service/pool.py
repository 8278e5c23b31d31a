"""One worker process at a time, warm, replaceable: what the engine's slots are made of.

A pipe of its own joins each worker with this process: a death, in whatever moment, costs one slot its worker and
nothing else. A call is sent by the thread that asks, and one thread a worker waits for answers: what a short job costs
beyond its own time is two messages.
"""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import pickle
import signal
import sys
import threading
from collections import deque
from concurrent.futures import Future
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

from service import worker
from service.lock import held
from service.threads import one_thread
from simcore.errors import NeedlebenchError

TERM_TIMEOUT_S = 0.2  # between SIGTERM and SIGKILL
_PR_SET_PDEATHSIG = 1


class Lost(NeedlebenchError):
    """The worker process died before it answered."""


class Worker:
    """A worker process that does one call after the other; started at once, warm after `warm()` has answered.

    The thread that makes it must outlive it: Linux tells a child of the death of its parent's thread.
    """

    def __init__(self) -> None:
        one_thread()  # inherited by the worker, before it imports numpy
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, os.getpid()), name="worker", daemon=True)
        self._process.start()
        theirs.close()  # now the pipe ends with the process
        self._turn = threading.Lock()  # of what follows, and of sending
        self._asked: deque[Future[Any]] = deque()  # in the order in which the answers will come
        self._gone = False
        self._listener = threading.Thread(target=self._listen, name=f"worker-{self._process.pid}", daemon=True)
        self._listener.start()

    def call(self, function: Any, *args: Any) -> Future[Any]:
        """Run `function(*args)` in the worker. Raises Lost when there is no worker any more."""
        message = pickle.dumps((function, args), protocol=pickle.HIGHEST_PROTOCOL)
        future: Future[Any] = Future()
        with self._turn:
            if self._gone:
                raise Lost("the worker process is gone")
            future.set_running_or_notify_cancel()
            self._asked.append(future)
            try:
                self._pipe.send_bytes(message)
            except OSError as error:
                self._asked.pop()
                raise Lost(f"the worker process is gone: {error}") from None
        return future

    @property
    def alive(self) -> bool:
        """Whether calls still get an answer."""
        return not self._gone

    def stop(self) -> None:
        """End the process: SIGTERM, and SIGKILL after 0.2 s. On return it is gone."""
        if not self._gone:
            self._process.terminate()
        self._listener.join(TERM_TIMEOUT_S)
        if self._listener.is_alive():
            self._process.kill()
            self._listener.join()
        self._pipe.close()

    def _listen(self) -> None:
        """Hand answers on until the process ends; what it was asked then is lost."""
        while True:
            try:
                message = self._pipe.recv_bytes()
            except (EOFError, OSError):
                break
            done, value = _understood(message)
            with self._turn:
                future = self._asked.popleft()
            if done:
                future.set_result(value)
            else:
                future.set_exception(value)
        self._process.join()
        death = Lost(_death(self._process.exitcode))
        with self._turn:
            self._gone = True
            lost = list(self._asked)
            self._asked.clear()
        for future in lost:
            future.set_exception(death)


def _death(code: int | None) -> str:
    """code: None in the rare case that another thread has just taken it."""
    if code is None:
        return "its worker process died"
    return f"its worker process died ({f'signal {-code}' if code < 0 else f'exit code {code}'})"


def _understood(message: bytes) -> tuple[bool, Any]:
    try:
        done, value = pickle.loads(message)
    except Exception as error:  # what was raised there cannot be made again here
        return False, error
    return bool(done), value


def answer(future: Future[Any]) -> Any:
    """What a finished call returned. Raises Lost, with the signal or exit code, when the process died instead."""
    return future.result(timeout=0)


def warm(runner: str, lock: str) -> int:
    """In the worker: make ready for `runner`; the process id. One worker at a time compiles, the next finds it done."""
    with held(Path(lock), wait=True):
        worker.resolve(f"{runner.partition(':')[0]}:warm_up")()
    return os.getpid()


def _serve(pipe: Connection, parent: int) -> None:
    """The life of a worker: a call, its answer, the next."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the service, which stops its workers
    _prepare(parent)
    while True:
        try:
            message = pipe.recv_bytes()
        except EOFError:
            return
        pipe.send_bytes(_done(message))


def _done(message: bytes) -> bytes:
    """The answer to a call: what it returned, or what it raised."""
    try:
        function, args = pickle.loads(message)
        return pickle.dumps((True, function(*args)), protocol=pickle.HIGHEST_PROTOCOL)
    except Exception as error:
        return _raised(error)


def _raised(error: Exception) -> bytes:
    try:
        return pickle.dumps((False, error))
    except Exception:  # an exception that cannot be sent is told in words
        return pickle.dumps((False, RuntimeError(f"{type(error).__name__}: {error}")))


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
