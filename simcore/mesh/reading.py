"""From the bytes of a mesh file to one sound body, or to one sentence on what is wrong with it."""

from __future__ import annotations

import codecs
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from simcore.mesh.formats.abaqus import read_abaqus
from simcore.mesh.formats.gmsh import read_gmsh
from simcore.mesh.formats.medit import read_medit
from simcore.mesh.formats.raw import FormatError, RawMesh
from simcore.mesh.formats.vtk import read_vtk
from simcore.mesh.formats.vtu import read_vtu
from simcore.mesh.named_sets import NamedSetError, known_names, nodes_named
from simcore.mesh.quality import fault_of_mesh

if TYPE_CHECKING:
    from collections.abc import Callable

    from simcore.arrays import Floats, Ints

FORMATS: dict[str, tuple[str, Callable[[bytes], RawMesh]]] = {
    ".msh": ("Gmsh", read_gmsh),
    ".vtu": ("VTU", read_vtu),
    ".vtk": ("VTK", read_vtk),
    ".mesh": ("Medit", read_medit),
    ".inp": ("Abaqus", read_abaqus),
}
MAXIMUM_TETS = 1_200_000
MOST_NAMES = 4000  # of sets: nodes, elements and groups, each with a number and a name
NAMES_SHOWN = 12


class MeshFaultError(Exception):
    """What is wrong with a mesh file, in one sentence that goes on after its name. set_name: with which set of it."""

    def __init__(self, message: str, set_name: str | None = None) -> None:
        self.message, self.set_name = printable(message), set_name
        super().__init__(self.message)


def printable(text: str) -> str:
    """The text in one line, with what a terminal or a page would act upon (line ends, marks of direction, escapes)
    written out."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


@dataclass(frozen=True)
class Body:
    """The tetrahedra of a file and the points that they use.

    points: (n, 3) in the file's unit. tets: (t, 4) in any orientation. sets: rows of the points of each named set that
    was asked for. names: all that the file offers. refused: names that cannot be had, with the reason. remarks: what
    was left out.
    """

    points: Floats
    tets: Ints
    sets: dict[str, Ints]
    names: tuple[str, ...]
    remarks: tuple[str, ...]
    refused: dict[str, str]


def read_body(data: bytes, suffix: str, wanted: tuple[str, ...] | None, unit_mm: float | None) -> Body:
    """The body in a file's content. wanted: the sets to find; None for every one that can be had without a number.
    unit_mm: None to leave its size and shape unchecked.

    Raises MeshFaultError.
    """
    with np.errstate(all="ignore"):  # what overflows or is no number is refused where it counts
        return _sound_body(data, suffix, wanted, unit_mm)


def _sound_body(data: bytes, suffix: str, wanted: tuple[str, ...] | None, unit_mm: float | None) -> Body:
    kind, read = FORMATS[suffix]
    try:
        raw = read(data.removeprefix(codecs.BOM_UTF8))  # which some editors write before the text
    except FormatError as error:
        raise MeshFaultError(f"is not a mesh that can be read ({kind}): {error}") from None
    tets = _tetrahedra(raw)
    used, numbered = np.unique(tets, return_inverse=True)
    points, tets = np.ascontiguousarray(raw.points[used]), numbered.reshape(tets.shape)
    if unit_mm is not None and (wrong := fault_of_mesh(points * (unit_mm * 1e-3), tets)) is not None:
        raise MeshFaultError(wrong)
    unused = len(raw.points) - len(used)
    remarks = [*raw.remarks, *([f"{unused} points of no tetrahedron are left out"] if unused else [])]
    names = tuple(known_names(raw))
    if len(names) > MOST_NAMES:
        raise MeshFaultError(f"has {len(names)} names of sets, at most {MOST_NAMES} are allowed")
    if wanted is not None:
        return Body(points, tets, {name: _set(raw, name, used) for name in wanted}, names, tuple(remarks), {})
    sets, refused = {}, {}
    for name in names:
        if name.endswith("=NUMBER"):
            continue
        try:
            sets[name] = _set(raw, name, used)
        except MeshFaultError as fault:
            refused[name] = fault.message
    return Body(points, tets, sets, names, tuple(remarks), refused)


def _tetrahedra(raw: RawMesh) -> Ints:
    solids = [block for block in raw.blocks if block.dimension == 3 and len(block.nodes)]
    others = sorted({block.kind for block in solids} - {"tetra"})
    if others:
        raise MeshFaultError(f"must hold linear tetrahedra and no other solid cells; it holds {', '.join(others)}")
    if not solids:
        held = ", ".join(sorted({block.kind for block in raw.blocks if len(block.nodes)})) or "no cells"
        raise MeshFaultError(f"must hold tetrahedra; it holds {held}")
    tets: Ints = np.concatenate([block.nodes for block in solids]).astype(np.int64)
    if len(tets) > MAXIMUM_TETS:
        raise MeshFaultError(f"holds {len(tets)} tetrahedra, at most {MAXIMUM_TETS} are allowed")
    return tets


def _set(raw: RawMesh, name: str, used: Ints) -> Ints:
    """The rows of the used points that a name means. Raises MeshFaultError."""
    try:
        nodes = nodes_named(raw, name)
    except NamedSetError as error:
        raise MeshFaultError(f"{error}", name) from None
    if nodes is None:
        raise MeshFaultError(f"is not in FILE, which has {_listed(known_names(raw))}", name)
    inside: Ints = np.flatnonzero(np.isin(used, nodes))
    if not len(inside):
        raise MeshFaultError("is empty: it holds no node of a tetrahedron of FILE", name)
    return inside


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - NAMES_SHOWN} more" if len(names) > NAMES_SHOWN else ""
    return ", ".join(name[:100] for name in names[:NAMES_SHOWN]) + more if names else "no names"
