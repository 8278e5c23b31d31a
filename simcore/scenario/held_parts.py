"""What of the tissue is held still: faces, sets of the mesh file, regions; and the rules of it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from simcore.errors import Problem
from simcore.linear_algebra.products import norm
from simcore.mesh.numbering import held_nodes
from simcore.scenario.blocks import MAXIMUM_CELLS, SIDES, FixedBox, FixedPlane, Tissue

if TYPE_CHECKING:
    from collections.abc import Sequence

    from simcore.arrays import Floats, Ints
    from simcore.mesh.mesh import Mesh

LINE_M = 1e-6  # points so near to a line are on it


def held_of(tissue: Tissue, mesh: Mesh) -> Ints:
    """The held nodes of the tissue's mesh. Raises KeyError for a face or a set that the mesh has not."""
    return held_nodes(mesh, tissue.held_faces, tissue.fixed_sets, [region.region() for region in tissue.fixed_regions])


def held_faces_of(tissue: dict[str, Any]) -> list[str]:
    """The faces that a tissue as JSON data holds: those that null stands for, too."""
    if tissue.get("fixed_faces") is not None:
        return list(tissue["fixed_faces"])
    return [] if tissue.get("fixed_sets") or tissue.get("fixed_regions") else list(SIDES)


def region_problems(tissue: Tissue) -> list[Problem]:
    """Regions that hold no space."""
    problems = []
    for i, region in enumerate(tissue.fixed_regions):
        field = f"tissue.fixed_regions[{i}]"
        if isinstance(region, FixedBox) and not all(a <= b for a, b in zip(region.min_mm, region.max_mm, strict=True)):
            allowed = f"must not be below min_mm = {list(region.min_mm)} mm along any axis"
            problems.append(Problem(f"{field}.max_mm", list(region.max_mm), allowed))
        if isinstance(region, FixedPlane) and math.hypot(*region.normal) < 1e-6:
            problems.append(Problem(f"{field}.normal", list(region.normal), "must be a vector at least 1e-6 long"))
    return problems


def held_problems(tissue: Tissue, nodes_m: Floats, held: Ints) -> list[Problem]:
    """Regions without a node, too few held nodes, and all of them. nodes_m: (n, 3) m; held: rows of them."""
    for i, region in enumerate(tissue.fixed_regions):
        if not region.region().contains(nodes_m).any():
            low, high = (_listed(1e3 * end(axis=0)) for end in (nodes_m.min, nodes_m.max))
            allowed = f"holds no node of the mesh, which extends from {low} to {high} mm"
            return [Problem(f"tissue.fixed_regions[{i}]", region.model_dump(mode="json"), allowed)]
    name, value = _first_of(tissue)
    if _on_a_line(nodes_m[held]):
        return [Problem(f"tissue.{name}", value, f"holds {len(held)} nodes; at least 3 not on a line are needed")]
    if len(held) == len(nodes_m):
        return [Problem(f"tissue.{name}", value, f"holds all {len(held)} nodes; at least one must be free")]
    return []


def nothing_held(tissue: Tissue) -> list[Problem]:
    """No face, no set and no region."""
    if tissue.held_faces or tissue.fixed_sets or tissue.fixed_regions:
        return []
    allowed = "must name a face where tissue.fixed_sets and tissue.fixed_regions are empty; null = y_min, y_max"
    return [Problem("tissue.fixed_faces", [], allowed)]


def block_problems(tissue: Tissue, entry_mm: Sequence[float] | None) -> list[Problem]:
    """What regions hold of the block, whose nodes are made for that. entry_mm: None to look at the held nodes alone."""
    if not tissue.fixed_regions or region_problems(tissue) or math.prod(tissue.cells) > MAXIMUM_CELLS:
        return []
    axes = [np.linspace(0.0, edge * 1e-3, count + 1) for edge, count in zip(tissue.size_mm, tissue.cells, strict=True)]
    nodes_m = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    mask = np.zeros(len(nodes_m), bool)
    for region in tissue.fixed_regions:
        mask |= region.region().contains(nodes_m)
    for face in tissue.held_faces:
        axis, end = "xyz".index(face[0]), 0.0 if face.endswith("min") else axes["xyz".index(face[0])][-1]
        mask |= nodes_m[:, axis] == end
    if problems := held_problems(tissue, nodes_m, np.flatnonzero(mask)):
        return problems
    if entry_mm is None:
        return []
    around = [np.searchsorted(axes[a], entry_mm[a] * 1e-3, side="right") for a in (0, 1)]
    corners = [axes[a][np.clip([i - 1, i], 0, len(axes[a]) - 1)] for a, i in enumerate(around)]
    near = np.isin(nodes_m[:, 0], corners[0]) & np.isin(nodes_m[:, 1], corners[1]) & (nodes_m[:, 2] == 0.0)
    if mask[near].all():
        return [Problem("trajectory.entry_mm", list(entry_mm), "must not lie on a held part of the surface")]
    return []


def _first_of(tissue: Tissue) -> tuple[str, object]:
    """The field to name where what is held is wrong as a whole."""
    if tissue.fixed_sets:
        return "fixed_sets", list(tissue.fixed_sets)
    if tissue.fixed_regions:
        return "fixed_regions", [region.model_dump(mode="json") for region in tissue.fixed_regions]
    return "fixed_faces", None if tissue.fixed_faces is None else list(tissue.fixed_faces)


def _listed(values: Floats) -> str:
    return "[" + ", ".join(f"{value:.6g}" for value in values) + "]"


def _on_a_line(points_m: Floats) -> bool:
    """Whether points (k, 3) m lie on one line, or there are none."""
    if not len(points_m):
        return True
    apart = points_m - points_m[0]
    farthest = apart[np.argmax(np.linalg.norm(apart, axis=1))]
    across = np.linalg.norm(np.cross(apart, farthest / max(norm(farthest), LINE_M)), axis=1)
    return bool(across.max() < LINE_M)
