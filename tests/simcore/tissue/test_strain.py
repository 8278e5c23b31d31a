"""The tissue's strain on bodies that were deformed by a known matrix."""

from __future__ import annotations

import numpy as np
import pytest

from simcore.mesh.mesh import box_mesh
from simcore.tissue.force_blocks import in_blocks
from simcore.tissue.model import shape_gradients
from simcore.tissue.strain import strain_extremes

MESH = box_mesh(np.array([0.02, 0.03, 0.04]), (2, 3, 4))
GRADIENTS, _ = shape_gradients(MESH.nodes_m, MESH.tets)
BLOCKS = in_blocks(MESH.tets, GRADIENTS)
RNG = np.random.default_rng(5)


@pytest.mark.parametrize(
    "matrix", [np.diag([1.2, 1.0, 0.9]), np.diag([1.0, 0.6, 1.1]), *RNG.normal(np.eye(3), 0.2, (20, 3, 3))]
)
def test_an_affine_deformation_has_its_singular_values(matrix: np.ndarray) -> None:
    found = strain_extremes(MESH.nodes_m @ matrix.T, *BLOCKS)
    stretches = np.linalg.svd(matrix, compute_uv=False)
    assert found.largest_strain == pytest.approx(np.abs(stretches - 1.0).max(), rel=1e-7)
    assert found.least_det_f == pytest.approx(np.linalg.det(matrix), rel=1e-9)


def test_a_rotation_strains_nothing() -> None:
    turn, _ = np.linalg.qr(RNG.normal(size=(3, 3)))
    found = strain_extremes(MESH.nodes_m @ (turn * np.sign(np.linalg.det(turn))).T, *BLOCKS)
    assert found.largest_strain == pytest.approx(0.0, abs=1e-7)
    assert found.least_det_f == pytest.approx(1.0)


def test_the_extremes_are_those_of_single_tetrahedra() -> None:
    """Against a singular value decomposition of every tetrahedron of a crumpled body."""
    x = MESH.nodes_m + RNG.normal(0.0, 1e-3, MESH.nodes_m.shape)
    gradients = np.einsum("tai,taj->tij", x[MESH.tets], GRADIENTS)
    found = strain_extremes(x, *BLOCKS)
    stretches = np.linalg.svd(gradients, compute_uv=False)
    determinants = np.linalg.det(gradients)
    assert found.largest_strain == pytest.approx(np.abs(stretches - 1.0).max(), rel=1e-9)
    assert found.least_det_tet == determinants.argmin()
    assert found.least_det_f == pytest.approx(determinants.min(), rel=1e-9)
