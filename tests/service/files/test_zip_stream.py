"""An archive that is made while it is sent is whole, as long as was said, and never in memory."""

from __future__ import annotations

import io
import tracemalloc
import zipfile
from typing import BinaryIO, cast

import pytest

from service.files.zip_stream import PIECE_BYTES, ZipEntry, zip_bytes, zip_stream


def entry(name: str, content: bytes) -> ZipEntry:
    return ZipEntry(name, len(content), io.BytesIO(content))


@pytest.mark.parametrize("sizes", [(), (0,), (1, PIECE_BYTES, PIECE_BYTES + 1, 3 * PIECE_BYTES)])
def test_an_archive_holds_its_files_and_is_as_long_as_was_said(sizes: tuple[int, ...]) -> None:
    files = {f"file {number}.txt": bytes([number + 1]) * size for number, size in enumerate(sizes)}
    entries = [entry(name, content) for name, content in files.items()]
    length = zip_bytes(entries)
    data = b"".join(zip_stream(entries, at=0.0))
    assert len(data) == length
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        assert archive.testzip() is None
        assert {name: archive.read(name) for name in archive.namelist()} == files
    assert all(one.content.closed for one in entries)


class _Endless(io.RawIOBase):
    """Gives as many bytes as are asked for, and remembers the most."""

    most = 0

    def read(self, size: int = -1) -> bytes:
        self.most = max(self.most, size)
        return bytes(size)


def test_memory_does_not_grow_with_the_file() -> None:
    content = _Endless()
    tracemalloc.start()
    try:
        whole = sum(map(len, zip_stream([ZipEntry("big", 60 * 2**20, cast("BinaryIO", content))], at=1e9)))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert whole > 60 * 2**20
    assert content.most == PIECE_BYTES
    assert peak < 12 * PIECE_BYTES


def test_a_file_beyond_two_gigabytes_has_no_length_in_advance() -> None:
    assert zip_bytes([ZipEntry("big", 2**31, io.BytesIO())]) is None


def test_a_file_that_is_shorter_than_it_was_ends_the_archive() -> None:
    with pytest.raises(OSError, match="a ends 2 bytes early"):
        list(zip_stream([ZipEntry("a", 5, io.BytesIO(b"abc"))], at=0.0))
