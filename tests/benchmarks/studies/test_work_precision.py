"""Graded blocks: sound wherever the path ends, the path in their middle, mirror images; the study on a tiny path."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from benchmarks.ports import BenchPorts, Crew
from benchmarks.studies.convergence import PATHS
from benchmarks.studies.graded_block import graded_block
from benchmarks.studies.work_precision import CANDIDATES, QUICK_CANDIDATES, REFERENCE, work_precision
from simcore.scenario.blocks import Tissue

if TYPE_CHECKING:
    from contextlib import AbstractContextManager
    from pathlib import Path

SIZE_MM, CELLS = np.array([36.0, 62.0, 122.0]), (4, 6, 10)
ENTRY_MM = np.array([18.0, 31.0, 0.0])


def volumes_mm3(nodes: np.ndarray, tets: np.ndarray) -> np.ndarray:
    corners = nodes[tets]
    return np.asarray(np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6.0)


@pytest.mark.slow
@given(x=st.floats(0.0, 36.0), y=st.floats(0.0, 62.0), depth=st.floats(20.0, 122.0), grading=st.floats(0.0, 4.0))
@example(x=0.0, y=0.0, depth=20.0, grading=5e-324)
def test_a_graded_block_is_sound_wherever_its_path_ends(x: float, y: float, depth: float, grading: float) -> None:
    """No tetrahedron is turned over, the volume is the block's, walls and surface are where they were."""
    box, nodes = graded_block(SIZE_MM, CELLS, ENTRY_MM, np.array([x, y, depth]), grading)
    volumes = volumes_mm3(nodes, box.tets)
    assert volumes.min() > 0.0
    assert volumes.sum() == pytest.approx(SIZE_MM.prod(), rel=1e-9)
    for axis in range(3):
        for wall in (0.0, SIZE_MM[axis]):
            on_wall = box.nodes_m[:, axis] == wall
            np.testing.assert_allclose(nodes[on_wall, axis], wall, atol=1e-9)


def test_small_cells_follow_the_path_and_a_mirrored_path_has_the_mirrored_nodes() -> None:
    target = np.array([24.0, 40.0, 122.0])
    box, nodes = graded_block(SIZE_MM, CELLS, ENTRY_MM, target, 2.0)
    middle = np.all(np.isclose(box.nodes_m[:, :2], SIZE_MM[:2] / 2.0), axis=1)
    share = nodes[middle, 2:] / 122.0
    np.testing.assert_allclose(nodes[middle, :2], ENTRY_MM[:2] + share * (target - ENTRY_MM)[:2], atol=1e-9)
    widths = np.diff(np.unique(np.round(nodes[box.nodes_m[:, 2] == 0.0, 1], 9)))
    assert widths.min() == pytest.approx(31.0 * np.sinh(2.0 / 3.0) / np.sinh(2.0))
    assert np.argmin(widths) in (2, 3)
    _, mirrored = graded_block(SIZE_MM, CELLS, ENTRY_MM, np.array([12.0, 40.0, 122.0]), 2.0)
    reflected = nodes * np.array([-1.0, 1.0, 1.0]) + np.array([36.0, 0.0, 0.0])
    order = [np.lexsort(np.round(one, 6).T) for one in (mirrored, reflected)]
    np.testing.assert_allclose(mirrored[order[0]], reflected[order[1]], atol=1e-9)
    _, even = graded_block(SIZE_MM, CELLS, ENTRY_MM, ENTRY_MM + np.array([0.0, 0.0, 122.0]), 0.0)
    np.testing.assert_allclose(even, box.nodes_m, atol=1e-9)


def test_the_default_is_a_candidate_and_the_reference_is_finer_than_all() -> None:
    assert Tissue().element_size_mm in {one.size_mm for one in CANDIDATES if not one.grading}
    assert REFERENCE.size_mm < min(one.size_mm for one in CANDIDATES)
    assert len({one.name for one in CANDIDATES}) == len(CANDIDATES)


def no_crew(_: int) -> AbstractContextManager[Crew]:
    raise AssertionError("times that are to be compared are taken in one process")


@pytest.mark.slow
def test_the_study_measures_every_mesh_along_every_path(tmp_path: Path) -> None:
    def recorder(_: Path) -> Any:
        raise AssertionError("nothing is recorded")

    said: list[str] = []
    part = work_precision(BenchPorts(said.append, recorder, "", no_crew, tmp_path, quick=True))
    (table,) = part.tables
    assert [row[0] for row in table.rows] == [one.name for one in QUICK_CANDIDATES] + ["uniform, 12 mm"]
    assert all(0.0 <= row[-1] < 1.0 for row in table.rows)
    assert table.rows[-1][-1] == 0.0  # the reference
    assert len(said) == 4 * len(PATHS)
    ElementTree.fromstring(part.files["work_precision.svg"])
    assert table.markdown() in part.files["work_precision.md"]
