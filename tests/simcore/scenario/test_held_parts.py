"""What is held: the faces that null stands for, regions by place, and what is said of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from simcore.errors import ScenarioError
from simcore.rollout.rollout import run
from simcore.scenario.build import insertion_of, mesh_of
from simcore.scenario.held_parts import held_of
from simcore.scenario.presets import preset_names, start, with_changes
from simcore.scenario.scenario import Scenario
from tests.simcore.short_run import short

FILES = Path(__file__).parents[1] / "mesh" / "files"
SPHERE = {"kind": "sphere", "centre_mm": [0, 0, 122], "radius_mm": 25}
BOX = {"kind": "box", "min_mm": [0, 0, 110], "max_mm": [36, 62, 122]}
PLANE = {"kind": "plane", "point_mm": [36, 0, 0], "normal": [-2, 0, 0], "within_mm": 0.1}


def held_mm(**tissue: Any) -> np.ndarray[Any, Any]:
    """(n, 3) mm of the held nodes."""
    block = Scenario.load({"tissue": tissue}).tissue
    mesh = mesh_of(block)
    return 1e3 * mesh.nodes_m[held_of(block, mesh)]


def problem(data: dict[str, Any]) -> str:
    with pytest.raises(ScenarioError) as caught:
        Scenario.load(data)
    return str(caught.value)


@pytest.mark.parametrize("name", preset_names())
def test_null_is_the_default_and_is_printed(name: str) -> None:
    assert start(name)["tissue"]["fixed_faces"] is None
    assert Scenario.load(start(name)).resolved()["tissue"]["fixed_faces"] is None


@pytest.mark.parametrize(
    ("tissue", "faces"),
    [
        ({}, ("y_min", "y_max")),
        ({"fixed_faces": None}, ("y_min", "y_max")),
        ({"fixed_regions": [BOX]}, ()),
        ({"fixed_faces": ["x_min"], "fixed_regions": [BOX]}, ("x_min",)),
        ({"fixed_faces": [], "fixed_regions": [BOX]}, ()),
    ],
)
def test_null_means_the_sides_where_nothing_else_is_named(tissue: dict[str, Any], faces: tuple[str, ...]) -> None:
    assert Scenario.load({"tissue": tissue}).tissue.held_faces == faces


@pytest.mark.slow
def test_a_changed_scenario_holds_what_its_sets_name_and_nothing_else() -> None:
    """As `run line --set tissue.mesh_file=... --set tissue.fixed_sets=...` loads it."""
    changes = [
        f"tissue.mesh_file={FILES / 'nset_names.inp'}",
        'tissue.fixed_sets=["A"]',
        "trajectory.entry_mm=[20,20,0]",
    ]
    tissue = Scenario.load(with_changes(start("line"), [*changes, "trajectory.target_mm=[22,25,50]"])).tissue
    assert len(held_of(tissue, mesh_of(tissue))) == 35
    more = with_changes(start("line"), [*changes, "trajectory.target_mm=[22,25,50]", 'tissue.fixed_faces=["x_min"]'])
    assert len(held_of(Scenario.load(more).tissue, mesh_of(tissue))) > 35


def test_regions_hold_what_lies_in_them() -> None:
    assert held_mm(fixed_regions=[BOX])[:, 2].min() >= 110
    np.testing.assert_allclose(held_mm(fixed_regions=[PLANE])[:, 0], 36.0)
    assert np.linalg.norm(held_mm(fixed_regions=[SPHERE]) - [0, 0, 122], axis=1).max() <= 25
    united = held_mm(fixed_regions=[PLANE, SPHERE], fixed_faces=["z_max"])
    assert len(united) > max(len(held_mm(fixed_regions=[one])) for one in (PLANE, SPHERE))
    assert (united[:, 2] == 122).sum() == len(held_mm(fixed_faces=["z_max"]))


def test_a_side_by_its_plane_is_the_side_by_its_name() -> None:
    ends = [{**PLANE, "point_mm": [0, y, 0], "normal": [0, 1, 0]} for y in (0, 62)]
    named = insertion_of(Scenario.load({})).tissue.unknown
    np.testing.assert_array_equal(
        insertion_of(Scenario.load({"tissue": {"fixed_regions": ends}})).tissue.unknown, named
    )


@pytest.mark.parametrize(
    ("regions", "words"),
    [
        ([{"kind": "cube"}], "tissue.fixed_regions[0].kind = 'cube': must be one of box, plane, sphere"),
        ([{}], "tissue.fixed_regions[0].kind = None: is missing; it must be one of box, plane, sphere"),
        ([{"kind": "box"}], "tissue.fixed_regions[0].min_mm = None: is missing"),
        ([BOX, {**SPHERE, "radius": 3}], "tissue.fixed_regions[1].radius = 3: unknown field"),
        ([{**BOX, "max_mm": [1, 1, 1]}], "tissue.fixed_regions[0].max_mm = [1.0, 1.0, 1.0]: must not be below min_mm"),
        ([{**PLANE, "normal": [0, 0, 0]}], "tissue.fixed_regions[0].normal"),
        ([{**SPHERE, "centre_mm": [400, 0, 0]}], "no node of the mesh, which extends from [0, 0, 0] to [36, 62, 122]"),
        ([{**SPHERE, "radius_mm": 900}], "at least one must be free"),
        ([{**SPHERE, "radius_mm": 0.5}], "holds 1 nodes; at least 3 not on a line are needed"),
        ([{**SPHERE, "centre_mm": [18, 31, 0]}], "trajectory.entry_mm = [18.0, 31.0, 0.0]: must not lie on a held"),
    ],
)  # fmt: skip
def test_a_region_that_holds_nothing_or_all_is_refused(regions: list[dict[str, Any]], words: str) -> None:
    assert words in problem({"tissue": {"fixed_regions": regions}})


def test_what_is_held_is_in_the_result() -> None:
    result = run(short(tissue={"fixed_regions": [{**PLANE, "point_mm": [0, 0, 0], "normal": [0, 1, 0]}]})).result()
    assert result["held"]["faces"] == result["held"]["sets"] == []
    assert result["held"]["regions"][0]["kind"] == "plane"
    assert result["held"]["nodes"] == result["solver"]["held_nodes"] > 3


# entries on the surface


def on_mesh(**trajectory: Any) -> dict[str, Any]:
    path = {"entry_mm": [20, 20, 0], "target_mm": [22, 25, 50], **trajectory}
    return {"tissue": {"mesh_file": str(FILES / "nset_union.inp"), "fixed_sets": ["Fixed"]}, "trajectory": path}


@pytest.mark.slow
def test_an_entry_is_moved_to_the_surface_where_that_is_asked_for() -> None:
    """Within the distance, and once: the resolved scenario is the same scenario."""
    snapped = Scenario.load(on_mesh(entry_mm=[20, 20, -3.0], entry_snap_mm=5))
    assert snapped.trajectory.entry_mm == (20.0, 20.0, 0.0)
    assert Scenario.load(snapped.resolved()) == snapped
    assert "[20.0000, 20.0000, 0.0000] does, 3 mm away" in problem(on_mesh(entry_mm=[20, 20, -3.0]))
    assert "3 mm away" in problem(on_mesh(entry_mm=[20, 20, -3.0], entry_snap_mm=2))
    assert "belongs to tissue.mesh_file" in problem({"trajectory": {"entry_snap_mm": 2}})
