"""The series in a bundle: NumPy archives, read only where what they unpack to is bounded."""

from __future__ import annotations

import io
import zipfile
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from benchmarks.bundles.canonical import BundleError
from simcore.errors import ARCHIVE_ERRORS
from simcore.rollout.digest import digest
from simcore.rollout.result import TIMES

if TYPE_CHECKING:
    from benchmarks.bundles.archive import Archive

MOST_PACKED, MOST_UNPACKED = 1_000_000_000, 4_000_000_000  # bytes of one series
_MOST_ARRAYS = 200
Arrays = dict[str, NDArray[Any]]


def without_clocks(series: Arrays) -> Arrays:
    """The series without readings of a clock, which are of no two runs the same."""
    return {name: array for name, array in series.items() if name not in TIMES}


def read_series(archive: Archive, name: str) -> Arrays:
    """The arrays of a series in a bundle. Raises BundleError for one that is damaged, or that unpacks to too much."""
    file = io.BytesIO(archive.read(name, most=MOST_PACKED))
    try:
        _check_sizes(file, name)
        file.seek(0)
        with np.load(file, allow_pickle=False) as arrays:
            return {one: arrays[one] for one in arrays.files}
    except BundleError:
        raise
    except (*ARCHIVE_ERRORS, MemoryError, NotImplementedError, RuntimeError) as error:
        raise BundleError(f"{name} is no readable series: {str(error)[:200]}") from None


def _check_sizes(file: BinaryIO, name: str) -> None:
    """Before anything is unpacked: what the archive within says, and that each array says the same."""
    with zipfile.ZipFile(file) as inner:
        members = inner.infolist()
        if len(members) > _MOST_ARRAYS or sum(one.file_size for one in members) > MOST_UNPACKED:
            raise BundleError(f"{name} would unpack to more than {_MOST_ARRAYS} arrays or {MOST_UNPACKED / 1e9:g} GB")
        for member in members:
            with inner.open(member) as opened:
                version = np.lib.format.read_magic(opened)
                read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
                shape, _, dtype = read(opened)
            count = 1
            for length in shape:
                count *= length
            if dtype.hasobject or count * dtype.itemsize > member.file_size:
                raise BundleError(f"{name}: {member.filename} says that it is larger than it is, or is no plain array")


def digest_of_series(archive: Archive, name: str) -> str:
    """The digest of the states in a series. Raises BundleError for a series without one of them."""
    arrays = read_series(archive, name)
    try:
        return digest(arrays)
    except (KeyError, IndexError) as error:
        raise BundleError(f"{name} lacks the array {error}") from None
