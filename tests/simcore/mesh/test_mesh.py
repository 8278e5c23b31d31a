"""The box mesh: it fills the box, conforms, mirrors itself, and `locate` is its inverse."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from simcore.mesh.mesh import BoxMesh, box_mesh, locate
from simcore.scenario.scenario import Tissue
from tests.budget import examples
from tests.verification import verify

SIZE_M = np.array([0.036, 0.062, 0.122])
counts = st.integers(1, 5)
quick = settings(max_examples=examples(100), deadline=None)


def face_sets(tets: np.ndarray) -> np.ndarray:
    """(4 t, 3) sorted corners of every face of every tetrahedron."""
    faces = np.concatenate([tets[:, [1, 2, 3]], tets[:, [0, 2, 3]], tets[:, [0, 1, 3]], tets[:, [0, 1, 2]]])
    return np.sort(faces, axis=1)


def volumes(mesh: BoxMesh) -> np.ndarray:
    corners = mesh.nodes_m[mesh.tets]
    edges = corners[:, 1:] - corners[:, :1]
    return np.einsum("ti,ti->t", edges[:, 0], np.cross(edges[:, 1], edges[:, 2])) / 6.0


def reflected_tets(mesh: BoxMesh, axis: int) -> set[tuple[int, ...]]:
    """The tetrahedra after the reflection of one axis, each as its sorted corners."""
    grid = np.arange(len(mesh.nodes_m)).reshape([c + 1 for c in mesh.cells[::-1]])
    image = np.flip(grid, 2 - axis).ravel()
    return {tuple(t) for t in np.sort(image[mesh.tets], axis=1)}


def located(mesh: BoxMesh, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    nodes, weights = np.empty(4, np.int64), np.empty(4)
    locate(point, mesh.size_m, np.array(mesh.cells), nodes, weights)
    return nodes, weights


@pytest.mark.parametrize(("edge_mm", "nodes"), [(10.0, 455), (7.5, 765), (6.0, 1617), (5.0, 2925), (4.0, 4743)])
def test_node_counts_of_the_papers_block(edge_mm: float, nodes: int) -> None:
    """spec of the tissue: cells = 2 round(size / 2h), at least 2: even."""
    mesh = box_mesh(SIZE_M, Tissue(element_size_mm=edge_mm).cells)
    text, source = f"nodes of the paper's block at h = {edge_mm:g} mm", "spec of the tissue"
    verify("tissue", text, expected=nodes, measured=len(mesh.nodes_m), tolerance=0, source=source)
    assert len(mesh.tets) == 6 * np.prod(mesh.cells)


@pytest.mark.slow
@quick
@given(st.tuples(counts, counts, counts))
def test_the_tetrahedra_fill_the_box(cells: tuple[int, int, int]) -> None:
    """All volumes are positive, equal (a sixth of a cell) and add up to the box."""
    mesh = box_mesh(SIZE_M, cells)
    np.testing.assert_allclose(volumes(mesh), SIZE_M.prod() / np.prod(cells) / 6.0, rtol=1e-12)
    assert volumes(mesh).sum() == pytest.approx(SIZE_M.prod(), rel=1e-13)


@pytest.mark.slow
@quick
@given(st.tuples(counts, counts, counts))
def test_the_mesh_conforms(cells: tuple[int, int, int]) -> None:
    """A face belongs to two tetrahedra inside, to one on the surface, which has two triangles a cell face."""
    mesh = box_mesh(SIZE_M, cells)
    faces, shared = np.unique(face_sets(mesh.tets), axis=0, return_counts=True)
    nx, ny, nz = cells
    assert set(shared) <= {1, 2}
    assert np.count_nonzero(shared == 1) == 4 * (nx * ny + ny * nz + nz * nx)
    assert {tuple(t) for t in faces[shared == 1]} == {tuple(sorted(t)) for t in mesh.surface_triangles}


@pytest.mark.slow
@quick
@given(st.tuples(counts, counts, counts))
def test_the_surface_is_closed_and_outward(cells: tuple[int, int, int]) -> None:
    """Every directed edge has its opposite (closed), and the divergence theorem gives the volume (outward)."""
    mesh = box_mesh(SIZE_M, cells)
    triangles = mesh.surface_triangles
    edges = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    directed = {tuple(edge) for edge in edges}
    assert len(directed) == len(edges)
    assert {(b, a) for a, b in directed} == directed
    a, b, c = np.swapaxes(mesh.nodes_m[triangles], 0, 1)
    assert np.einsum("ti,ti->", a, np.cross(b, c)) / 6.0 == pytest.approx(SIZE_M.prod(), rel=1e-12)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("cells", [(2, 4, 6), (4, 2, 2), (3, 5, 3), (6, 10, 20)])
def test_the_pattern_mirrors_itself_for_even_counts(cells: tuple[int, int, int], axis: int) -> None:
    """spec of the tissue: reflecting an axis with an even cell count maps the mesh on itself; an odd count does not."""
    mesh = box_mesh(SIZE_M, cells)
    own = {tuple(t) for t in np.sort(mesh.tets, axis=1)}
    assert (reflected_tets(mesh, axis) == own) == (cells[axis] % 2 == 0)


@pytest.mark.parametrize("face", ["x_min", "x_max", "y_min", "y_max", "z_min", "z_max"])
def test_named_faces_are_the_nodes_on_them(face: str) -> None:
    """A face holds exactly the nodes whose coordinate is its end of the box."""
    mesh = box_mesh(SIZE_M, (3, 4, 5))
    axis = "xyz".index(face[0])
    end = 0.0 if face.endswith("min") else SIZE_M[axis]
    on_it = np.flatnonzero(np.abs(mesh.nodes_m[:, axis] - end) < 1e-12)
    assert sorted(mesh.faces[face]) == list(on_it)


shares = arrays(np.float64, 3, elements=st.floats(0.0, 1.0))


@pytest.mark.slow
@quick
@given(st.tuples(counts, counts, counts), shares)
def test_locate_reproduces_linear_fields(cells: tuple[int, int, int], share: np.ndarray) -> None:
    """Shape functions: not negative, sum 1, sum N_a X_a = X, over the corners of one tetrahedron of the mesh."""
    mesh = box_mesh(SIZE_M, cells)
    point = share * SIZE_M
    nodes, weights = located(mesh, point)
    assert weights.min() >= -1e-15
    assert weights.sum() == pytest.approx(1.0, abs=1e-15)
    np.testing.assert_allclose(weights @ mesh.nodes_m[nodes], point, atol=1e-16)
    assert tuple(sorted(nodes)) in {tuple(t) for t in np.sort(mesh.tets, axis=1)}


@pytest.mark.slow
@quick
@given(arrays(np.float64, 3, elements=st.floats(-2.0, 3.0)))
def test_locate_moves_a_point_outside_onto_the_box(share: np.ndarray) -> None:
    """The documented answer outside: the nearest point of the box."""
    mesh = box_mesh(SIZE_M, (3, 4, 5))
    nodes, weights = located(mesh, share * SIZE_M)
    np.testing.assert_allclose(weights @ mesh.nodes_m[nodes], np.clip(share, 0.0, 1.0) * SIZE_M, atol=1e-16)
