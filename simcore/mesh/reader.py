"""Tetrahedral meshes from files: read, clean, check; every fault is one sentence on one field.

What counts of a file are its points, its linear tetrahedra and its names. Points that no tetrahedron uses are dropped,
tetrahedra of negative volume are turned round. What a name means is told in `named_sets`. Files are read in another
process (`reading_process`), which has a limit on time and memory and sees the content of this one file alone.
"""

from __future__ import annotations

import hashlib
import stat
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING

from simcore.errors import Problem, ScenarioError
from simcore.file_names import located
from simcore.mesh.reading import FORMATS, Body, MeshFaultError
from simcore.mesh.reading_process import read_apart
from simcore.mesh.tet_mesh import TetMesh

if TYPE_CHECKING:
    import os
    from collections.abc import Iterator

MAXIMUM_MB = 200


@dataclass(frozen=True)
class MeshFile:
    """The content of a file; two are the same when their digests are."""

    sha256: str
    suffix: str
    name: str = field(compare=False)
    data: bytes = field(compare=False, repr=False)

    @classmethod
    def read(cls, path: str) -> MeshFile:
        """Raises ScenarioError for a file of another kind, one that cannot be read and one that is too large."""
        file = located("tissue.mesh_file", path)
        suffix = file.suffix.lower()
        if suffix not in FORMATS:
            raise fault(path, f"must end in {', '.join(FORMATS)}")
        try:
            found = file.stat()
            wrong = _fault_of_entry(found)
            data = b"" if wrong else file.read_bytes()
        except (OSError, ValueError) as error:
            wrong = f"cannot be read: {getattr(error, 'strerror', None) or error}"
        if wrong:
            raise fault(path, wrong)
        return cls(hashlib.sha256(data).hexdigest(), suffix, file.name, data)


def _fault_of_entry(found: os.stat_result) -> str | None:
    """What forbids to open a directory's entry: a pipe would never end."""
    if not stat.S_ISREG(found.st_mode):
        return "is not a file"
    if found.st_size > MAXIMUM_MB * 1_000_000:
        return f"holds {found.st_size / 1e6:.0f} MB, at most {MAXIMUM_MB} are allowed"
    return None


def fault(path: str, message: str) -> ScenarioError:
    """The error that says what is wrong with a mesh file."""
    return ScenarioError([Problem("tissue.mesh_file", path, message)])


def digest_of(path: str) -> str:
    """SHA-256 of a mesh file's content. Raises ScenarioError."""
    return MeshFile.read(path).sha256


def load_mesh(path: str, *, unit_mm: float, names: tuple[str, ...], sha256: str | None) -> TetMesh:
    """The mesh in a file; its lengths are multiples of unit_mm millimetres.

    names: the sets that are wanted. sha256: the digest that the content must have; None = any. Raises ScenarioError.
    """
    content = MeshFile.read(path)
    if sha256 is not None and content.sha256 != sha256:
        raise fault(path, f"has changed: its SHA-256 is {content.sha256}, tissue.mesh_sha256 is {sha256}")
    with _faults_of(content, path):
        return _mesh_of(content, unit_mm, names)


def body_of(path: str) -> Body:
    """What a mesh file holds, in its own unit of length, with every set; neither size nor shape is looked at.

    Raises ScenarioError for a file that holds no linear tetrahedra.
    """
    content = MeshFile.read(path)
    with _faults_of(content, path):
        return _body_of(content, None, None)


def counts_of(path: str) -> tuple[int, int]:
    """Points of tetrahedra and tetrahedra in a mesh file, whatever its unit of length. Raises ScenarioError for a file
    that holds no linear tetrahedra."""
    content = MeshFile.read(path)
    with _faults_of(content, path):
        body = _body_of(content, None, ())
    return len(body.points), len(body.tets)


@contextmanager
def _faults_of(content: MeshFile, path: str) -> Iterator[None]:
    """Turns what is wrong with a file into a problem of the field that named it, or of the set that is not there."""
    try:
        yield
    except MeshFaultError as wrong:
        if wrong.set_name is None:
            raise fault(path, wrong.message) from None
        message = wrong.message.replace("FILE", content.name)
        raise ScenarioError([Problem("tissue.fixed_sets", wrong.set_name, message)]) from None


@lru_cache(maxsize=2)
def _body_of(content: MeshFile, unit_mm: float | None, names: tuple[str, ...] | None) -> Body:
    return read_apart(content.data, content.suffix, names, unit_mm)


@lru_cache(maxsize=2)
def _mesh_of(content: MeshFile, unit_mm: float, names: tuple[str, ...]) -> TetMesh:
    """A scenario's validation and its run ask for the same mesh: it is read once."""
    body = _body_of(content, unit_mm, names)
    return TetMesh.of(body.points * (unit_mm * 1e-3), body.tets, body.sets)
