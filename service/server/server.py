"""Runs the service in this process: one engine a data folder, one port, until a signal."""

from __future__ import annotations

import contextlib
import ctypes
import errno
import gc
import os
import signal
import socket
import sqlite3
import sys
import threading
from typing import TYPE_CHECKING

from service import logs
from service.api.context import Service
from service.files.endpoint import endpoint, make_token
from service.files.lock import LockHeldError, file_lock
from service.files.private import private_files, private_folder
from service.server.last_resort import STOP_S, LastResort
from service.server.uvicorn_overrides import Server
from service.settings import DEFAULT_PORT, Settings, url_of
from service.store.errors import DatabaseError
from simcore import plugins
from simcore.errors import NeedlebenchError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path
    from types import FrameType

    import uvicorn

_PORTS_TRIED = 50
_OWN_DESCRIPTORS = 300  # of the database, 50 connections with two files each, of workers, files and logs
_LEAST_CONNECTIONS = 16
_M_ARENA_MAX = -8  # of glibc's mallopt


class ServiceStartError(NeedlebenchError):
    """The service cannot start here; says why and what to do."""


def serve(settings: Settings, *, announce: Callable[[str], None], until_stdin_closes: bool = False) -> None:
    """Serve until SIGINT or SIGTERM; running jobs then end within `settings.drain_s` or go back into the queue, and the
    process ends within `last_resort.STOP_S` more, whatever its threads are at.

    announce: hears the address once the service listens. until_stdin_closes: end with the process
    that holds the other end of standard input. Raises ServiceStartError, SettingsError, ForeignDatabaseError.
    """
    settings.check_exposure()
    plugins.note_installed()
    _share_arenas()
    with contextlib.ExitStack() as stack:
        with _data_folder_errors(settings.data):
            stack.enter_context(private_files())
            private_folder(settings.data)
            stack.enter_context(file_lock(settings.data / "server.lock"))
        listener = stack.enter_context(contextlib.closing(listen(settings.host, settings.port)))
        with _data_folder_errors(settings.data):
            service = Service.open(settings)
        url = url_of(settings.host, listener.getsockname()[1])
        service.keys.take_local_token(make_token(settings.data))
        last_resort = LastResort(STOP_S)
        server = Server(service, url, announce, last_resort, most_connections=_connections(settings.connections))
        if until_stdin_closes:
            threading.Thread(target=_follow_stdin, args=(server,), daemon=True).start()
        gc.collect()
        gc.freeze()  # what is there by now stays: each collection would look at all of it, for up to 0.1 s
        previous = signal.signal(signal.SIGTERM, _exit)  # what uvicorn raises again once all is closed
        try:
            server.run(sockets=[listener])
        except KeyboardInterrupt:
            pass
        finally:
            signal.signal(signal.SIGTERM, previous)
            last_resort.join_threads()
            gc.freeze()  # else the interpreter looks at everything once more: seconds, where cores are busy


def _connections(wanted: int) -> int:
    """As many connections as wanted, and as descriptors are left when the store, jobs and files have theirs."""
    if sys.platform == "win32":
        return wanted
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    needed = wanted + _OWN_DESCRIPTORS
    if soft != resource.RLIM_INFINITY and soft < needed:
        raised = needed if hard == resource.RLIM_INFINITY else min(needed, hard)
        with contextlib.suppress(ValueError, OSError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (raised, hard))
        soft = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    return wanted if soft == resource.RLIM_INFINITY else max(_LEAST_CONNECTIONS, min(wanted, soft - _OWN_DESCRIPTORS))


def _share_arenas() -> None:
    """Two heaps for all threads: glibc gives up to eight threads a core one of their own, each of which keeps the most
    that it ever held, and a server's memory would creep up for days."""
    if sys.platform == "linux":
        with contextlib.suppress(AttributeError, OSError):  # another C library
            ctypes.CDLL(None).mallopt(_M_ARENA_MAX, 2)


@contextlib.contextmanager
def _data_folder_errors(data: Path) -> Iterator[None]:
    """What is wrong with a data folder in words that say what to do. Raises ServiceStartError."""
    try:
        yield
    except LockHeldError as lock:
        raise ServiceStartError(_in_use(data, str(lock))) from None
    except (OSError, DatabaseError, sqlite3.DatabaseError) as error:
        reason = error.strerror if isinstance(error, OSError) else getattr(error, "orig", error)
        advice = "make it writable for this user, free space on its disk, or choose another folder with --data"
        raise ServiceStartError(f"the data folder {data} cannot be used: {reason}; {advice}") from None


def listen(host: str, port: int | None) -> socket.socket:
    """A listening socket on `port`; without one on the default port or the next free. Raises ServiceStartError."""
    tried = [port] if port is not None else [*range(DEFAULT_PORT, DEFAULT_PORT + _PORTS_TRIED), 0]
    for candidate in tried:
        try:
            return _bound(host, candidate)
        except OSError as error:
            taken = error.errno in (errno.EADDRINUSE, errno.EACCES)
            if not taken or candidate == tried[-1]:
                advice = "; choose another with --port, or leave it out for the next free one" if taken else ""
                reason = os.strerror(error.errno) if error.errno else str(error)
                raise ServiceStartError(f"cannot listen on {host} port {candidate}: {reason}{advice}") from None
    raise AssertionError("unreachable")


def _bound(host: str, port: int) -> socket.socket:
    family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)[0][0]
    listener = socket.create_server((host, port), family=family, backlog=512)
    # Connections inherit it. asyncio sets it only on sockets that name their protocol, which accepted ones do not, and
    # an answer whose headers and body go out apart then waits for a delayed acknowledgement, 40 ms.
    listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return listener


def _follow_stdin(server: uvicorn.Server) -> None:
    while os.read(sys.stdin.fileno(), 4096):  # not through its buffer: its lock would outlive this thread
        pass
    server.should_exit = True


def _exit(_number: int, _frame: FrameType | None) -> None:
    raise SystemExit(0)


def _in_use(data: Path, holder: str) -> str:
    url = endpoint(data)
    where = f" It listens at {url}." if url else ""
    return (
        f"the data folder {data} is in use by another needlebench service ({holder or 'unknown process'}).{where} "
        "Use that one, stop it, or choose another folder with --data"
    )


def _print_address(url: str) -> None:
    sys.stdout.write(f"{url}\n")
    sys.stdout.flush()


def main() -> None:
    """Serve by environment variables alone, as the demo does; ends with whoever started it."""
    logs.configure("text")
    try:
        serve(Settings.load(), announce=_print_address, until_stdin_closes=True)
    except NeedlebenchError as error:
        sys.stderr.write(f"{error}\n")
        raise SystemExit(2) from None


if __name__ == "__main__":
    main()
