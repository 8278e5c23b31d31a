"""Which account of this machine holds the other end of a connection over loopback; Linux says so, others do not."""

from __future__ import annotations

import os
import socket
import struct
from ipaddress import IPv4Address, ip_address
from pathlib import Path

TABLES = (Path("/proc/net/tcp"), Path("/proc/net/tcp6"))
_ROOT = 0
Address = tuple[str, int]


def account_of(client: Address, server: Address, tables: tuple[Path, ...] = TABLES) -> int | None:
    """The user id behind the client's end of a TCP connection; None where nobody says.

    An end that its process has closed belongs to nobody any more: the kernel then shows user 0, which is not believed.
    """
    wanted = {f" {_shown(client, v6)} {_shown(server, v6)} ".encode() for v6 in (False, True) if _fits(client, v6)}
    for table in tables:
        try:
            data = table.read_bytes()
        except OSError:
            continue
        for ends in wanted:
            start = data.find(ends)
            if start >= 0:
                fields = data[start : data.find(b"\n", start)].split()
                return int(fields[6]) if fields[8] != b"0" else None
    return None


def is_own(account: int | None) -> bool:
    """Whether it is the account of this process, or root, who can read everything anyway."""
    return account is not None and account in (os.getuid(), _ROOT)


def _fits(address: Address, v6: bool) -> bool:
    return v6 or isinstance(ip_address(address[0]), IPv4Address)


def _shown(address: Address, v6: bool) -> str:
    """As the kernel prints it: words of 32 bits in its own byte order, in hexadecimal, and the port."""
    host, port = address
    if v6:
        text = f"::ffff:{host}" if isinstance(ip_address(host), IPv4Address) else host
        packed = socket.inet_pton(socket.AF_INET6, text)
    else:
        packed = socket.inet_pton(socket.AF_INET, host)
    words = struct.unpack(f"={len(packed) // 4}I", packed)
    return "".join(f"{word:08X}" for word in words) + f":{port:04X}"


class Peer:
    """The other end of one connection."""

    def __init__(self, client: Address, server: Address) -> None:
        self._ends = (client, server)
        self._own: bool | None = None

    def __call__(self) -> bool | None:
        """Whether the account of this process, or root, holds it; None where nobody says. Reads a file once."""
        if self._own is None and (account := account_of(*self._ends)) is not None:
            self._own = is_own(account)
        return self._own
