"""Inspects an uploaded file, in a process of its own with little memory and time.

A hostile file can be made to expand without end or to crash the library that reads it: the service must survive that
and refuse it.
"""

from __future__ import annotations

import json
import struct
import subprocess
import sys
import tokenize
import zipfile
import zlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

from service.files.model_content import dataset_content, model_content

if TYPE_CHECKING:
    from collections.abc import Callable

MEMORY_MB = 2000
TIME_S = 60
MAXIMUM_MEMBERS = 1000
MAXIMUM_ARRAYS_MB = 256
MAXIMUM_DEPTH = 50


class UnusableUploadError(ValueError):
    """The content does not match its suffix; says why."""


def inspect(path: Path, kind: str) -> dict[str, Any]:
    """The content: counts of a mesh, rows of a data set, rows of poses, settings and origin of a model.

    Raises UnusableUploadError.
    """
    command = [sys.executable, "-m", "service.admission.upload_check", kind, str(path)]
    try:
        done = subprocess.run(
            command, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=2 * TIME_S, check=False
        )
    except subprocess.TimeoutExpired:
        raise UnusableUploadError(f"it took longer than {2 * TIME_S} s to read") from None
    try:
        report = json.loads(done.stdout)
    except ValueError:
        raise UnusableUploadError(f"it takes more than {TIME_S} s or {MEMORY_MB} MB to read") from None
    if "problem" in report:
        raise UnusableUploadError(str(report["problem"]))
    return dict(report)


def read_content(path: Path, kind: str) -> dict[str, Any]:
    """The content, read in this process. Raises UnusableUploadError."""
    if kind == "mesh":
        return _mesh(path)
    if kind == "poses":
        return _poses(path)
    if kind == "dataset":
        check_arrays(path)
        return _learned(dataset_content, path)
    check_object(path)
    return _learned(model_content, path)


def _mesh(path: Path) -> dict[str, Any]:
    from simcore.errors import ScenarioError
    from simcore.mesh.reader import counts_of

    try:
        nodes, tets = counts_of(str(path))
    except ScenarioError as error:
        raise UnusableUploadError(error.problems[0].message.replace(path.name, "the file")) from None
    return {"nodes": nodes, "tetrahedra": tets}


def _poses(path: Path) -> dict[str, Any]:
    from simcore.errors import ScenarioError
    from simcore.scenario.pose_file import digest_of_poses, load_poses

    try:
        return {"poses": len(load_poses(str(path), digest_of_poses(str(path), None)))}
    except ScenarioError as error:
        raise UnusableUploadError(error.problems[0].message) from None


def _learned(content: Callable[[Path], dict[str, Any]], path: Path) -> dict[str, Any]:
    from simcore.errors import NeedlebenchError

    try:
        return content(path)
    except NeedlebenchError as error:
        raise UnusableUploadError(str(error).replace(str(path), "it")) from None


def check_arrays(path: Path) -> None:
    """An .npz whose headers and sizes agree; no array is read, and none of objects, which are pickles, passes.

    Raises UnusableUploadError.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            if len(members) > MAXIMUM_MEMBERS:
                raise UnusableUploadError(f"it holds {len(members)} arrays, at most {MAXIMUM_MEMBERS} are allowed")
            total = sum(member.file_size for member in members)
            if total > MAXIMUM_ARRAYS_MB * 1e6:
                size = f"{total / 1e6:.0f} MB"
                raise UnusableUploadError(f"it unpacks to {size}, at most {MAXIMUM_ARRAYS_MB} are allowed")
            for member in members:
                _check_shape(archive, member)
    except (zipfile.BadZipFile, NotImplementedError, RuntimeError, EOFError, OSError, struct.error) as error:
        raise UnusableUploadError(f"it is not an .npz archive: {error}") from None


def _check_shape(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> None:
    """The header of an array must agree with the size of its data."""
    from numpy.lib import format as npy

    name = member.filename[:100]
    if not name.endswith(".npy") or "/" in name or "\\" in name:
        raise UnusableUploadError(f"it holds {name!r}, which is no array")
    try:
        with archive.open(member) as file:
            version = npy.read_magic(file)
            read = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}[version]
            shape, _, dtype = read(file)
            start = file.tell()
    except (ValueError, KeyError, SyntaxError, tokenize.TokenError, zlib.error) as error:
        raise UnusableUploadError(f"its {name} is not an array: {str(error)[:100]}") from None
    if dtype.hasobject:
        raise UnusableUploadError(f"its {name} holds Python objects (a pickle), which are never loaded")
    count = 1
    for length in shape:
        count *= length
    if min(shape, default=0) < 0 or count * dtype.itemsize != member.file_size - start:
        raise UnusableUploadError(f"the shape of its {name} does not agree with its {member.file_size} bytes")


def check_object(path: Path) -> None:
    """A plain, finite JSON object. Raises UnusableUploadError."""
    try:
        value = json.loads(path.read_bytes(), parse_constant=_no_constant)
    except (ValueError, RecursionError) as error:
        raise UnusableUploadError(f"it is not JSON: {str(error)[:100]}") from None
    if not isinstance(value, dict):
        raise UnusableUploadError("it must hold a JSON object")
    if _depth(value) > MAXIMUM_DEPTH:
        raise UnusableUploadError(f"it is nested more than {MAXIMUM_DEPTH} deep")


def _no_constant(text: str) -> Any:
    raise ValueError(f"{text} is not a JSON number")


def _depth(value: Any) -> int:
    level, depth = [value], 0
    while level:
        depth += 1
        inner = [item.values() if isinstance(item, dict) else item for item in level if isinstance(item, dict | list)]
        level = [item for items in inner for item in items if isinstance(item, dict | list)]
    return depth


def _limit_resources() -> None:
    """Limit memory, time and file size of this process, for good."""
    if sys.platform != "win32":
        import resource

        for kind, most in (
            (resource.RLIMIT_AS, MEMORY_MB * 10**6),
            (resource.RLIMIT_CPU, TIME_S),
            (resource.RLIMIT_FSIZE, 10**9),
            (resource.RLIMIT_CORE, 0),
        ):
            resource.setrlimit(kind, (most, most))


def main() -> None:
    """Print the content of the file as JSON, or {"problem": why it cannot be used}."""
    from service.blas_threads import one_thread

    one_thread()
    _limit_resources()
    try:
        report = read_content(Path(sys.argv[2]), sys.argv[1])
    except UnusableUploadError as problem:
        report = {"problem": str(problem)}
    except MemoryError:
        report = {"problem": f"it takes more than {MEMORY_MB} MB to read"}
    sys.stdout.write(json.dumps(report))


if __name__ == "__main__":
    main()
