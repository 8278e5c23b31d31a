"""Archives written and read in the form of `zip_format`: the same files give the same bytes, read in bounded memory."""

from __future__ import annotations

import hashlib
import zlib
from contextlib import contextmanager
from typing import TYPE_CHECKING, BinaryIO

from benchmarks.bundles.canonical import BundleError
from benchmarks.bundles.zip_format import (
    MOST_BYTES,
    MOST_ENTRIES,
    Entry,
    archive_bytes,
    central_header,
    check_name,
    ending,
    in_order,
    local_header,
    read_directory,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

_CHUNK = 1 << 20


def size_of(content: bytes | Path) -> int:
    """Bytes of a file to come."""
    return len(content) if isinstance(content, bytes) else content.stat().st_size


def total_bytes(contents: Mapping[str, bytes | Path]) -> int:
    """How large the archive will be. Raises BundleError for more than a bundle can hold."""
    total = archive_bytes({name: size_of(content) for name, content in contents.items()})
    if len(contents) > MOST_ENTRIES:
        raise BundleError(f"would have {len(contents)} files; a bundle has at most {MOST_ENTRIES}")
    if total > MOST_BYTES:
        raise BundleError(f"would have {total / 1e9:.1f} GB; a bundle has at most {MOST_BYTES / 1e9:g} GB")
    return total


def write_archive(file: BinaryIO, contents: Mapping[str, bytes | Path]) -> None:
    """Write the archive of these files, by name. Raises BundleError for a name that cannot be."""
    entries, at = [], 0
    for name in in_order(list(contents)):
        check_name(name)
        size, crc, _ = summed(contents[name])
        header = local_header(name, size, crc)
        file.write(header)
        for chunk in chunks_of(contents[name]):
            file.write(chunk)
        entries.append(Entry(name, size, crc, at + len(header)))
        at += len(header) + size
    directory = b"".join(central_header(entry) for entry in entries)
    file.write(directory + ending(len(entries), len(directory), at))


def chunks_of(content: bytes | Path) -> Iterator[bytes]:
    """A file in pieces of a megabyte."""
    if isinstance(content, bytes):
        yield content
        return
    with content.open("rb") as file:
        while chunk := file.read(_CHUNK):
            yield chunk


def summed(content: bytes | Path) -> tuple[int, int, str]:
    """(bytes, CRC-32, SHA-256) of a file."""
    return _summed(chunks_of(content))


def _summed(chunks: Iterator[bytes]) -> tuple[int, int, str]:
    size, crc, hashed = 0, 0, hashlib.sha256()
    for chunk in chunks:
        size, crc = size + len(chunk), zlib.crc32(chunk, crc)
        hashed.update(chunk)
    return size, crc, hashed.hexdigest()


class Archive:
    """An archive that is open for reading; made by `open_archive`."""

    def __init__(self, file: BinaryIO, entries: list[Entry]) -> None:
        self._file = file
        self.entries = {entry.name: entry for entry in entries}

    def chunks(self, name: str) -> Iterator[bytes]:
        """A file in pieces. Raises BundleError for one that there is not."""
        if name not in self.entries:
            raise BundleError(f"does not hold {name}")
        entry = self.entries[name]
        at, left = entry.start, entry.size
        while left:
            self._file.seek(at)
            chunk = self._file.read(min(_CHUNK, left))
            if not chunk:
                raise BundleError(f"{name} is cut off")
            at, left = at + len(chunk), left - len(chunk)
            yield chunk

    def summed(self, name: str) -> str:
        """SHA-256 of a file. Raises BundleError where its checksum in the archive is not that of its content."""
        _, crc, sha256 = _summed(self.chunks(name))
        if crc != self.entries[name].crc:
            raise BundleError(f"{name} was changed: its content does not fit its checksum")
        return sha256

    def read(self, name: str, *, most: int) -> bytes:
        """The whole of a file. Raises BundleError for one of more than `most` bytes or with a wrong checksum."""
        size = self.entries[name].size if name in self.entries else 0
        if size > most:
            raise BundleError(f"{name} has {size / 1e6:.0f} MB; at most {most / 1e6:g} MB are read")
        content = b"".join(self.chunks(name))
        if zlib.crc32(content) != self.entries[name].crc:
            raise BundleError(f"{name} was changed: its content does not fit its checksum")
        return content

    def lines(self, name: str, *, most: int) -> Iterator[bytes]:
        """The lines of a text, without their ends. Raises BundleError for one of more than `most` bytes."""
        rest = b""
        for chunk in self.chunks(name):
            *whole, rest = (rest + chunk).split(b"\n")
            yield from whole
            if len(rest) > most:
                raise BundleError(f"{name} has a line of more than {most / 1e6:g} MB")
        if rest:
            raise BundleError(f"{name} is cut off within a line")

    def extract(self, name: str, target: Path) -> Path:
        """Write a file to `target`, whose folder is made. Returns it."""
        target.parent.mkdir(parents=True, exist_ok=True)
        with target.open("wb") as file:
            for chunk in self.chunks(name):
                file.write(chunk)
        return target


@contextmanager
def open_archive(path: Path) -> Iterator[Archive]:
    """The archive at `path`. Raises BundleError for what is none, or not in the one form that a bundle has."""
    if not path.is_file():
        raise BundleError("is no file")
    try:
        file = path.open("rb")
    except OSError as error:
        raise BundleError(f"cannot be read: {error.strerror}") from None
    with file:
        yield Archive(file, read_directory(file, path.stat().st_size))
