"""The rules between the fields of a scenario, and the fields that others settle."""

from __future__ import annotations

import math
from typing import TypeVar

from simcore.errors import Problem
from simcore.scenario.blocks import (
    MAXIMUM_CELLS,
    MAXIMUM_STEPS,
    Breathing,
    Interaction,
    Needle,
    Solver,
    Still,
    Tissue,
)
from simcore.scenario.controller_blocks import Controller, InverseFem, Replay
from simcore.scenario.controller_rules import plugin_problems, pose_count, pose_problems
from simcore.scenario.held_parts import block_problems, nothing_held, region_problems
from simcore.scenario.path_rules import length_problems, path_problems
from simcore.scenario.point_rules import point_problems, separate_model
from simcore.scenario.trajectory_blocks import Guide

AnyTrajectory = TypeVar("AnyTrajectory", bound=Guide)


def problems_between(
    *,
    tissue: Tissue,
    needle: Needle,
    interaction: Interaction,
    trajectory: Guide,
    motion: Still | Breathing,
    controller: Controller,
    solver: Solver,
    dt_s: float,
) -> list[Problem]:
    """All that is wrong between the fields of a scenario whose fields are each in range."""
    return [
        *_needle_problems(needle),
        *point_problems(needle, interaction, tissue, separate_model(controller)),
        *_tissue_problems(tissue),
        *(
            path_problems(trajectory, tissue, needle)
            or [*length_problems(trajectory, needle), *_step_problems(steps_along(trajectory, controller, dt_s), dt_s)]
        ),
        *_motion_problems(motion),
        *pose_problems(controller),
        *_delay_problems(controller, dt_s),
        *_derivative_problems(controller, solver),
        *_model_problems(controller, tissue),
        *plugin_problems(controller),
    ]


def steps_along(trajectory: Guide, controller: Controller, dt_s: float) -> int:
    """Number of steps: the replay's poses, or what the trajectory takes."""
    return pose_count(controller) if isinstance(controller, Replay) else trajectory.steps(dt_s)


def delay_steps(controller: Controller, dt_s: float) -> int:
    """Number of steps from a command's making to its execution."""
    return round(controller.delay_s / dt_s)


def with_mesh(tissue: Tissue) -> Tissue:
    """The tissue with digest, size and element size of its mesh file."""
    if tissue.mesh_file is None:
        return tissue
    from simcore.scenario.mesh_rules import fields_of_mesh  # with the mesh kernels: only where there is a mesh file

    return tissue.model_copy(update=fields_of_mesh(tissue))


def with_entry(trajectory: AnyTrajectory, tissue: Tissue) -> AnyTrajectory:
    """The path from the surface of the mesh file, where its entry may be moved there."""
    if tissue.mesh_file is None or trajectory.entry_snap_mm == 0.0:
        return trajectory
    from simcore.scenario.mesh_rules import snapped_entry_mm

    return trajectory.model_copy(update={"entry_mm": snapped_entry_mm(tissue, trajectory)})


def _needle_problems(needle: Needle) -> list[Problem]:
    problems = []
    if needle.inner_diameter_mm >= needle.outer_diameter_mm:
        allowed = f"must be below needle.outer_diameter_mm = {needle.outer_diameter_mm:g}"
        problems.append(Problem("needle.inner_diameter_mm", needle.inner_diameter_mm, allowed))
    return problems


def _tissue_problems(tissue: Tissue) -> list[Problem]:
    problems = region_problems(tissue)
    if len(set(tissue.held_faces)) < len(tissue.held_faces):
        problems.append(Problem("tissue.fixed_faces", list(tissue.held_faces), "must name each face once"))
    if tissue.mesh_file is not None:
        return problems
    if math.prod(tissue.cells) > MAXIMUM_CELLS:
        allowed = f"gives {math.prod(tissue.cells)} cells, at most {MAXIMUM_CELLS} are allowed"
        problems.append(Problem("tissue.element_size_mm", tissue.element_size_mm, allowed))
    problems += nothing_held(tissue)
    for name, unset in (("fixed_sets", ()), ("mesh_unit_mm", 1.0), ("mesh_sha256", None)):
        value = getattr(tissue, name)
        if value != unset:
            allowed = "must be left out: it belongs to tissue.mesh_file, which is not given"
            problems.append(Problem(f"tissue.{name}", value, allowed))
    return problems


def _step_problems(steps: int, dt_s: float) -> list[Problem]:
    if steps <= MAXIMUM_STEPS:
        return []
    return [Problem("dt_s", dt_s, f"gives {steps} steps, at most {MAXIMUM_STEPS} are allowed")]


def _motion_problems(motion: Still | Breathing) -> list[Problem]:
    if isinstance(motion, Breathing) and math.hypot(*motion.direction) < 1e-6:
        return [Problem("motion.direction", list(motion.direction), "must be a vector at least 1e-6 long")]
    return []


def _delay_problems(controller: Controller, dt_s: float) -> list[Problem]:
    nearest_s = delay_steps(controller, dt_s) * dt_s
    if abs(controller.delay_s - nearest_s) <= 1e-6 * dt_s:
        return []
    allowed = f"must be a multiple of dt_s = {dt_s:g} s, from 0 to 1 s; the nearest is {nearest_s:g}"
    return [Problem("controller.delay_s", controller.delay_s, allowed)]


def hold_problems(noise_hold_s: float | None, dt_s: float) -> list[Problem]:
    """A time that noise is held for which is no multiple of the step."""
    if noise_hold_s is None:
        return []
    nearest_s = max(1, round(noise_hold_s / dt_s)) * dt_s
    if abs(noise_hold_s - nearest_s) <= 1e-6 * dt_s:
        return []
    allowed = f"must be a multiple of dt_s = {dt_s:g} s, at most 10 s; the nearest is {nearest_s:g}"
    return [Problem("noise_hold_s", noise_hold_s, allowed)]


def _derivative_problems(controller: Controller, solver: Solver) -> list[Problem]:
    """The exact Jacobian differentiates equations that a linearised step does not fulfil."""
    if solver.mode == "converged" or not isinstance(controller, InverseFem):
        return []
    if (controller.jacobian, controller.derivative) != ("constraint", "exact"):
        return []
    allowed = "must be fast with solver.mode = linearised: it differentiates a converged step"
    return [Problem("controller.derivative", controller.derivative, allowed)]


def _model_problems(controller: Controller, tissue: Tissue) -> list[Problem]:
    model, problems = separate_model(controller), list[Problem]()
    if model is None:
        return problems
    cells = math.prod(tissue.model_copy(update={"element_size_mm": model.element_size_mm}).cells)
    if cells > MAXIMUM_CELLS and tissue.mesh_file is None:
        allowed = f"gives {cells} cells, at most {MAXIMUM_CELLS} are allowed"
        problems.append(Problem("controller.model.element_size_mm", model.element_size_mm, allowed))
    if tissue.mesh_file is None:
        problems += block_problems(tissue.model_copy(update={"element_size_mm": model.element_size_mm}), None)
    return problems
