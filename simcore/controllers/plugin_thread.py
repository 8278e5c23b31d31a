"""The thread that a plug-in lives in: a run waits for each of its answers as long as it may, and not for ever."""

from __future__ import annotations

import ctypes
import sys
import threading
from contextlib import suppress
from contextvars import copy_context
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any, TypeVar

from threadpoolctl import threadpool_limits

if TYPE_CHECKING:
    from collections.abc import Callable

Answer = TypeVar("Answer")
Reply = tuple[Any, BaseException | None]  # what was returned, or else what was raised

FAREWELL_S = 1.0  # for the thread to end that has nothing left to do


class LateError(Exception):
    """Nothing came back in time."""


class _AbandonedError(BaseException):
    """Raised within a function that nobody waits for any more."""


class PluginThread:
    """Calls functions one after the other, all in one thread, which sees the caller's context variables and has one
    BLAS thread as the caller has.

    A function that is late is left behind: Python ends it at its next instruction, but not while it waits in a call of
    the system, and never while it computes in C without letting go of the interpreter. Where `_ending_would_stall`, it
    is not ended.
    """

    def __init__(self, name: str) -> None:
        self._calls: SimpleQueue[Callable[[], Any] | None] = SimpleQueue()
        self._replies: SimpleQueue[Reply] = SimpleQueue()
        self._late = False
        self._ready = threading.Event()  # an exception from outside must not end it within a library of somebody else's
        context = copy_context()
        self._thread = threading.Thread(target=context.run, args=(self._serve,), name=f"controller {name}", daemon=True)
        self._thread.start()
        self._ready.wait()

    def call(self, function: Callable[[], Answer], limit_s: float) -> Answer:
        """What it returns, or raises, whatever that is. Raises LateError after limit_s: nothing can be called then."""
        self._calls.put(function)
        try:
            answer, error = self._replies.get(timeout=limit_s)
        except Empty:
            self._abandon()
            raise LateError from None
        except BaseException:  # of a signal's handler
            self._abandon()
            raise
        if error is not None:
            raise error
        found: Answer = answer
        return found

    def end(self) -> None:
        """Nothing more is called. Idempotent."""
        self._calls.put(None)
        if not self._late:
            self._thread.join(FAREWELL_S)

    def _abandon(self) -> None:
        self._late = True
        self._calls.put(None)
        if (identity := self._thread.ident) is not None and not _ending_would_stall():
            ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(identity), ctypes.py_object(_AbandonedError))

    def _serve(self) -> None:
        try:
            with suppress(_AbandonedError), threadpool_limits(1):
                self._ready.set()
                while (function := self._calls.get()) is not None:
                    self._replies.put(_called(function))
        finally:
            self._ready.set()


def _ending_would_stall() -> bool:
    """Whether this thread is traced, by a debugger or for coverage, under Python 3.11: that stands at its next call,
    with a core at full load, until an exception that was set for another thread has arrived there."""
    return sys.version_info < (3, 12) and sys.gettrace() is not None


def _called(function: Callable[[], Any]) -> Reply:
    try:
        return function(), None
    except BaseException as error:  # noqa: BLE001  (it is raised again where it is waited for)
        return None, error
