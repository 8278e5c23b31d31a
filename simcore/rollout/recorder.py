"""What is kept of an episode: its scene, a record of each step, the series, and the rollout in the end."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from simcore.insertion.jacobian_fast import lateral_offset
from simcore.linear_algebra.products import dot, norm
from simcore.metrics import metrics
from simcore.needle.shaft import shaft_polyline
from simcore.needle.stress import largest_strain
from simcore.rollout.records import Observer, Scene, StepRecord, StepTiming, sealed
from simcore.rollout.result import Rollout
from simcore.rollout.series import SeriesBuilder
from simcore.rotations import quaternion_from_matrix
from simcore.scenario.scenario import ReachTrajectory
from simcore.tissue.stored import stored
from simcore.tissue.strain import strain_extremes
from simcore.trajectory import Path, polyline_distance_m

if TYPE_CHECKING:
    from collections.abc import Callable

    from simcore.arrays import Floats
    from simcore.episode import Episode, Observation
    from simcore.insertion.insertion import Insertion
    from simcore.insertion.state import Pose
    from simcore.mesh.mesh import MaterialPoints

    Clock = Callable[[], float]

SHAFT_POINTS_PER_BEAM = 3
PATH_POINTS_APART_M = 0.5e-3  # in the tissue; the chords of a 1 mm sine over 120 mm then miss it by 0.1 um


def material_path(insertion: Insertion, path: Path) -> MaterialPoints:
    """The material points along a path in rest space, at most 0.5 mm apart at rest: a path in the tissue frame."""
    pieces = int(np.ceil(path.length_m / PATH_POINTS_APART_M))
    return insertion.tissue.mesh.material(path.point(np.linspace(0.0, path.length_m, pieces + 1)))


class Recorder:
    """Of one episode, from its beginning; the observer sees the same."""

    def __init__(self, episode: Episode, observer: Observer) -> None:
        self.episode, self.observer, self.clock = episode, observer, episode.clock
        self.scenario, self.insertion, self.path = episode.scenario, episode.insertion, episode.scenario.path()
        self.carried_cross_track_m: list[float] = []
        self.entry_point = self.insertion.tissue.mesh.material(self.insertion.entry_m[None])
        self.builder = SeriesBuilder(self.scene())
        self.first = self.record(episode.state.base, episode.observation, StepTiming(0.0, 0.0, 0.0))
        self.builder.add(self.first, 0.0)
        observer.begin(self.builder.scene, self.first)
        self.begun = self.clock()

    def add(self, command: Pose, seen: Observation, timing: StepTiming) -> StepRecord:
        """Keep the state that a step with this command has led to, and show it to the observer."""
        state = self.episode.state
        if self.path_in_tissue is not None:
            path = self.path_in_tissue.positions(state.bodies.x, self.insertion.tissue.mesh.nodes_m)
            self.carried_cross_track_m.append(polyline_distance_m(state.tip_m, path))
        record = self.record(command, seen, timing)
        started = self.clock()
        self.observer.step(record)
        self.builder.add(record, self.clock() - started)
        return record

    def finished(self) -> Rollout:
        """What has been recorded so far, judged as it ended; shown to the observer."""
        status, message, builder = self.episode.status, self.episode.message, self.builder
        series = builder.arrays(replace(self.latest, **self._frame()), self.episode.authority)
        dt, done = self.scenario.dt_s, len(series["t_s"]) - 1
        rollout = Rollout(
            scenario=self.scenario,
            status=status,
            message=message,
            series=series,
            metrics=metrics(
                status,
                series,
                self.path if self.has_path else None,
                dt_s=dt,
                steps=self.episode.steps,
                success_mm=self.scenario.success_mm,
                yield_mpa=self.scenario.needle.yield_mpa,
                cross_track_m=np.array(self.carried_cross_track_m) if self.carried_cross_track_m else None,
            ),
            timing=builder.timing(wall_s=self.clock() - self.begun, simulated_s=done * dt),
            solver=builder.solver(),
        )
        self.observer.end(rollout)
        return rollout

    @property
    def has_path(self) -> bool:
        """Whether there is more to follow than a target."""
        return not isinstance(self.scenario.trajectory, ReachTrajectory)

    @cached_property
    def path_in_tissue(self) -> MaterialPoints | None:
        """The path as the tissue carries it; None if it is fixed in space, or there is none."""
        carried = self.has_path and self.scenario.trajectory.frame == "tissue"
        return material_path(self.insertion, self.path) if carried else None

    def scene(self) -> Scene:
        """What stays the same during the run."""
        mesh = self.insertion.tissue.mesh
        scene = Scene(
            scenario=self.scenario,
            steps=self.episode.steps,
            tissue_rest_m=mesh.nodes_m.copy(),
            tissue_tets=mesh.tets.copy(),
            surface_triangles=mesh.surface_triangles.copy(),
            held_nodes=np.flatnonzero(self.insertion.tissue.unknown < 0),
            path_m=self.path.curve(np.linspace(0.0, 1.0, 2 if self.path.is_straight else 101)),
            entry_m=self.insertion.entry_m.copy(),
            needle_radius_m=self.insertion.needle.outer_radius_m,
        )
        return sealed(scene)

    def record(self, command: Pose, seen: Observation, timing: StepTiming) -> StepRecord:
        """The state as it is now, which `command` led to and which is seen as `seen`."""
        episode, state, recording = self.episode, self.episode.state, self.scenario.recording
        step = episode.step_number
        base = state.base
        mesh = self.insertion.tissue.mesh
        squared = (state.bodies.x - mesh.nodes_m) ** 2
        blocks = self.insertion.workspace.blocks
        strain = strain_extremes(state.bodies.x, blocks.corners, blocks.gradients)
        offset = lateral_offset(self.insertion.model, state.bodies, state.inserted_m)[0]
        frame = step in (0, self.episode.steps) or (recording.enabled and step % recording.every_steps == 0)
        record = StepRecord(
            step=step,
            t_s=step * self.scenario.dt_s,
            base_position_m=base.position_m.copy(),
            base_rotation=quaternion_from_matrix(base.rotation),
            tip_m=state.tip_m.copy(),
            tip_seen_m=seen.tip_m.copy(),
            target_m=episode.targets.clean(step, state.bodies.x).copy(),
            target_noisy_m=seen.target_m.copy(),
            command_position_m=command.position_m.copy(),
            command_rotation=quaternion_from_matrix(command.rotation),
            limited=episode.limited,
            depth_m=state.inserted_m,
            base_force_n=state.base_wrench[:3].copy(),
            base_torque_nm=state.base_wrench[3:].copy(),
            insertion_force_n=dot(state.base_wrench[:3], base.rotation[:, 2]),
            rcm_error_m=norm(offset),
            iterations=state.report.iterations,
            residual_n=state.report.residual_n,
            violation_m=state.report.violation_m,
            min_det_f=state.report.min_det_f,
            min_det_f_at_m=mesh.nodes_m[mesh.tets[strain.least_det_tet]].mean(axis=0),
            max_displacement_m=float(np.sqrt((squared[:, 0] + squared[:, 1] + squared[:, 2]).max())),
            max_strain=strain.largest_strain,
            entry_drag_m=self._entry_drag_m(),
            needle_stress_pa=self._needle_stress_pa(),
            shaft_m=self._shaft(),
            points_m=state.points_m.copy(),
            point_forces_n=state.point_forces_n.copy(),
            timing=timing,
            **(self._frame() if frame else {"tissue_m": None}),
        )
        self.latest = sealed(record)
        return self.latest

    def _frame(self) -> dict[str, Any]:
        """What only frames have, of the state as it is now."""
        tissue, x = self.insertion.tissue, self.episode.state.bodies.x
        energy, von_mises = stored(
            x, tissue.mesh.tets, tissue.gradients, tissue.volumes_m3, tissue.mu_pa, tissue.lambda_pa
        )
        return {"tissue_m": x.copy(), "strain_energy_j": energy, "max_von_mises_pa": von_mises}

    def _entry_drag_m(self) -> float:
        """How far the needle has dragged the tissue at the entry along the surface; the held nodes' motion apart."""
        mesh, inward = self.insertion.tissue.mesh, self.insertion.model.channel.inward
        state = self.episode.state
        place = self.entry_point.positions(state.bodies.x, mesh.nodes_m)[0]
        drag = place - self.insertion.entry_m - self.insertion.held_shift_m(state)
        return norm(drag - dot(drag, inward) * inward)

    def _needle_stress_pa(self) -> float:
        needle, b = self.insertion.needle, self.episode.state.bodies
        strain = largest_strain(b.needle_x, b.needle_R, needle.section, needle.outer_radius_m)
        return self.scenario.needle.young_gpa * 1e9 * strain

    def _shaft(self) -> Floats:
        needle, b = self.insertion.needle, self.episode.state.bodies
        points = SHAFT_POINTS_PER_BEAM * needle.elements + 1
        return shaft_polyline(b.needle_x, b.needle_R, needle.element_length_m, points)
