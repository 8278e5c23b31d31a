"""The one form that a bundle's ZIP archive has: files stored as they are, in order, with fixed dates and rights.

Every header follows from names, sizes and checksums alone. A reader makes each header again and compares, so that no
byte of an archive is free; whatever else ZIP allows (compression, encryption, links, comments, gaps) is refused.
"""

from __future__ import annotations

import re
import stat
import struct
from typing import TYPE_CHECKING, BinaryIO, NamedTuple

from benchmarks.bundles.canonical import BundleError

if TYPE_CHECKING:
    from collections.abc import Sequence

MANIFEST = "manifest.json"  # the first file
MOST_ENTRIES = 10_000
MOST_BYTES = 4_000_000_000  # of an archive: below what ZIP can say without its 64-bit form
LONGEST_NAME = 240  # bytes

_LOCAL, _CENTRAL, _END = struct.Struct("<4s5H3L2H"), struct.Struct("<4s4B4H3L5H2L"), struct.Struct("<4s4H2LH")
_LOCAL_MARK, _CENTRAL_MARK, _END_MARK = b"PK\x03\x04", b"PK\x01\x02", b"PK\x05\x06"
_VERSION, _UNIX, _DATE, _UTF8, _ENCRYPTED = 20, 3, 0x21, 0x800, 0x41  # date: 1980-01-01, the earliest there is
_RIGHTS = (stat.S_IFREG | 0o644) << 16
_WIDE = 0xFFFFFFFF  # stands for a size in the 64-bit form
_PART = re.compile(r"[\w(+][\w .,+()@=-]*")
_RESERVED = re.compile(r"(?i)(con|prn|aux|nul|com\d|lpt\d)(\..*)?")  # names that Windows keeps for devices


class Entry(NamedTuple):
    """One file of an archive. start: of its content, bytes from the beginning of the archive."""

    name: str
    size: int
    crc: int
    start: int


def check_name(name: str) -> None:
    """Raises BundleError for a name that no file of a bundle may have: absolute, with `..`, or not plain."""
    parts = name.split("/")
    plain = all(_PART.fullmatch(part) and not part.endswith((".", " ")) for part in parts)
    if not plain or len(name.encode()) > LONGEST_NAME or any(_RESERVED.fullmatch(part) for part in parts):
        raise BundleError(f"holds a file named {name[:100]!r}: names of a bundle are plain and relative")


def in_order(names: Sequence[str]) -> list[str]:
    """The manifest first, then by name."""
    return sorted(names, key=lambda name: (name != MANIFEST, name.encode()))


def local_header(name: str, size: int, crc: int) -> bytes:
    """What stands before a file."""
    raw = name.encode()
    return _LOCAL.pack(_LOCAL_MARK, _VERSION, _flags(raw), 0, 0, _DATE, crc, size, size, len(raw), 0) + raw


def central_header(entry: Entry) -> bytes:
    """What the directory says of a file."""
    raw = entry.name.encode()
    before = entry.start - _LOCAL.size - len(raw)
    sizes = (entry.crc, entry.size, entry.size, len(raw), 0, 0, 0, 0, _RIGHTS, before)
    return _CENTRAL.pack(_CENTRAL_MARK, _VERSION, _UNIX, _VERSION, 0, _flags(raw), 0, 0, _DATE, *sizes) + raw


def ending(count: int, directory_bytes: int, directory_start: int) -> bytes:
    """What stands at the end."""
    return _END.pack(_END_MARK, 0, 0, count, count, directory_bytes, directory_start, 0)


def _flags(name: bytes) -> int:
    return 0 if name.isascii() else _UTF8


def archive_bytes(sizes: dict[str, int]) -> int:
    """How large the archive of files of these sizes is."""
    headers = sum(_LOCAL.size + _CENTRAL.size + 2 * len(name.encode()) for name in sizes)
    return headers + sum(sizes.values()) + _END.size


def read_directory(file: BinaryIO, size: int) -> list[Entry]:
    """The files of an archive of `size` bytes, whose headers are all as they must be. Raises BundleError."""
    if size > MOST_BYTES:
        raise BundleError(f"has {size / 1e9:.1f} GB; a bundle has at most {MOST_BYTES / 1e9:g} GB")
    count, start = _read_ending(file, size)
    file.seek(start)
    directory = file.read(size - _END.size - start)
    entries, at = list[Entry](), 0
    for _ in range(count):
        entry, header = _read_entry(directory, at)
        entries.append(entry)
        at += len(header)
    if at != len(directory):
        raise BundleError("holds bytes in its directory that belong to no file")
    _check_names([entry.name for entry in entries])
    _check_places(file, entries, start)
    return entries


def _read_ending(file: BinaryIO, size: int) -> tuple[int, int]:
    """(number of files, where the directory begins)."""
    whole = "is no bundle: it does not end as one does (no ZIP archive, cut off, or something follows it)"
    if size < _END.size:
        raise BundleError(whole)
    file.seek(size - _END.size)
    mark, disk, first_disk, here, count, length, start, comment = _END.unpack(file.read(_END.size))
    if mark != _END_MARK:
        raise BundleError(whole)
    if 0xFFFF in (here, count) or _WIDE in (length, start):
        raise BundleError(f"is a ZIP archive in the 64-bit form; a bundle has at most {MOST_ENTRIES} files")
    if count > MOST_ENTRIES:
        raise BundleError(f"has {count} files; a bundle has at most {MOST_ENTRIES}")
    if (disk, first_disk, here, comment) != (0, 0, count, 0) or start + length + _END.size != size:
        raise BundleError("has an end that does not fit the rest: bytes were added, removed or changed")
    if length > MOST_ENTRIES * (_CENTRAL.size + LONGEST_NAME):
        raise BundleError(f"has a directory of {length / 1e6:.0f} MB, more than its {count} files need")
    return count, start


def _read_entry(directory: bytes, at: int) -> tuple[Entry, bytes]:
    """One file, and its header in the directory."""
    fixed = directory[at : at + _CENTRAL.size]
    if len(fixed) < _CENTRAL.size or fixed[:4] != _CENTRAL_MARK:
        raise BundleError("has a directory that is cut off or changed")
    fields = _CENTRAL.unpack(fixed)
    flags, method, crc, packed, size, length, rights, before = (fields[i] for i in (5, 6, 9, 10, 11, 12, 17, 18))
    raw = directory[at + _CENTRAL.size : at + _CENTRAL.size + length]
    try:
        name = raw.decode()
    except UnicodeDecodeError:
        raise BundleError("holds a file whose name is not UTF-8") from None
    check_name(name)
    _check_kind(name, flags, method, rights, packed, size)
    entry = Entry(name, size, crc, before + _LOCAL.size + length)
    header = central_header(entry)
    if directory[at : at + len(header)] != header:
        raise BundleError(f"{name}: what the directory says of it was changed")
    return entry, header


def _check_kind(name: str, flags: int, method: int, rights: int, packed: int, size: int) -> None:
    """Raises BundleError, which says what a file is that no bundle holds."""
    kind = stat.S_IFMT(rights >> 16)
    reasons = {
        "is encrypted": flags & _ENCRYPTED,
        "is compressed; the files of a bundle are stored as they are": method or packed != size,
        "is a link": kind == stat.S_IFLNK,
        "is not a plain file": kind != stat.S_IFREG,
        "is larger than a bundle may be": size >= MOST_BYTES,
    }
    reason = next((text for text, is_so in reasons.items() if is_so), None)
    if reason is not None:
        raise BundleError(f"{name} {reason}")


def _check_names(names: list[str]) -> None:
    seen = set[str]()
    for name in names:
        if name.casefold() in seen:
            raise BundleError(f"holds {name} twice")
        seen.add(name.casefold())
    if names != in_order(names) or names[:1] != [MANIFEST]:
        raise BundleError(f"does not begin with {MANIFEST}, or its files are not in order")


def _check_places(file: BinaryIO, entries: list[Entry], end: int) -> None:
    """Files lie one after the other, each with the header that the directory gives it."""
    at = 0
    for entry in entries:
        header = local_header(entry.name, entry.size, entry.crc)
        if entry.start != at + len(header) or entry.start + entry.size > end:
            raise BundleError(f"{entry.name} does not lie where it must: bytes were added, removed or changed")
        file.seek(at)
        if file.read(len(header)) != header:
            raise BundleError(f"{entry.name}: its header was changed")
        at = entry.start + entry.size
    if at != end:
        raise BundleError("holds bytes between its last file and its directory")
