"""Runs the service in this process: one engine a data folder, one port, until a signal."""

from __future__ import annotations

import asyncio
import contextlib
import ctypes
import errno
import json
import logging
import math
import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType

import uvicorn
from sqlalchemy.exc import DatabaseError

from service import logs
from service.api.context import Service
from service.app import create_app
from service.files.lock import LockHeldError, file_lock
from service.server.http_protocol import Protocol
from service.settings import DEFAULT_PORT, Settings, url_of
from service.worker.progress import replace_text
from simcore.errors import NeedlebenchError

_log = logging.getLogger(logs.ROOT)
ENDPOINT = "endpoint.json"
_PORTS_TRIED = 50
_GRACE_S = 3
_IDLE_S = 75  # that a connection is kept: who asks every few seconds need not connect anew
_M_ARENA_MAX = -8  # of glibc's mallopt


class CannotServe(NeedlebenchError):
    """The service cannot start here; says why and what to do."""


def serve(settings: Settings, *, announce: Callable[[str], None], until_stdin_closes: bool = False) -> None:
    """Serve until SIGINT or SIGTERM; running jobs then end within `settings.drain_s` or go back into the queue.

    announce: hears the address once the service listens. until_stdin_closes: end with the process
    that holds the other end of standard input. Raises CannotServe, ForeignDatabaseError.
    """
    _share_arenas()
    with contextlib.ExitStack() as stack:
        with _told(settings.data):
            settings.data.mkdir(parents=True, exist_ok=True)
            stack.enter_context(file_lock(settings.data / "server.lock"))
        listener = stack.enter_context(contextlib.closing(listen(settings.host, settings.port)))
        with _told(settings.data):
            service = Service.open(settings)
        url = url_of(settings.host, listener.getsockname()[1])
        server = _Server(service, url, announce)
        if until_stdin_closes:
            threading.Thread(target=_follow_stdin, args=(server,), daemon=True).start()
        previous = signal.signal(signal.SIGTERM, _leave)  # what uvicorn raises again once all is closed
        try:
            server.run(sockets=[listener])
        except KeyboardInterrupt:
            pass
        finally:
            signal.signal(signal.SIGTERM, previous)


def _share_arenas() -> None:
    """Two heaps for all threads: glibc gives up to eight threads a core one of their own, each of which keeps the most
    that it ever held, and a server's memory would creep up for days."""
    if sys.platform == "linux":
        with contextlib.suppress(AttributeError, OSError):  # another C library
            ctypes.CDLL(None).mallopt(_M_ARENA_MAX, 2)


@contextlib.contextmanager
def _told(data: Path) -> Iterator[None]:
    """What is wrong with a data folder in words that say what to do. Raises CannotServe."""
    try:
        yield
    except LockHeldError as busy:
        raise CannotServe(_taken(data, str(busy))) from None
    except (OSError, DatabaseError) as error:
        reason = error.strerror if isinstance(error, OSError) else error.orig
        advice = "make it writable for this user, free space on its disk, or choose another folder with --data"
        raise CannotServe(f"the data folder {data} cannot be used: {reason}; {advice}") from None


def listen(host: str, port: int | None) -> socket.socket:
    """A listening socket on `port`; without one on the default port or the next free. Raises CannotServe."""
    tried = [port] if port is not None else [*range(DEFAULT_PORT, DEFAULT_PORT + _PORTS_TRIED), 0]
    for candidate in tried:
        try:
            return _bound(host, candidate)
        except OSError as error:
            taken = error.errno in (errno.EADDRINUSE, errno.EACCES)
            if not taken or candidate == tried[-1]:
                advice = "; choose another with --port, or leave it out for the next free one" if taken else ""
                reason = os.strerror(error.errno) if error.errno else str(error)
                raise CannotServe(f"cannot listen on {host} port {candidate}: {reason}{advice}") from None
    raise AssertionError("unreachable")


def _bound(host: str, port: int) -> socket.socket:
    family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)[0][0]
    listener = socket.create_server((host, port), family=family, backlog=512)
    # Connections inherit it. asyncio sets it only on sockets that name their protocol, which accepted ones do not, and
    # an answer whose headers and body go out apart then waits for a delayed acknowledgement, 40 ms.
    listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return listener


def moved(port: int | None, url: str) -> str | None:
    """What to say when the default port was taken."""
    if port is not None or url.endswith(f":{DEFAULT_PORT}"):
        return None
    return f"port {DEFAULT_PORT} is taken: using {url.rpartition(':')[2]}"


def endpoint(data: Path) -> str | None:
    """Where the service of this data folder said that it listens; it may be gone."""
    try:
        url = json.loads((data / ENDPOINT).read_text(encoding="utf-8"))["url"]
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return str(url)


class _Server(uvicorn.Server):
    """uvicorn, which tells where it listens and lets long polls and live recordings go at once."""

    def __init__(self, service: Service, url: str, announce: Callable[[str], None]) -> None:
        config = uvicorn.Config(
            create_app(service),
            http=Protocol,
            ws="none",
            log_config=None,
            log_level="warning",
            access_log=False,
            server_header=False,
            timeout_graceful_shutdown=_GRACE_S,
            timeout_keep_alive=_IDLE_S,
            lifespan="on",
        )
        super().__init__(config)
        self._service, self._url, self._announce = service, url, announce
        self._drain_until = -math.inf

    async def on_tick(self, counter: int) -> bool:
        """Whether to shut down: asked to, and what was to be waited for has ended."""
        return await super().on_tick(counter) and self._drained()

    def _drained(self) -> bool:
        engine, now = self._service.engine, time.monotonic()
        if not engine.draining:
            engine.drain()
            self._drain_until = now + self._service.settings.drain_s
        return engine.busy == 0 or now >= self._drain_until

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """A second signal ends the waiting for running jobs, a third one uvicorn's."""
        if self.should_exit and time.monotonic() < self._drain_until:
            self._drain_until = -math.inf
            return
        super().handle_exit(sig, frame)

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets=sockets)
        if self.started:
            data = self._service.settings.data
            try:
                await asyncio.to_thread(replace_text, data / ENDPOINT, json.dumps({"url": self._url}))
            except OSError as error:  # a full disk: who asks for the address must be told by hand
                _log.warning("%s cannot be written: %s", ENDPOINT, error)
            self._announce(self._url)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        self._service.changes.close()
        await super().shutdown(sockets=sockets)


def _follow_stdin(server: uvicorn.Server) -> None:
    while os.read(sys.stdin.fileno(), 4096):  # not through its buffer: its lock would outlive this thread
        pass
    server.should_exit = True


def _leave(_number: int, _frame: FrameType | None) -> None:
    raise SystemExit(0)


def _taken(data: Path, holder: str) -> str:
    url = endpoint(data)
    where = f" It listens at {url}." if url else ""
    return (
        f"the data folder {data} is in use by another needlebench service ({holder or 'unknown process'}).{where} "
        "Use that one, stop it, or choose another folder with --data"
    )


def main() -> None:
    """Serve by environment variables alone, as the demo does; ends with whoever started it."""
    logs.configure("text")
    try:
        serve(Settings.load(), announce=lambda line: print(line, flush=True), until_stdin_closes=True)
    except NeedlebenchError as error:
        print(error, file=sys.stderr)
        raise SystemExit(2) from None


if __name__ == "__main__":
    main()
