"""Tetrahedral meshes from files, through meshio: read, clean, check; every fault is one sentence on one field.

What counts of a file are its points, its linear tetrahedra and its names. Points that no tetrahedron uses are dropped,
tetrahedra of negative volume are turned round. A name means, in this order: a node set, a cell set or physical group
(the nodes of its cells), `array=number` (the nodes, or the nodes of the cells, where an array of integers has that
number), an array (where it is not zero).
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import os
import stat
import tempfile
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from simcore.arrays import Floats, Ints
from simcore.errors import Problem, ScenarioError
from simcore.file_names import located
from simcore.mesh.quality import fault_of_mesh
from simcore.mesh.tet_mesh import TetMesh

FORMATS = {
    ".msh": ("gmsh", "ansys"),
    ".vtu": ("vtu",),
    ".vtk": ("vtk",),
    ".mesh": ("medit",),
    ".inp": ("abaqus",),
}
MAXIMUM_MB = 200
MAXIMUM_TETS = 1_200_000
NAMES_SHOWN = 12
SOLIDS = ("tetra", "hexahedron", "wedge", "pyramid")  # the beginnings of meshio's names of cells with a volume


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
    try:
        return _mesh_of(content, unit_mm, names)
    except _MeshFaultError as wrong:
        raise fault(path, str(wrong)) from None


def counts_of(path: str) -> tuple[int, int]:
    """Points and tetrahedra in a mesh file, whatever its unit of length. Raises ScenarioError for a file that holds
    no linear tetrahedra."""
    content = MeshFile.read(path)
    try:
        points, tets = _tetrahedra(_parsed(content))
    except _MeshFaultError as wrong:
        raise fault(path, str(wrong)) from None
    return len(points), len(tets)


class _MeshFaultError(Exception):
    """What is wrong with the content of a mesh file."""


@lru_cache(maxsize=2)
def _mesh_of(content: MeshFile, unit_mm: float, names: tuple[str, ...]) -> TetMesh:
    """A scenario's validation and its run ask for the same mesh: it is read once."""
    raw = _parsed(content)
    points, tets = _tetrahedra(raw)
    used, numbered = np.unique(tets, return_inverse=True)
    nodes, tets = np.ascontiguousarray(points[used] * (unit_mm * 1e-3)), numbered.reshape(tets.shape)
    wrong = fault_of_mesh(nodes, tets)
    if wrong is not None:
        raise _MeshFaultError(wrong)
    return TetMesh.of(nodes, tets, {name: _set(raw, name, used, content.name) for name in names})


def _parsed(content: MeshFile) -> Any:
    """The mesh as meshio has it. Its readers print, warn, exit and raise anything; here that is one fault."""
    formats, reasons = FORMATS[content.suffix], []
    with tempfile.TemporaryDirectory(prefix="needlebench-mesh-") as folder:
        copy = Path(folder) / f"mesh{content.suffix}"  # what is read is what was hashed
        copy.write_bytes(content.data)
        for kind in formats:
            try:
                return _read_quietly(copy, kind)
            except (Exception, SystemExit) as error:
                lines = str(error).replace(str(copy), content.name).strip().splitlines()
                reasons += [] if isinstance(error, SystemExit) else lines[:1]
    reason = f": {reasons[0][:100]}" if reasons else ""
    raise _MeshFaultError(f"is not a readable {' or '.join(formats)} mesh{reason}")


def _read_quietly(path: Path, kind: str) -> Any:
    import meshio

    nowhere = io.StringIO()
    with contextlib.redirect_stdout(nowhere), contextlib.redirect_stderr(nowhere), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return meshio.read(path, file_format=kind)


def _tetrahedra(raw: Any) -> tuple[Floats, Ints]:
    """Points (n, 3) in the file's unit and linear tetrahedra (t, 4) into them."""
    points = np.asarray(raw.points)
    solids = [block for block in raw.cells if block.type.startswith(SOLIDS)]
    others = sorted({block.type for block in solids} - {"tetra"})
    tets = [np.asarray(block.data) for block in solids if block.type == "tetra" and len(block.data)]
    if others:
        raise _MeshFaultError(f"must hold linear tetrahedra and no other solid cells; it holds {', '.join(others)}")
    if not tets:
        held = ", ".join(sorted({block.type for block in raw.cells})) or "no cells"
        raise _MeshFaultError(f"must hold tetrahedra; it holds {held}")
    cells = np.concatenate(tets).astype(np.int64)
    if len(cells) > MAXIMUM_TETS:
        raise _MeshFaultError(f"holds {len(cells)} tetrahedra, at most {MAXIMUM_TETS} are allowed")
    if points.ndim != 2 or points.shape[1] != 3 or points.dtype.kind not in "fiu":
        raise _MeshFaultError(
            f"must hold points with three coordinates; its points are an array of shape {points.shape}"
        )
    if cells.min() < 0 or cells.max() >= len(points):
        wrong = cells.max() if cells.max() >= len(points) else cells.min()
        raise _MeshFaultError(f"has a tetrahedron with node {wrong}; its points are 0 to {len(points) - 1}")
    return points.astype(np.float64), cells


def _set(raw: Any, name: str, used: Ints, file: str) -> Ints:
    """The nodes of a named set, numbered as in the mesh. Raises ScenarioError for a name that the file has not."""
    found = next((nodes for nodes in (look(raw, name) for look in LOOKUPS) if nodes is not None), None)
    if found is None:
        known = _known(raw)
        more = f" and {len(known) - NAMES_SHOWN} more" if len(known) > NAMES_SHOWN else ""
        has = ", ".join(known[:NAMES_SHOWN]) + more if known else "no names"
        raise ScenarioError([Problem("tissue.fixed_sets", name, f"is not in {file}, which has {has}")])
    inside: Ints = np.flatnonzero(np.isin(used, found))
    if not len(inside):
        raise ScenarioError(
            [Problem("tissue.fixed_sets", name, f"is empty: it holds no node of a tetrahedron of {file}")]
        )
    return inside


def _known(raw: Any) -> list[str]:
    """The names that a file offers."""
    cell_sets = [name for name in raw.cell_sets if not name.startswith("gmsh:")]
    arrays = {**raw.point_data, **{key: data[0] for key, data in raw.cell_data.items() if data}}
    numbered = [
        f"{key}=NUMBER" for key, data in arrays.items() if np.ndim(data) == 1 and np.asarray(data).dtype.kind in "iu"
    ]
    return [*raw.point_sets, *sorted({*cell_sets, *raw.field_data}), *numbered]


def _nodes_of_cells(raw: Any, chosen: Callable[[int, Any], Any]) -> Ints | None:
    """Nodes of the cells that `chosen` (block number, block) -> mask or indices picks; None for no cell at all."""
    picked = [np.asarray(block.data)[chosen(i, block)].ravel() for i, block in enumerate(raw.cells)]
    nodes = np.concatenate(picked) if picked else np.zeros(0, np.int64)
    return np.unique(nodes) if len(nodes) else None


def _node_set(raw: Any, name: str) -> Ints | None:
    return np.asarray(raw.point_sets[name]) if name in raw.point_sets else None


def _cell_set(raw: Any, name: str) -> Ints | None:
    if name not in raw.cell_sets:
        return None
    members = [np.zeros(0, np.int64) if m is None else np.asarray(m, np.int64) for m in raw.cell_sets[name]]
    return _nodes_of_cells(raw, lambda i, _: members[i])


def _physical_group(raw: Any, name: str) -> Ints | None:
    if name not in raw.field_data or "gmsh:physical" not in raw.cell_data:
        return None
    tag, dimension = (int(number) for number in raw.field_data[name])
    tags = raw.cell_data["gmsh:physical"]
    return _nodes_of_cells(raw, lambda i, block: (np.asarray(tags[i]) == tag) & (block.dim == dimension))


def _numbered(raw: Any, name: str) -> Ints | None:
    key, equals, number = name.rpartition("=")
    if not equals or not number.lstrip("-").isdecimal():
        return None
    return _where(raw, key, lambda values: values == int(number))


def _marked(raw: Any, name: str) -> Ints | None:
    return _where(raw, name, lambda values: values != 0)


def _where(raw: Any, key: str, test: Callable[[Any], Any]) -> Ints | None:
    if key in raw.point_data and np.ndim(raw.point_data[key]) == 1:
        return np.flatnonzero(test(np.asarray(raw.point_data[key])))
    if key in raw.cell_data and all(np.ndim(values) == 1 for values in raw.cell_data[key]):
        return _nodes_of_cells(raw, lambda i, _: test(np.asarray(raw.cell_data[key][i])))
    return None


LOOKUPS = (_node_set, _cell_set, _physical_group, _numbered, _marked)
