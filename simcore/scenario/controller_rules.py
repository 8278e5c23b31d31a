"""What a scenario settles and checks of its controller: digests of models, names of plug-ins, what a model has seen."""

from __future__ import annotations

from typing import Any

import numpy as np

from simcore import plugins
from simcore.arrays import Floats
from simcore.errors import Problem
from simcore.scenario.controller_blocks import KINDS, Controller, InverseFem, Learned, Plugin, Replay
from simcore.scenario.held_parts import held_faces_of
from simcore.scenario.pose_file import digest_of_poses, fault_of_poses, load_poses
from simcore.scenario.suggestions import did_you_mean
from simcore.scenario.trajectory_blocks import Guide, Timed

CONDITIONS = ("dt_s", "tissue", "needle", "interaction", "motion")  # fields that a model was trained under
NAMES = ("mesh_file",)  # of files, which their digests tell apart


def with_file_digest(controller: Controller) -> Controller:
    """A controller with the digest of its model or of its poses, which have been read and checked. Raises
    ScenarioError."""
    if isinstance(controller, Replay) and controller.poses is None and controller.poses_file is not None:
        found = digest_of_poses(controller.poses_file, controller.poses_sha256)
        return controller.model_copy(update={"poses_sha256": found})
    if not isinstance(controller, Learned):
        return controller
    from simcore.learning import model_digest

    found = model_digest(controller.kind, controller.model, controller.model_sha256)
    return controller.model_copy(update={"model_sha256": found})


def needs_tissue(controller: Controller) -> bool:
    """Whether the Jacobian that a controller asks for needs the tissue's side of each step: the exact one does."""
    if not isinstance(controller, InverseFem):
        return False
    return controller.jacobian == "constraint" and controller.derivative == "exact"


def poses_of(replay: Replay) -> Floats:
    """(n, 7) x_mm, y_mm, z_mm, qw, qx, qy, qz of the base, one row a step."""
    if replay.poses is not None:
        return np.array(replay.poses)
    assert replay.poses_file is not None
    assert replay.poses_sha256 is not None
    return load_poses(replay.poses_file, replay.poses_sha256)


def pose_count(replay: Replay) -> int:
    """How many poses there are, which is the number of steps; 0 without any."""
    if replay.poses is not None:
        return len(replay.poses)
    return 0 if replay.poses_file is None else len(poses_of(replay))


def pose_problems(controller: Controller) -> list[Problem]:
    """Poses inline as well as from a file, neither, or one that is out of range."""
    if not isinstance(controller, Replay):
        return []
    inline, name = controller.poses, controller.poses_file
    if inline is None:
        if name is None:
            allowed = Replay.model_fields["poses"].description
            message = f"is missing (allowed: {allowed}); or name a file of them in controller.poses_file"
            return [Problem("controller.poses", None, message)]
        return []
    for field in ("poses_file", "poses_sha256"):
        if (value := getattr(controller, field)) is not None:
            return [Problem(f"controller.{field}", value, "must be left out: controller.poses is given too")]
    wrong = fault_of_poses(np.array(inline))
    if wrong is None:
        return []
    row, message = wrong
    return [Problem(f"controller.poses[{row}]", list(inline[row]), message)]


def plugin_problems(controller: Controller) -> list[Problem]:
    """A plug-in that is not installed, or that this process cannot use as it is installed now."""
    if not isinstance(controller, Plugin):
        return []
    known = plugins.installed()
    if controller.name in known:
        problem = plugins.problem_of(controller.name)
        return [] if problem is None else [Problem("controller.name", controller.name, problem)]
    there = f"installed: {', '.join(known)}" if known else "none is installed; see: needlebench example controller"
    meant = did_you_mean(controller.name, [*known, *KINDS.replace(" or ", ", ").split(", ")])
    return [
        Problem("controller.name", controller.name, f"is no controller of the group {plugins.GROUP}; {there}{meant}")
    ]


def training_warnings(controller: Controller, trajectory: Guide, conditions: dict[str, Any]) -> list[str]:
    """Where a learned controller runs outside of what its model was trained on; one line for each field.

    conditions: the scenario's CONDITIONS as JSON data.
    """
    if not isinstance(controller, Learned):
        return []
    from simcore.learning import load_model

    assert controller.model_sha256 is not None
    trained = load_model(controller.kind, controller.model, controller.model_sha256).provenance.get("trained_on")
    if not isinstance(trained, dict):
        return [f"controller.model = {controller.model}: it does not say what it was trained on"]
    differences = [*_block_differences(conditions, trained), *_path_differences(trajectory, trained)]
    return [
        f"{field} = {value}: the model of the controller was trained {known}" for field, value, known in differences
    ]


def _block_differences(now: dict[str, Any], trained: dict[str, Any]) -> list[tuple[str, Any, str]]:
    found = []
    for name, value in now.items():
        before = trained.get(name)
        if name == "tissue" and isinstance(before, dict):
            value, before = _with_held_faces(value), _with_held_faces(before)
        if name == "motion":
            value, before = value["kind"], (before or {}).get("kind", "none")
        if isinstance(value, dict) and isinstance(before, dict):
            changed = {key: v for key, v in value.items() if key not in NAMES and before.get(key, v) != v}
            found += [(f"{name}.{key}", v, f"at {before[key]}") for key, v in changed.items()]
        elif before is not None and value != before:
            found.append((name, value, f"at {before}"))
    return found


def _with_held_faces(tissue: dict[str, Any]) -> dict[str, Any]:
    """A tissue as JSON data with the faces that null stands for."""
    held = {"fixed_sets": [], "fixed_regions": [], **tissue}
    return {**held, "fixed_faces": held_faces_of(held)}


def _path_differences(path: Guide, trained: dict[str, Any]) -> list[tuple[str, Any, str]]:
    before = trained.get("trajectory", {})
    now: dict[str, Any] = {"entry_mm": list(path.entry_mm), "frame": path.frame}
    if isinstance(path, Timed):
        now["speed_mm_s"] = path.speed_mm_s
    found = [(f"trajectory.{k}", v, f"at {before[k]}") for k, v in now.items() if before.get(k, v) != v]
    box = trained.get("path_box_mm")
    if box is None:
        return found
    low, high = box
    if not all(a <= x <= b for a, x, b in zip(low, path.end_mm, high, strict=True)):
        found.append((path.end_field, list(path.end_mm), f"between {low} and {high}"))
    return found
