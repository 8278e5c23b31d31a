"""What the tissue stores and bears, on bodies deformed by a known matrix, and against the force pass."""

from __future__ import annotations

import numpy as np
import pytest

from simcore.tissue.stored import stored
from tests.simcore.block import block, held

TISSUE = block()
RNG = np.random.default_rng(3)


def of(x: np.ndarray) -> tuple[float, float]:
    t = TISSUE
    return stored(np.ascontiguousarray(x), t.mesh.tets, t.gradients, t.volumes_m3, t.mu_pa, t.lambda_pa)


def test_a_uniaxial_strain_has_its_energy_and_its_von_mises_stress() -> None:
    """e = diag(a, 0, 0): w = (mu + lambda / 2) a^2, von Mises 2 mu a; turned as a whole it stays so."""
    a, (turn, _) = 0.03, np.linalg.qr(RNG.normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    energy, von_mises = of(TISSUE.mesh.nodes_m @ np.diag([1.0 + a, 1.0, 1.0]) @ turn.T)
    volume = TISSUE.volumes_m3.sum()
    assert energy == pytest.approx(volume * (TISSUE.mu_pa + 0.5 * TISSUE.lambda_pa) * a**2, rel=1e-6)
    assert von_mises == pytest.approx(2.0 * TISSUE.mu_pa * a, rel=1e-6)


def test_a_volume_change_has_no_von_mises_stress() -> None:
    assert of(1.02 * TISSUE.mesh.nodes_m)[1] == pytest.approx(0.0, abs=1e-3)


def test_the_energy_is_that_of_the_force_pass() -> None:
    x = TISSUE.mesh.nodes_m + RNG.normal(0.0, 3e-4, TISSUE.mesh.nodes_m.shape)
    assert of(x)[0] == pytest.approx(held(TISSUE, x)[2], rel=1e-7)
