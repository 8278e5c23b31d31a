"""A rigid bonded cylinder in the default block by a finite element code of others: its deflection per line load.

    python tests/data/line_reference/rigid_cylinder.py > tests/data/line_reference/rigid_cylinder.json

The hole itself is meshed, with triquadratic hexahedra that are finer towards it (scikit-fem, SciPy). Three planes of
symmetry leave an eighth of the block. Each cross-section of the hole moves as a rigid disc that does not turn, by u(z);
a uniform line load q acts over the middle of the depth, the faces z = 0 and z = 122 mm are free. Reported: the mean of
u over the loaded length, per q. `plane_strain`: the same cross-section in two dimensions.
"""

from __future__ import annotations

import json
import sys

import numpy as np
import scipy
import skfem
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import spsolve
from skfem import Basis, ElementHex2, ElementQuad2, ElementVector, MeshHex, MeshQuad
from skfem.models.elasticity import lame_parameters, linear_elasticity

SIZE_MM, RADIUS_MM = np.array([36.0, 62.0, 122.0]), 0.635
YOUNG_MPA, POISSON = 6.3e-3, 0.4
FARTHEST = 30.0  # cells grow outwards by so much


def placed(share, angle):
    """(2, n) mm: on the ray at `angle` from the hole (share 0) to the edge of the quarter rectangle (share 1)."""
    way = np.array([np.cos(angle), np.sin(angle)])
    with np.errstate(divide="ignore"):
        far = (SIZE_MM[:2, None] / 2.0 / np.maximum(np.abs(way), 1e-12)).min(axis=0)
    return (RADIUS_MM + share * (far - RADIUS_MM)) * way


def mesh_of(around, outward, depths_mm):
    """A quarter of the cross-section, or an eighth of the block; its hole in the origin, depth from the middle."""
    corner = np.arctan2(SIZE_MM[1], SIZE_MM[0])
    before = max(2, round(around * corner / (np.pi / 2)))
    low, high = np.linspace(0.0, corner, before + 1), np.linspace(corner, np.pi / 2, around - before + 1)
    angles = np.concatenate([low, high[1:]])
    shares = (np.geomspace(1.0, FARTHEST, outward + 1) - 1.0) / (FARTHEST - 1.0)
    axes = [shares, angles]
    mesh = MeshQuad.init_tensor(*axes) if depths_mm is None else MeshHex.init_tensor(*axes, depths_mm)
    points = mesh.p.copy()
    points[:2] = placed(mesh.p[0], mesh.p[1])
    points[np.abs(points) < 1e-9] = 0.0
    return type(mesh)(points, mesh.t)


def component_of(basis):
    """(dofs,) the axis of each unknown."""
    found = np.full(basis.N, -1)
    for dofs in (basis.nodal_dofs, basis.edge_dofs, basis.facet_dofs, basis.interior_dofs):
        if dofs is not None:
            for axis, numbers in enumerate(dofs):
                found[numbers] = axis
    assert (found >= 0).all()
    return found


def held(where, component, axis):
    """(dofs,) what does not move under a load along `axis`: odd across its own plane, even across the other."""
    still = np.abs(where[1] - SIZE_MM[1] / 2.0) < 1e-6
    for plane in range(2):
        vanishes = component != axis if plane == axis else component == plane
        still |= (np.abs(where[plane]) < 1e-6) & vanishes
    if len(where) == 3:
        still |= (np.abs(where[2]) < 1e-6) & (component == 2)
    return still


def line_weights(levels, loaded_half_mm):
    """Integrals of the quadratic shapes over the loaded part, (levels,) mm; 1 for a cross-section."""
    if len(levels) == 1:
        return np.ones(1)
    weights = np.zeros(len(levels))
    for i in range(0, len(levels) - 2, 2):
        height = levels[i + 2] - levels[i]
        if levels[i + 2] < loaded_half_mm + 1e-6:
            weights[i : i + 3] += height / 6.0 * np.array([1.0, 4.0, 1.0])
    assert abs(weights.sum() - loaded_half_mm) < 1e-6
    return weights


def deflection(mesh, axis, loaded_half_mm=None):
    """Mean of u along `axis` per line load, mm2/N, and the number of unknowns."""
    element = ElementQuad2() if len(mesh.p) == 2 else ElementHex2()
    basis = Basis(mesh, ElementVector(element), intorder=4)
    stiffness = linear_elasticity(*lame_parameters(YOUNG_MPA, POISSON)).assemble(basis).tocoo()
    where, component = basis.doflocs, component_of(basis)
    hole = np.hypot(where[0], where[1]) < RADIUS_MM * (1.0 + 1e-6)
    still = held(where, component, axis) | (hole & (component != axis))
    rows = hole & (component == axis)
    depth = np.round(where[2], 6) if len(where) == 3 else np.zeros(basis.N)
    levels, level = np.unique(depth[rows], return_inverse=True)
    number = np.full(basis.N, -1)
    number[rows] = level
    others = ~still & ~rows
    number[others] = len(levels) + np.arange(others.sum())
    i, j = number[stiffness.row], number[stiffness.col]
    kept, size = (i >= 0) & (j >= 0), number.max() + 1
    matrix = coo_matrix((stiffness.data[kept], (i[kept], j[kept])), (size, size)).tocsc()
    weights, load = line_weights(levels, loaded_half_mm), np.zeros(size)
    load[: len(levels)] = weights / 4.0  # a quarter of the cross-section bears a quarter of the load
    moves = spsolve(matrix, load, permc_spec="MMD_AT_PLUS_A")
    return float(weights @ moves[: len(levels)] / weights.sum()), int(size)


def block(around, outward, loaded_mm, cells):
    """Both directions in the block, finer towards its free end."""
    half = loaded_mm / 2.0
    inner = half * (1.0 - (1.0 - np.linspace(0.0, 1.0, cells + 1)) ** 1.5)
    depths = np.concatenate([inner, [0.5 * (half + SIZE_MM[2] / 2.0), SIZE_MM[2] / 2.0]])
    return both(mesh_of(around, outward, depths), half)


def both(mesh, half=None):
    """Deflections along x and along y."""
    (x, size), (y, _) = deflection(mesh, 0, half), deflection(mesh, 1, half)
    return {"x": round(x, 3), "y": round(y, 3), "unknowns": size}


def main():
    """Print the reference with its coarser meshes, which show how far it has converged."""
    flat = {f"{a}x{o}": both(mesh_of(a, o, None)) for a, o in ((6, 8), (12, 16), (24, 32))}
    print(flat, file=sys.stderr, flush=True)
    deep = {}
    for loaded in (111.0, 116.0):
        deep[f"{loaded:g}"] = {f"{a}x{o}x{c}": block(a, o, loaded, c) for a, o, c in ((4, 5, 3), (6, 8, 5))}
        print(deep, file=sys.stderr, flush=True)
    document = {
        "what": "mean deflection of a rigid bonded cylinder per line load, mm2/N, by direction and mesh",
        "size_mm": SIZE_MM.tolist(),
        "radius_mm": RADIUS_MM,
        "young_kpa": 1e3 * YOUNG_MPA,
        "poisson": POISSON,
        "held": ["y_min", "y_max"],
        "plane_strain": flat,
        "block_by_loaded_mm": deep,
        "versions": {"scikit-fem": skfem.__version__, "scipy": scipy.__version__, "numpy": np.__version__},
    }
    print(json.dumps(document, indent=1))


if __name__ == "__main__":
    main()
