"""The base poses of a replay, from a file: an array of numbers, one row a step, checked on reading and kept in memory.

A long log as a file costs 56 bytes a pose; as JSON it would be ten times that, and as much again to check.
"""

from __future__ import annotations

import hashlib
import io
import stat
from collections import OrderedDict
from threading import Lock
from typing import TYPE_CHECKING

import numpy as np

from simcore.errors import Problem, ScenarioError
from simcore.file_names import located
from simcore.scenario.blocks import MAXIMUM_STEPS
from simcore.scenario.number_table import comma_separated

if TYPE_CHECKING:
    from simcore.arrays import Floats

FIELD = "controller.poses_file"
SUFFIXES = (".npy", ".csv")
COLUMNS = 7  # x_mm, y_mm, z_mm, qw, qx, qy, qz
MAXIMUM_MB = 200
QUATERNION_WITHIN = 1e-3  # of the norm 1
WITHIN_MM = 10_000.0
_KEPT = 2  # files
_lock = Lock()
_known: OrderedDict[str, Floats] = OrderedDict()  # by SHA-256, least recently used first


def digest_of_poses(name: str, wanted: str | None) -> str:
    """SHA-256 of the file that `name` stands for, whose poses are then known. wanted: the digest that it must have;
    None = any. Raises ScenarioError for a file that cannot be used."""
    if wanted is not None and _recall(wanted) is not None:
        located(FIELD, name)
        return wanted
    data, suffix = _content(name)
    found = hashlib.sha256(data).hexdigest()
    if wanted is not None and found != wanted:
        message = f"must be the digest of {name}, which is {found}: the file was changed, or it is another one"
        raise ScenarioError([Problem("controller.poses_sha256", wanted, message)])
    if _recall(found) is None:
        poses = _parsed(name, data, suffix)
        wrong = fault_of_poses(poses)
        if wrong is not None:
            raise _fault(name, f"row {wrong[0] + 1} {wrong[1]}")
        _keep(found, poses)
    return found


def load_poses(name: str, sha256: str) -> Floats:
    """(n, 7) x_mm, y_mm, z_mm, qw, qx, qy, qz of the base. Raises ScenarioError."""
    found = _recall(sha256)
    if found is None:
        digest_of_poses(name, sha256)
        found = _recall(sha256)
    assert found is not None
    return found


def fault_of_poses(poses: Floats) -> tuple[int, str] | None:
    """Number of the first wrong pose of (n, 7), from 0, and what is wrong with it; None when all are sound."""
    with np.errstate(over="ignore"):
        norms = np.sqrt((poses[:, 3:] ** 2).sum(axis=1))
    reach = np.abs(poses[:, :3]).max(axis=1)
    # written so that a NaN is wrong too
    sound = (np.abs(norms - 1.0) <= QUATERNION_WITHIN) & (reach <= WITHIN_MM)
    if sound.all():
        return None
    row = int(np.argmin(sound))
    if not abs(norms[row] - 1.0) <= QUATERNION_WITHIN:
        return row, f"must hold a unit quaternion qw, qx, qy, qz; its norm is {norms[row]:.6g}"
    return row, f"must lie within +-{WITHIN_MM:.0f} mm"


def _recall(sha256: str) -> Floats | None:
    with _lock:
        if sha256 in _known:
            _known.move_to_end(sha256)
        return _known.get(sha256)


def _keep(sha256: str, poses: Floats) -> None:
    poses.setflags(write=False)
    with _lock:
        _known[sha256] = poses
        while len(_known) > _KEPT:
            _known.popitem(last=False)


def _fault(name: str, message: str) -> ScenarioError:
    return ScenarioError([Problem(FIELD, name, message)])


def _content(name: str) -> tuple[bytes, str]:
    path = located(FIELD, name)
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise _fault(name, f"must end in {' or '.join(SUFFIXES)}")
    try:
        found = path.stat()
        if not stat.S_ISREG(found.st_mode):
            raise _fault(name, "is not a file")
        if found.st_size > MAXIMUM_MB * 1_000_000:
            raise _fault(name, f"holds {found.st_size / 1e6:.0f} MB, at most {MAXIMUM_MB} are allowed")
        return path.read_bytes(), suffix
    except (OSError, ValueError) as error:
        raise _fault(name, f"cannot be read: {getattr(error, 'strerror', None) or error}") from None


def _parsed(name: str, data: bytes, suffix: str) -> Floats:
    try:
        table = _numpy_array(data) if suffix == ".npy" else comma_separated(data)
    except (ValueError, TypeError, SyntaxError, EOFError, MemoryError) as error:
        raise _fault(name, f"is no table of numbers: {str(error)[:200]}") from None
    if table.ndim != 2 or table.shape[1] != COLUMNS or not 1 <= len(table) <= MAXIMUM_STEPS:
        shape = " x ".join(map(str, table.shape))
        raise _fault(name, f"must be 1 to {MAXIMUM_STEPS} rows of {COLUMNS} numbers, and is {shape or 'one number'}")
    return table


def _numpy_array(data: bytes) -> Floats:
    """Of real numbers; nothing pickled is ever loaded."""
    table = np.load(io.BytesIO(data), allow_pickle=False)
    if not isinstance(table, np.ndarray) or table.dtype.kind not in "fiu":
        raise ValueError("its numbers must be real")
    return np.array(table, dtype=float, order="C")
