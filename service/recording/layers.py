"""Strain and stress of the tissue on the section of a recording, smoothed over the tetrahedra around each node."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import csr_array

from service.recording.colors import STRAIN_SCALE, Colors, level_colors

if TYPE_CHECKING:
    from service.recording.section import Section
    from simcore.arrays import Floats, Ints
    from simcore.scenario.blocks import Tissue

LAYERS = ("strain", "stress")


@dataclass(frozen=True)
class SectionStrain:
    """What the section needs of the tetrahedra that touch it, taken from the rest shape once."""

    tets: Ints  # (t, 4) into the mesh
    inverse: Floats  # (t, 3, 3) 1/m: edges of the rest shape, inverted
    smoothing: csr_array  # (s, t): a point of the section has the mean of what is around its two nodes
    shear_pa: float
    stress_scale_pa: float

    @classmethod
    def of(cls, section: Section, rest_m: Floats, tets: Ints, tissue: Tissue) -> SectionStrain:
        """For a section of a mesh with nodes rest_m (n, 3) and tetrahedra (t, 4)."""
        wanted = np.zeros(len(rest_m), bool)
        wanted[section.ends.ravel()] = True
        near = tets[wanted[tets].any(axis=1)]
        edges = _edges(rest_m, near)
        smoothing = _smoothing(section, near, np.abs(np.linalg.det(edges)), len(rest_m))
        young_pa = 1e3 * tissue.young_kpa
        shear_pa = young_pa / (2.0 * (1.0 + tissue.poisson))
        return cls(near, np.asarray(np.linalg.inv(edges), float), smoothing, shear_pa, STRAIN_SCALE * young_pa)

    def values(self, nodes_m: Floats) -> tuple[Floats, Floats]:
        """(s,) largest |principal stretch - 1| and (s,) von Mises stress in Pa at the points of the section, of
        co-rotational linear elasticity without damping. nodes_m: (n, 3)."""
        gradient = _edges(nodes_m, self.tets) @ self.inverse
        stretches = np.sqrt(np.maximum(np.linalg.eigvalsh(gradient.transpose(0, 2, 1) @ gradient), 0.0))
        strains = stretches - 1.0
        a, b, c = strains.T
        stress_pa = 2.0 * self.shear_pa * np.sqrt(0.5 * ((a - b) ** 2 + (b - c) ** 2 + (c - a) ** 2))
        return self.smoothing @ np.abs(strains).max(axis=1), self.smoothing @ stress_pa

    def colors(self, nodes_m: Floats) -> tuple[Colors, ...]:
        """(s,) colours of each of `LAYERS`."""
        strain, stress_pa = self.values(nodes_m)
        return level_colors(strain / STRAIN_SCALE), level_colors(stress_pa / self.stress_scale_pa)


def _edges(nodes_m: Floats, tets: Ints) -> Floats:
    """(t, 3, 3): the edges from the first node of each tetrahedron, as columns."""
    edges: Floats = (nodes_m[tets[:, 1:]] - nodes_m[tets[:, :1]]).transpose(0, 2, 1)
    return edges


def _smoothing(section: Section, tets: Ints, volumes: Floats, nodes: int) -> csr_array:
    """Weights by volume from tetrahedra to nodes, then by distance from nodes to the points on their edges."""
    count = len(tets)
    to_nodes = csr_array((np.repeat(volumes, 4), (tets.ravel(), np.repeat(np.arange(count), 4))), shape=(nodes, count))
    whole = np.asarray(to_nodes.sum(axis=1)).ravel()
    to_nodes = csr_array(to_nodes.multiply(1.0 / np.maximum(whole, 1e-300)[:, None]))
    rows, weights = np.arange(len(section.ends)), section.weights
    values = np.concatenate([1.0 - weights, weights])
    places = (np.concatenate([rows, rows]), np.concatenate([section.ends[:, 0], section.ends[:, 1]]))
    return csr_array(csr_array((values, places), shape=(len(rows), nodes)) @ to_nodes)
