"""The picture of a mesh: bounded however fine the surface is, within its frame, the near side alone."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from service.web.pictures import mesh
from service.web.pictures.mesh import SIZE, mesh_svg
from simcore.scenario.scenario import Scenario
from tests.service.fake_run import box_mesh

if TYPE_CHECKING:
    import pytest


def _triangles(svg: str) -> np.ndarray:
    """(t, 3, 2) px."""
    paths = re.findall(r'd="M([\d.]+) ([\d.]+)L([\d.]+) ([\d.]+)L([\d.]+) ([\d.]+)Z"', svg)
    return np.array(paths, float).reshape(-1, 3, 2)


def _box(element_size_mm: float) -> tuple[np.ndarray, np.ndarray, int]:
    scenario = Scenario.load({"tissue": {"element_size_mm": element_size_mm}, "interaction": {"spacing_mm": 20.0}})
    nodes, tets, surface = box_mesh(scenario)
    p = nodes[tets]
    flipped = np.linalg.det(p[:, 1:] - p[:, :1]) < 0.0
    tets[flipped] = tets[flipped][:, [1, 0, 2, 3]]
    return nodes, tets, len(surface)


def test_half_of_a_box_is_seen_within_the_frame() -> None:
    nodes, tets, surface = _box(20.0)
    drawn = _triangles(mesh_svg(nodes, tets))
    assert 0.3 * surface < len(drawn) < 0.7 * surface
    assert drawn.min() >= 0.0
    assert drawn.max() <= SIZE
    assert np.ptp(drawn.reshape(-1, 2), axis=0).max() > 0.8 * SIZE


def test_a_fine_surface_is_drawn_coarser_and_keeps_its_outline(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mesh, "MOST_TRIANGLES", 800)
    nodes, tets, surface = _box(6.0)
    assert surface > 1.5 * 800
    drawn = _triangles(mesh_svg(nodes, tets))
    assert 150 < len(drawn) <= 800
    coarse = _triangles(mesh_svg(*_box(20.0)[:2]))
    np.testing.assert_allclose(np.ptp(drawn.reshape(-1, 2), axis=0), np.ptp(coarse.reshape(-1, 2), axis=0), rtol=0.12)
