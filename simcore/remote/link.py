"""A connection to one controller: a loopback TCP port or a Unix socket on which the run waits, lines, time limits."""

from __future__ import annotations

import contextlib
import ipaddress
import os
import socket
import time
from dataclasses import dataclass
from pathlib import Path

LONGEST_LINE = 65_536  # bytes of an answer
UNIX = "unix:"
LOOPBACK = "127.0.0.1:7717"


class LinkError(OSError):
    """The controller cannot be reached, has gone, or does not answer in time; the text says which."""


@dataclass(frozen=True)
class Address:
    """Where a run waits for its controller. path: of a Unix socket; else host and port."""

    host: str = ""
    port: int = 0
    path: str = ""

    @classmethod
    def parse(cls, text: str) -> Address:
        """HOST:PORT, the host a loopback address or localhost, or unix:PATH. Raises ValueError that says why not."""
        if text.startswith(UNIX):
            return cls._unix(text.removeprefix(UNIX))
        host, colon, port = text.rpartition(":")
        host = host.strip("[]")
        if not colon or not port.isascii() or not port.isdigit() or not 1 <= int(port) <= 65535:
            raise ValueError("must be HOST:PORT with a port from 1 to 65535, or unix:PATH")
        if not is_loopback(host):
            raise ValueError("must be on this machine: 127.0.0.1, ::1 or localhost; for another one use a tunnel")
        return cls(host="127.0.0.1" if host == "localhost" else host, port=int(port))

    @classmethod
    def _unix(cls, path: str) -> Address:
        if not hasattr(socket, "AF_UNIX"):
            raise ValueError("names a Unix socket, which this system does not have: use 127.0.0.1:PORT")
        if not path or "\0" in path or len(os.fsencode(path)) > 100:
            raise ValueError("must name a Unix socket by a path of 1 to 100 bytes")
        return cls(path=path)

    def listen(self) -> socket.socket:
        """A socket that waits for one connection. Raises OSError where the address cannot be had."""
        if self.path:
            self._remove_stale()
            server = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        else:
            server = socket.socket(socket.AF_INET6 if ":" in self.host else socket.AF_INET, socket.SOCK_STREAM)
            if os.name == "posix":  # elsewhere it would let two runs share a port
                server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            server.bind(self.path or (self.host, self.port))
            if self.path:
                Path(self.path).chmod(0o600)
            server.listen(1)
        except BaseException:
            server.close()
            raise
        return server

    def _remove_stale(self) -> None:
        """A socket that nobody listens on any more; another file is in the way and stays."""
        with contextlib.closing(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)) as probe:
            try:
                probe.connect(self.path)
            except ConnectionRefusedError:
                Path(self.path).unlink()
            except OSError:
                pass


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach `host`. A name other than localhost counts as reachable from outside."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


class Link:
    """Lines to and from the one controller that connects. Times by the wall clock, in seconds."""

    def __init__(self, address: Address) -> None:
        """Begins to listen. Raises OSError."""
        self.address = address
        self._server: socket.socket | None = address.listen()
        self._peer: socket.socket | None = None
        self._left = b""

    def accept(self, limit_s: float) -> None:
        """Wait until a controller has connected; nobody else can any more. Raises LinkError."""
        assert self._server is not None
        self._server.settimeout(limit_s)
        try:
            self._peer, _ = self._server.accept()
        except TimeoutError:
            raise LinkError(f"no controller has connected within {limit_s:g} s") from None
        self._close_server()
        if not self.address.path:
            self._peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def send(self, line: bytes, limit_s: float) -> None:
        """Raises LinkError."""
        assert self._peer is not None
        self._peer.settimeout(limit_s)
        try:
            self._peer.sendall(line)
        except TimeoutError:
            raise LinkError(f"does not read: a message was not taken within {limit_s:g} s") from None
        except OSError as error:
            raise LinkError(f"has gone: {error.strerror or error}") from None

    def receive(self, limit_s: float) -> bytes:
        """The next line, without its end. Raises LinkError."""
        assert self._peer is not None
        deadline = time.monotonic() + limit_s
        while b"\n" not in self._left:
            if len(self._left) > LONGEST_LINE:
                raise LinkError(f"sent more than {LONGEST_LINE} bytes without the end of a line")
            self._peer.settimeout(max(deadline - time.monotonic(), 1e-3))
            try:
                piece = self._peer.recv(LONGEST_LINE)
            except TimeoutError:
                raise LinkError(f"has not answered within {limit_s:g} s") from None
            except OSError as error:
                raise LinkError(f"has gone: {error.strerror or error}") from None
            if not piece:
                raise LinkError("has closed the connection")
            self._left += piece
        line, _, self._left = self._left.partition(b"\n")
        return line

    def close(self) -> None:
        """Let go of everything; safe to repeat."""
        if self._peer is not None:
            self._peer.close()
            self._peer = None
        self._close_server()

    def _close_server(self) -> None:
        if self._server is not None:
            self._server.close()
            self._server = None
            if self.address.path:
                with contextlib.suppress(OSError):
                    Path(self.address.path).unlink()
