"""The mesh that ships is the one that its script makes, and a good one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import service
from tests.docs.sources import program

SHIPPED = next(Path(service.__file__).parent.rglob("examples/mesh.msh"))


def test_the_shipped_mesh_is_what_the_script_makes() -> None:
    """`python docs/example_mesh.py FILE` writes it."""
    assert SHIPPED.read_text(encoding="ascii") == program("example_mesh").gmsh_text()
    assert SHIPPED.stat().st_size < 100_000


def test_its_tetrahedra_fill_the_barrel() -> None:
    """None flat or turned inside out; together they have the volume under the dome, as far as a polygon can have it."""
    nodes, tets, _ = program("example_mesh").barrel()
    corners = nodes[tets]
    volumes = np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6.0
    edges = np.array([((corners[:, a] - corners[:, b]) ** 2).sum(axis=1) for a in range(4) for b in range(a)])
    assert (6.0 * np.sqrt(2.0) * volumes / edges.mean(axis=0) ** 1.5).min() > 0.2
    share = np.linspace(0.0, 1.0, 10_001)
    radius, slope = 1.0 - 0.2 * (2.0 * share - 1.0) ** 2, -0.8 * (2.0 * share - 1.0)
    depth = 60.0 - 8.0 * 0.5  # means over the disc, where that of rho^2 is one half
    dome = 2.0 * 8.0 * (1.0 - share) * 0.5
    volume = np.pi * 32.0 * 26.0 * np.trapezoid(radius * (radius * depth - slope * dome), share)
    polygon = 24.0 / (2.0 * np.pi) * np.sin(2.0 * np.pi / 24.0)  # inscribed in the circle, as the outer ring is
    assert volumes.sum() == pytest.approx(polygon * volume, rel=0.01)


def test_its_surface_is_closed() -> None:
    """Every edge of the groups top, side and base belongs to exactly two triangles."""
    _, _, surfaces = program("example_mesh").barrel()
    triangles = np.concatenate(list(surfaces.values()))
    edges = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    assert (counts == 2).all()
