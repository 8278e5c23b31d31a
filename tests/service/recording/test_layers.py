"""Legend, layers of strain and stress, and the mark of a base that is held back."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from service.recording.colors import level_colors
from service.recording.layers import SectionStrain, eigenvalues
from service.recording.legend import FORCE_ARROW_M_PER_N
from service.recording.observer import RerunObserver
from service.recording.section import section
from simcore.compiled import kernel  # noqa: F401  (sets the compiler up before the first kernel)
from simcore.tissue.stored import stored
from tests.service.fake_run import FakeRun, box_mesh
from tests.service.recording.recorded import recorded, short, static

if TYPE_CHECKING:
    from pathlib import Path

    from simcore.arrays import Floats, Ints


def _strain() -> tuple[SectionStrain, Floats, Ints]:
    scenario = short()
    nodes, tets, _ = box_mesh(scenario)
    cut = section(nodes, tets, scenario.path().curve(np.linspace(0, 1, 11)), behind_m=3e-3)
    return SectionStrain.of(cut, nodes, tets, scenario.tissue), nodes, tets


def test_a_rotation_strains_nothing_and_a_stretch_everywhere_alike() -> None:
    strain, nodes, _ = _strain()
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    for values in strain.values(nodes @ turn.T + 0.1):
        np.testing.assert_allclose(values, 0.0, atol=1e-6)
    stretched, stress_pa = strain.values(nodes * [1.0, 1.0, 1.2])
    np.testing.assert_allclose(stretched, 0.2, rtol=1e-9)
    np.testing.assert_allclose(stress_pa, 2.0 * strain.shear_pa * 0.2, rtol=1e-9)


def test_eigenvalues_of_any_symmetric_matrices_even_with_equal_ones() -> None:
    rng = np.random.default_rng(3)
    some = rng.normal(size=(200, 3, 3))
    turns = np.linalg.qr(some)[0]
    made = [np.diag(d) for d in ([1.0, 1.0, 1.0], [0.5, 1.0, 1.0], [1.0, 1.0, 1.3], [0.0, 0.0, 0.0])]
    equal = np.array([turn @ matrix @ turn.T for turn in turns[:20] for matrix in made])
    matrices = np.concatenate([some.transpose(0, 2, 1) @ some, np.eye(3)[None], equal])
    np.testing.assert_allclose(eigenvalues(matrices), np.linalg.eigvalsh(matrices).T, atol=1e-7)


def test_the_stress_is_that_of_the_tissue_in_the_tetrahedra_of_the_section() -> None:
    strain, nodes, tets = _strain()
    rng = np.random.default_rng(5)
    moved = nodes * [1.0, 0.95, 1.1] + rng.normal(0.0, 2e-4, nodes.shape)
    inverse = np.linalg.inv(nodes[tets[:, 1:]] - nodes[tets[:, :1]]).transpose(0, 2, 1)
    gradients = np.concatenate([-inverse.sum(axis=1, keepdims=True), inverse], axis=1)
    largest = stored(moved, tets, np.ascontiguousarray(gradients), np.ones(len(tets)), strain.shear_pa, 0.0)
    smooth = strain.values(moved)[1]
    assert 0.2 * largest.von_mises_pa < smooth.max() <= largest.von_mises_pa


@pytest.mark.slow
def test_the_recording_has_a_legend_layers_and_the_mark_of_limits(tmp_path: Path) -> None:
    path = tmp_path / "recording.rrd"
    with RerunObserver(path, recording_id="layers") as recorder:
        FakeRun(short()).run(recorder)
    assert recorder.warning is None
    bar = static(path, "world/legend/length")
    assert bar["LineStrips3D:labels"] == ["10 mm"]
    ends = np.array(bar["LineStrips3D:strips"][0])
    assert np.linalg.norm(ends[1] - ends[0]) == pytest.approx(10e-3, rel=1e-5)
    arrow = static(path, "world/legend/force")
    length = np.linalg.norm(arrow["Arrows3D:vectors"][0])
    assert arrow["Arrows3D:labels"] == [f"{length / FORCE_ARROW_M_PER_N:g} N"]
    for layer, last in (("displacement", "5 mm"), ("strain", "30 %"), ("stress", "1.9 kPa")):
        known = static(path, f"world/legend/{layer}")
        assert known["Points3D:labels"][-1] == last
        assert known["Points3D:colors"] == level_colors(np.linspace(0.0, 1.0, 6)).tolist()
    shown = recorded(path, "world/tissue/section", "Mesh3D:vertex_positions")
    for layer in ("strain", "stress"):
        assert recorded(path, f"world/tissue/{layer}", "Mesh3D:vertex_positions").keys() == shown.keys()
        colors = recorded(path, f"world/tissue/{layer}", "Mesh3D:vertex_colors")
        assert len({tuple(row) for row in colors.values()}) > 1
    limited = recorded(path, "world/limited", "Points3D:positions")
    assert {step for step, points in limited.items() if len(points)} == {step for step in limited if step % 7 == 0}
