"""Makes the mesh that `needlebench example mesh` prints: a barrel with a domed top, of our own making.

    python docs/example_mesh.py service/cli/examples/mesh.msh

Lengths in mm. The needle enters at the top of the dome, the origin, and goes down along +z; the flat base is at z = 60.
Physical groups: `tissue`, the volume; `top`, `side` and `base`, its surface.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from collections.abc import Sequence

Vector = NDArray[np.float64]
Indices = NDArray[np.int64]

RINGS, LAYERS = 4, 7
SEMI_AXES_MM = (32.0, 26.0)  # of the ellipse at half height
HEIGHT_MM, DOME_MM = 60.0, 8.0
NARROWING = 0.2  # of the radius at the top and at the base
GROUPS = {"top": (1, 2), "side": (2, 2), "base": (3, 2), "tissue": (4, 3)}  # name -> tag, dimension


def disc() -> tuple[Vector, Indices]:
    """Points (n, 2) of the unit disc on concentric rings of 6, 12, 18 ... points, and triangles (t, 3) between them."""
    points, first = [(0.0, 0.0)], [0]
    for ring in range(1, RINGS + 1):
        first.append(len(points))
        turns = np.arange(6 * ring) / (6 * ring)
        points += [(ring / RINGS * np.cos(2 * np.pi * turn), ring / RINGS * np.sin(2 * np.pi * turn)) for turn in turns]

    def node(ring: int, number: int) -> int:
        return first[ring] + number % (6 * ring) if ring else 0

    triangles = []
    for ring in range(1, RINGS + 1):
        for sextant in range(6):
            outer, inner = sextant * ring, sextant * (ring - 1)
            for m in range(ring):
                triangles.append((node(ring, outer + m), node(ring, outer + m + 1), node(ring - 1, inner + m)))
                if m:
                    triangles.append((node(ring - 1, inner + m - 1), node(ring, outer + m), node(ring - 1, inner + m)))
    return np.array(points), np.array(triangles)


def barrel() -> tuple[Vector, Indices, dict[str, Indices]]:
    """Nodes (n, 3) mm, tetrahedra (t, 4), and the triangles (k, 3) of each surface group.

    Every prism between two layers becomes three tetrahedra whose diagonals start at the lowest node number of each
    side, so that neighbours agree (Dompierre et al. 1999).
    """
    flat, triangles = disc()
    count = len(flat)
    nodes = []
    for layer in range(LAYERS + 1):
        share = layer / LAYERS
        radius = 1.0 - NARROWING * (2.0 * share - 1.0) ** 2
        depth = HEIGHT_MM * share + DOME_MM * (1.0 - share) * (flat**2).sum(axis=1)
        nodes.append(np.column_stack([radius * flat * SEMI_AXES_MM, depth]))
    low = np.sort(triangles, axis=1)
    layers = [low + layer * count for layer in range(LAYERS)]
    tets = np.concatenate([_split(below, below + count) for below in layers])
    rim = np.arange(count - 6 * RINGS, count)
    edges = np.sort(np.column_stack([rim, np.roll(rim, -1)]), axis=1)
    sides = np.concatenate([_quads(edges + layer * count, edges + (layer + 1) * count) for layer in range(LAYERS)])
    points = np.concatenate(nodes)
    return points, _oriented(points, tets), {"top": low, "side": sides, "base": low + LAYERS * count}


def _split(below: Indices, above: Indices) -> Indices:
    (a, b, c), (d, e, f) = below.T, above.T
    return np.column_stack([a, b, c, f, a, b, f, e, a, e, f, d]).reshape(-1, 4)


def _oriented(points: Vector, tets: Indices) -> Indices:
    """The same tetrahedra, all of positive volume."""
    corners = points[tets]
    inside_out = np.linalg.det(corners[:, 1:] - corners[:, :1]) < 0.0
    tets[inside_out] = tets[inside_out][:, [0, 1, 3, 2]]
    return tets


def _quads(below: Indices, above: Indices) -> Indices:
    (a, b), (d, e) = below.T, above.T
    return np.column_stack([a, b, e, a, e, d]).reshape(-1, 3)


def gmsh_text() -> str:
    """The mesh in Gmsh's format 2.2, ASCII, to the micrometre."""
    nodes, tets, surfaces = barrel()
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$PhysicalNames", str(len(GROUPS))]
    lines += [f'{dimension} {tag} "{name}"' for name, (tag, dimension) in GROUPS.items()]
    lines += ["$EndPhysicalNames", "$Nodes", str(len(nodes))]
    lines += [f"{i} {x:.3f} {y:.3f} {z:.3f}" for i, (x, y, z) in enumerate(np.round(nodes, 3) + 0.0, 1)]
    cells = [(2, name, triangles) for name, triangles in surfaces.items()] + [(4, "tissue", tets)]
    lines += ["$EndNodes", "$Elements", str(sum(len(block) for *_, block in cells))]
    number = 0
    for kind, name, block in cells:
        for cell in block + 1:
            number += 1
            lines.append(" ".join(map(str, [number, kind, 2, GROUPS[name][0], GROUPS[name][0], *cell])))
    return "\n".join([*lines, "$EndElements", ""])


def main(arguments: Sequence[str]) -> None:
    """Write the mesh to the file that is named."""
    Path(arguments[0]).write_text(gmsh_text(), encoding="ascii", newline="\n")


if __name__ == "__main__":
    main(sys.argv[1:])
