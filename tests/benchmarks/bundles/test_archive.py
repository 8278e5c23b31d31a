"""Archives have one form: any other ZIP, and any changed byte, is refused with the name of the file."""

from __future__ import annotations

import io
import stat
import struct
import zipfile
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.bundles.archive import open_archive, total_bytes, write_archive
from benchmarks.bundles.canonical import BundleError
from tests.budget import examples

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

CONTENTS: dict[str, bytes] = {"manifest.json": b"{}", "a b.txt": b"hello", "series/\u00fc, x.npz": bytes(70)}


def written(contents: dict[str, bytes]) -> bytes:
    file = io.BytesIO()
    write_archive(file, contents)
    return file.getvalue()


def read(data: bytes, folder: Path) -> dict[str, bytes]:
    path = folder / "read.zip"
    path.write_bytes(data)
    with open_archive(path) as archive:
        for name in archive.entries:
            archive.summed(name)
        return {name: archive.read(name, most=1000) for name in archive.entries}


def test_every_program_opens_it_and_the_same_files_give_the_same_bytes(tmp_path: Path) -> None:
    data = written(CONTENTS)
    assert len(data) == total_bytes(CONTENTS)
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        assert archive.testzip() is None
        assert {name: archive.read(name) for name in archive.namelist()} == CONTENTS
    assert written(dict(reversed(CONTENTS.items()))) == data
    assert read(data, tmp_path) == CONTENTS


def test_not_one_bit_is_free(tmp_path: Path) -> None:
    data = written(CONTENTS)
    for place in range(len(data)):
        with pytest.raises(BundleError):
            read(data[:place] + bytes([data[place] ^ 1 << place % 8]) + data[place + 1 :], tmp_path)


@settings(max_examples=examples(60), deadline=None)
@given(cut=st.integers(0, 400), more=st.binary(max_size=40), at=st.integers(0, 400))
def test_nothing_can_be_added_or_taken_away(tmp_path_factory: Any, cut: int, more: bytes, at: int) -> None:
    data = written(CONTENTS)
    changed = data[: min(at, len(data))] + more + data[min(at, len(data)) + cut :]
    if changed != data:
        with pytest.raises(BundleError):
            read(changed, tmp_path_factory.getbasetemp())


def foreign(fill: Callable[[zipfile.ZipFile], None], **options: Any) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", **options) as archive:
        fill(archive)
    return file.getvalue()


def named(*names: str) -> bytes:
    def fill(archive: zipfile.ZipFile) -> None:
        for name in names:
            entry = zipfile.ZipInfo(name)
            entry.external_attr = (stat.S_IFREG | 0o644) << 16
            archive.writestr(entry, b"x")

    return foreign(fill)


def link() -> bytes:
    def fill(archive: zipfile.ZipFile) -> None:
        entry = zipfile.ZipInfo("manifest.json")
        entry.external_attr = (stat.S_IFLNK | 0o777) << 16
        archive.writestr(entry, b"/etc/passwd")

    return foreign(fill)


def encrypted() -> bytes:
    data = bytearray(named("manifest.json"))
    data[data.index(b"PK\x01\x02") + 8] |= 1
    return bytes(data)


def bomb() -> bytes:
    return foreign(
        lambda archive: archive.writestr("manifest.json", bytes(50_000_000)), compression=zipfile.ZIP_DEFLATED
    )


def million() -> bytes:
    """A million files without content, as the 64-bit form counts them."""
    entry = (
        struct.pack("<4s4B4H3L5H2L", b"PK\x01\x02", 20, 3, 20, 0, 0, 0, 0, 0x21, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0) + b"a"
    )
    directory = entry * 1_000_000
    return directory + struct.pack("<4s4H2LH", b"PK\x05\x06", 0, 0, 0xFFFF, 0xFFFF, len(directory), 0, 0)


HOSTILE = {
    "no archive": (b"x" * 100, "does not end as one does"),
    "nothing": (b"", "does not end as one does"),
    "bomb": (bomb(), "manifest.json is compressed"),
    "link": (link(), "manifest.json is a link"),
    "encrypted": (encrypted(), "manifest.json is encrypted"),
    "absolute": (named("/etc/passwd"), "'/etc/passwd': names of a bundle are plain and relative"),
    "upwards": (named("manifest.json", "../../x"), r"'\.\./\.\./x': names of a bundle"),
    "drive": (named("C:\\x"), "names of a bundle are plain"),
    "device": (named("series/con.npz"), "names of a bundle are plain"),
    "folder": (named("series/"), "names of a bundle are plain"),
    "a million": (million(), "64-bit form; a bundle has at most 10000 files"),
    "too many": (named(*(f"{i}" for i in range(10_001))), "has 10001 files"),
    "unordered": (named("b", "a"), "not in order|directory says"),
}


@pytest.mark.parametrize("name", [b"a", b"A"])
def test_a_name_stands_once_whatever_its_case(name: bytes, tmp_path: Path) -> None:
    data = written({"manifest.json": b"", "_a": b"", "_b": b""})
    with pytest.raises(BundleError, match="twice"):
        read(data.replace(b"_b", b"_" + name), tmp_path)


@pytest.mark.parametrize(("data", "message"), HOSTILE.values(), ids=HOSTILE)
def test_what_else_zip_allows_is_refused_in_a_sentence(data: bytes, message: str, tmp_path: Path) -> None:
    with pytest.raises(BundleError, match=message):
        read(data, tmp_path)


@pytest.mark.parametrize("name", ["../x", "/x", "a//b", "a\\b", ".hidden", "x.", "nul", "a" * 300])
def test_no_bundle_is_written_with_such_a_name(name: str) -> None:
    with pytest.raises(BundleError, match="names of a bundle are plain and relative"):
        written({"manifest.json": b"", name: b""})
