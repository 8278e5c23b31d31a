"""The SIMD force kernel is the plain one: same forces, rotations and determinants, whatever the start."""

import numpy as np
import pytest

from simcore.scenario.build import tissue_model
from simcore.scenario.scenario import Tissue
from simcore.tissue.force_blocks import LANES, ForceBlocks
from simcore.tissue.model import TissueModel, elastic_forces


def model(element_mm: float = 10.0) -> TissueModel:
    return tissue_model(Tissue(size_mm=(24.0, 40.0, 50.0), element_size_mm=element_mm))


def plain(tissue: TissueModel, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    rotations = np.tile(np.eye(3).ravel(), (len(tissue.mesh.tets), 1))
    forces = np.zeros_like(x)
    material = (tissue.gradients, tissue.volumes_m3, tissue.mu_pa, tissue.lambda_pa)
    least, _ = elastic_forces(x, tissue.mesh.tets, *material, rotations, forces)
    return forces, rotations, least


@pytest.mark.parametrize(
    "disturbance_m", [0.0, 3e-4, 2e-3], ids=["rest", "small", "two Newton iterations are not enough"]
)
@pytest.mark.parametrize("element_mm", [10.0, 7.0], ids=["full blocks", "last block filled up"])
def test_equal_to_the_plain_form(element_mm: float, disturbance_m: float) -> None:
    """Identity: both evaluate P = 2 mu (F - R) + lambda tr(R^T F - I) R with the exact R."""
    tissue = model(element_mm)
    x = tissue.mesh.nodes_m + np.random.default_rng(3).normal(size=tissue.mesh.nodes_m.shape) * disturbance_m
    blocks, forces = ForceBlocks(tissue), np.zeros_like(x)
    least = blocks.evaluate(x, forces)
    expected, rotations, det = plain(tissue, x)
    np.testing.assert_allclose(forces, expected, atol=1e-13 * max(1.0, np.abs(expected).max()))
    np.testing.assert_allclose(blocks.rotations(), rotations, atol=1e-12)
    assert least == pytest.approx(det, abs=1e-13)


def test_half_a_turn_from_a_cold_start() -> None:
    """A warm start at the wrong stationary point of tr(R^T F) is noticed and begun anew."""
    tissue = model()
    turned = tissue.mesh.nodes_m * np.array([-1.0, -1.0, 1.0])
    forces = np.zeros_like(turned)
    ForceBlocks(tissue).evaluate(turned, forces)
    assert np.abs(forces).max() < 1e-13


def test_rotations_can_be_put_back() -> None:
    """The warm start is state: restored, the next evaluation is the same to the last bit."""
    tissue = model()
    rng = np.random.default_rng(4)
    x = tissue.mesh.nodes_m + rng.normal(size=tissue.mesh.nodes_m.shape) * 1e-3
    blocks, first, second = ForceBlocks(tissue), np.zeros_like(x), np.zeros_like(x)
    blocks.evaluate(x, first)
    kept = blocks.rotations()
    blocks.evaluate(x, first)
    blocks.evaluate(x + 1e-4 * rng.normal(size=x.shape), second)
    blocks.set_rotations(kept)
    blocks.evaluate(x, second)
    assert np.array_equal(first, second)


def test_the_last_block_is_padded_with_weightless_tetrahedra() -> None:
    tissue = model(30.0)
    assert len(tissue.mesh.tets) % LANES != 0
    blocks = ForceBlocks(tissue)
    assert blocks.blocks * LANES >= blocks.count


def test_not_finite_stays_visible() -> None:
    tissue = model()
    x = tissue.mesh.nodes_m.copy()
    x[30] = np.nan
    forces = np.zeros_like(x)
    ForceBlocks(tissue).evaluate(x, forces)
    assert np.isnan(forces).any()
