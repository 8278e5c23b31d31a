"""The drawn parts of a mesh against the geometry of a box."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from service.recording.section import path_plane, section, surface
from simcore.scenario.presets import preset
from simcore.scenario.scenario import Scenario
from tests.service.fake_run import box_mesh

if TYPE_CHECKING:
    from simcore.arrays import Floats, Ints

SIZE_M = np.array([0.036, 0.062, 0.122])
STRAIGHT = np.array([[0.018, 0.031, 0.0], [0.018, 0.031, 0.122]])


def areas(points: Floats, triangles: Ints) -> Floats:
    a, b, c = points[triangles].transpose(1, 0, 2)
    found: Floats = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return found


def test_surface_normals_point_outward() -> None:
    nodes, _, triangles = box_mesh(preset("demo"))
    drawn = surface(nodes, triangles)
    points = nodes[drawn.nodes]
    for axis in range(3):
        inside_face = np.isclose(points[:, axis], 0.0)
        assert (drawn.normals[inside_face, axis] < -0.3).all()
    assert np.allclose(np.linalg.norm(drawn.normals, axis=1), 1.0)
    assert areas(points, drawn.triangles).sum() == pytest.approx(
        2 * (SIZE_M[0] * SIZE_M[1] + SIZE_M[1] * SIZE_M[2] + SIZE_M[0] * SIZE_M[2])
    )


def test_sharp_edges_are_the_twelve_edges_of_the_box() -> None:
    nodes, _, triangles = box_mesh(preset("demo"))
    ends = nodes[surface(nodes, triangles).edges]
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    assert lengths.sum() == pytest.approx(4 * SIZE_M.sum())
    on_faces = (np.isclose(ends, 0.0) | np.isclose(ends, SIZE_M)).all(axis=1).sum(axis=1)
    assert (on_faces >= 2).all()


@pytest.mark.slow
@pytest.mark.parametrize("behind_m", [0.0, 1e-3, 3e-3])
@pytest.mark.parametrize("element_size_mm", [4.0, 6.0, 7.5])
def test_section_covers_the_plane_and_nothing_else(behind_m: float, element_size_mm: float) -> None:
    nodes, tets, _ = box_mesh(Scenario.load({"tissue": {"element_size_mm": element_size_mm},
                                             "interaction": {"spacing_mm": 10.0}}))  # fmt: skip
    cut = section(nodes, tets, STRAIGHT, behind_m=behind_m)
    points = cut.positions(nodes)
    assert areas(points, cut.triangles).sum() == pytest.approx(SIZE_M[0] * SIZE_M[2], rel=1e-9)
    _, _, normal = path_plane(STRAIGHT)
    assert np.allclose((points - STRAIGHT[0]) @ normal, -behind_m, atol=1e-12)


def test_section_points_stay_with_the_material() -> None:
    nodes, tets, _ = box_mesh(preset("demo"))
    cut = section(nodes, tets, STRAIGHT, behind_m=3e-3)
    stretch = np.array([[1.1, 0.2, 0.0], [0.0, 0.9, 0.1], [0.05, 0.0, 1.0]])
    moved = nodes @ stretch.T + [0.01, 0.0, -0.02]
    assert np.allclose(cut.positions(moved), cut.positions(nodes) @ stretch.T + [0.01, 0.0, -0.02], atol=1e-15)


def test_the_plane_holds_a_curved_path() -> None:
    path = preset("demo").path().curve(np.linspace(0, 1, 50))
    along, across, normal = path_plane(path)
    assert np.allclose((path - path[0]) @ normal, 0.0, atol=1e-12)
    assert np.allclose(np.array([along, across, normal]) @ np.array([along, across, normal]).T, np.eye(3))
