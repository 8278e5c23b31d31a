"""Tissue that is no box: a cylinder held at its ends and entered from the side, with a curved surface."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import meshio
import numpy as np
import pytest
from numpy.typing import NDArray

from simcore.controllers.plant_model import Separate
from simcore.errors import ScenarioError, Status
from simcore.insertion.jacobian_exact import linearise_exactly
from simcore.insertion.jacobian_perturbation import Perturbation
from simcore.mesh.mesh import box_mesh
from simcore.rollout.rollout import run
from simcore.scenario.build import insertion_of
from simcore.scenario.scenario import InverseFem, Scenario, SeparateModel
from tests.simcore.block import TIGHT, moved

if TYPE_CHECKING:
    from pathlib import Path

    from simcore.insertion.insertion import Insertion

Vector = NDArray[np.float64]


def cylinder(folder: Path) -> Path:
    """Radius 30 mm, y from 5 to 85 mm: a square bar, mapped; the ends carry the array `ends` = 1 and 2."""
    bar = box_mesh(np.array([2.0, 2.0, 1.0]), (4, 4, 6))
    across, along = bar.nodes_m[:, :2] - 1.0, bar.nodes_m[:, 2]
    radius = np.abs(across).max(axis=1, keepdims=True)
    round_ = across * radius / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-30)
    points = np.column_stack([30 * round_[:, 0], 5 + 80 * along, 30 * round_[:, 1]])
    ends = np.where(along == 0.0, 1, np.where(along == 1.0, 2, 0))
    meshio.Mesh(points, [("tetra", bar.tets)], point_data={"ends": ends}).write(folder / "cylinder.vtk")
    return folder / "cylinder.vtk"


def cylinder_fields(folder: Path, **blocks: dict[str, Any]) -> dict[str, Any]:
    """Held at both ends, entered from below near the middle, 40 mm deep."""
    data: dict[str, Any] = {
        "tissue": {"mesh_file": str(cylinder(folder)), "fixed_sets": ["ends"]},
        "trajectory": {"entry_mm": [0.0, 45.0, -30.0], "target_mm": [4.0, 48.0, 10.0], "speed_mm_s": 20.0},
        "needle": {"length_mm": 90.0, "elements": 8},
        "interaction": {"spacing_mm": 14.0},
    }
    for name, values in blocks.items():
        data[name] = {**data.get(name, {}), **values}
    return data


@pytest.mark.slow
@pytest.mark.parametrize("frame", ["world", "tissue"])
def test_a_cylinder_runs(tmp_path: Path, frame: str) -> None:
    """Curved surface, entry from the side; the tip comes to the target, every step converged; twice the same."""
    scenario = Scenario.load(cylinder_fields(tmp_path, trajectory={"frame": frame}))
    assert scenario.tissue.size_mm == pytest.approx((60.0, 80.0, 60.0))
    rollout = run(scenario)
    assert rollout.status is Status.COMPLETED, rollout.message
    assert rollout.metrics["rmse_commanded_mm"] < (0.05 if frame == "world" else 1.0)
    assert rollout.series["depth_m"][-1] > 0.035
    assert rollout.digest == run(scenario).digest


@pytest.mark.slow
def test_a_cylinder_breathes(tmp_path: Path) -> None:
    motion = {"kind": "breathing", "amplitude_mm": 3.0, "period_s": 2.0, "direction": [0.0, 0.0, 1.0]}
    rollout = run(Scenario.load(cylinder_fields(tmp_path, motion=motion, trajectory={"frame": "tissue"})))
    assert rollout.metrics["success"]


@pytest.mark.slow
def test_a_separate_model_has_the_mesh_too(tmp_path: Path) -> None:
    """Its element size is that of the file; only material and friction are its own."""
    controller = {"kind": "ifem", "model": {"kind": "separate", "young_kpa": 4.0}}
    scenario = Scenario.load(cylinder_fields(tmp_path, controller=controller))
    assert isinstance(scenario.controller, InverseFem)
    model = scenario.controller.model
    assert isinstance(model, SeparateModel)
    assert model.element_size_mm == scenario.tissue.element_size_mm
    own = Separate(scenario, scenario.controller, model).insertion
    np.testing.assert_array_equal(own.tissue.mesh.nodes_m, insertion_of(scenario).tissue.mesh.nodes_m)
    assert own.tissue.mu_pa == pytest.approx(4000.0 / 2.8)
    assert Scenario.load(scenario.resolved()) == scenario


def slanted_contact(folder: Path, normal: Vector) -> Insertion:
    """Entry in the middle of a triangle with the given normal; a skin too tough to be punctured."""
    entry = np.array([-24.3640, 43.7, -16.8416])
    return insertion_of(
        Scenario.load(
            cylinder_fields(
                folder,
                trajectory={"entry_mm": entry.tolist(), "target_mm": (entry + 20 * normal).tolist()},
                interaction={"puncture_n": 5.0},
                solver=TIGHT,
            )
        )
    )


def test_contact_on_a_slanted_surface(tmp_path: Path) -> None:
    """Before puncture, 54 degrees from z, in the surface's own frame: it sticks below mu times the normal force, slips
    at it, comes off; each time the exact Jacobian is that of differences (one-sided: first order where it slips)."""
    normal = np.array([0.8112421896, 0.0, 0.5847102849])
    insertion = slanted_contact(tmp_path, normal)
    np.testing.assert_allclose(insertion.model.channel.inward, normal, atol=1e-8)
    state = insertion.initial_state(normal)
    start, across = state.base, insertion.model.surface_frame[0]
    assert abs(across @ normal) < 1e-8
    for push, aside, slips, tolerance in [
        (6e-4, 1e-5, False, 1e-4),
        (6e-4, 8e-4, True, 5e-3),
        (-1e-3, 0.0, False, 1e-4),
    ]:
        before, state = state, insertion.step(state, moved(start, push * normal + aside * across))
        force = state.point_forces_n[0]
        pressure = force @ normal
        lateral = float(np.linalg.norm(force - pressure * normal))
        assert (pressure > 0.05) == (push > 0.0)
        assert lateral == pytest.approx(0.1 * pressure, rel=1e-6) if slips else lateral <= 0.1 * pressure + 1e-12
        differences = Perturbation(insertion, shift_m=5e-6, lever_arm_m=0.1).linearise(before, state).tip
        np.testing.assert_allclose(linearise_exactly(insertion.model, state.solved).tip, differences, atol=tolerance)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("blocks", "field", "words"),
    [
        ({"trajectory": {"entry_mm": [0.0, 45.0, -29.0]}}, "trajectory.entry_mm", "must lie on the mesh's surface"),
        ({"trajectory": {"entry_mm": [0.0, 5.0, 1.0]}}, "trajectory.entry_mm", "held part"),
        ({"trajectory": {"target_mm": [0.0, 45.0, -60.0]}}, "trajectory.target_mm", "leads out"),
        ({"trajectory": {"target_mm": [0.0, 45.0, 35.0]}}, "trajectory.target_mm", "the path leaves it at"),
        ({"trajectory": {"target_mm": [0.0, 45.0, -30.0]}}, "trajectory.target_mm", "at least 0.1"),
        ({"trajectory": {"kind": "sine", "direction": [4.0, 3.0, 40.0]}}, "trajectory.direction", "across the path"),
        ({"tissue": {"fixed_sets": ["top"]}}, "tissue.fixed_sets", "is not in cylinder.vtk, which has ends=NUMBER"),
        ({"tissue": {"fixed_sets": ["ends=3"]}}, "tissue.fixed_sets", "is empty"),
        ({"tissue": {"fixed_sets": [], "fixed_faces": []}}, "tissue.fixed_faces", "must name a face"),
        ({"tissue": {"fixed_sets": [], "fixed_faces": ["x_min"]}}, "tissue.fixed_faces", "flat: y_min, y_max"),
        ({"tissue": {"mesh_sha256": "0" * 64}}, "tissue.mesh_file", "has changed"),
        (
            {
                "controller": {"kind": "ifem", "model": {"kind": "separate", "spacing_mm": 8.0}},
                "interaction": {"line_compliance": False},
            },
            "controller.model.spacing_mm",
            "controller.model.element_size_mm = 13.1815",
        ),
        (
            {"interaction": {"spacing_mm": 8.0, "line_compliance": False}},
            "interaction.spacing_mm",
            "lock",
        ),
        ({"needle": {"length_mm": 50.0}}, "needle.length_mm", "stand-off"),
    ],
)
def test_what_does_not_fit_to_the_mesh_is_refused(
    tmp_path: Path, blocks: dict[str, dict[str, Any]], field: str, words: str
) -> None:
    with pytest.raises(ScenarioError) as refused:
        Scenario.load(cylinder_fields(tmp_path, **blocks))
    problems = refused.value.problems
    assert [problem.field for problem in problems] == [field]
    assert words in problems[0].message
