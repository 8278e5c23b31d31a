"""A ZIP archive that is made while it is sent: files stored as they are, read piece by piece."""

from __future__ import annotations

import time
import zipfile
from dataclasses import dataclass
from typing import IO, TYPE_CHECKING, BinaryIO, cast

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

PIECE_BYTES = 256 * 1024  # that are in memory at a time
_WIDE_BYTES = 2**31 - 1  # from which on zipfile writes sizes in the 64-bit form
_LOCAL, _DESCRIPTOR, _CENTRAL, _END = 30, 16, 46, 22  # bytes of the headers, without names


@dataclass(frozen=True)
class ZipEntry:
    """A file of an archive. size: bytes that `content` gives."""

    name: str
    size: int
    content: BinaryIO


class _Sink:
    """What an archive is written to; holds what was not taken yet. Cannot go back, as a network cannot."""

    def __init__(self) -> None:
        self._pieces: list[bytes] = []

    def write(self, data: bytes) -> int:
        """Keep it until it is taken."""
        self._pieces.append(bytes(data))
        return len(data)

    def flush(self) -> None:
        """Nothing waits anywhere else."""

    def take(self) -> bytes:
        """What was written since the last time."""
        data = b"".join(self._pieces)
        self._pieces.clear()
        return data


def zip_stream(entries: Sequence[ZipEntry], *, at: float) -> Iterator[bytes]:
    """The archive, piece by piece; the contents are closed at its end. at: UTC seconds since 1970, of all files.

    Raises OSError for a content that is shorter than it was said to be.
    """
    sink = _Sink()
    date = max(time.gmtime(at)[:6], (1980, 1, 1, 0, 0, 0))
    try:
        with zipfile.ZipFile(cast("IO[bytes]", sink), "w") as archive:
            for entry in entries:
                info = zipfile.ZipInfo(entry.name, date_time=date)
                info.external_attr = 0o644 << 16
                with archive.open(info, "w", force_zip64=entry.size > _WIDE_BYTES) as target:
                    for piece in _pieces(entry):
                        target.write(piece)
                        yield sink.take()
        yield sink.take()
    finally:
        for entry in entries:
            entry.content.close()


def _pieces(entry: ZipEntry) -> Iterator[bytes]:
    left = entry.size
    while left > 0:
        piece = entry.content.read(min(left, PIECE_BYTES))
        if not piece:
            raise OSError(f"{entry.name} ends {left} bytes early")
        left -= len(piece)
        yield piece


def zip_bytes(entries: Sequence[ZipEntry]) -> int | None:
    """How long the archive will be; None where a file or all of them take the 64-bit form. Names: ASCII."""
    headers = sum(_LOCAL + _DESCRIPTOR + _CENTRAL + 2 * len(entry.name) for entry in entries)
    whole = headers + sum(entry.size for entry in entries) + _END
    return whole if whole <= _WIDE_BYTES else None
