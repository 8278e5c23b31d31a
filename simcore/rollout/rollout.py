"""run(scenario, observer) -> Rollout: the one loop that every way of using the simulator goes through."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import cache, cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from threadpoolctl import threadpool_limits

from simcore.controllers import make_controller
from simcore.controllers.plant_model import make_model
from simcore.controllers.remote_centre import rcm_authority
from simcore.episode import CommandError, Episode
from simcore.errors import ControllerError, ModelFailureError, Status
from simcore.insertion.jacobian_fast import Linearisation, lateral_offset
from simcore.metrics import metrics
from simcore.needle.shaft import shaft_polyline
from simcore.needle.stress import largest_strain
from simcore.rollout.records import Observer, Scene, Silent, StepRecord, StepTiming, sealed
from simcore.rollout.result import Rollout
from simcore.rollout.series import SeriesBuilder
from simcore.rotations import quaternion_from_matrix
from simcore.scenario.scenario import Plugin, ReachTrajectory, Remote, Scenario
from simcore.tissue.strain import strain_extremes
from simcore.trajectory import Path, polyline_distance_m

if TYPE_CHECKING:
    from simcore.arrays import Floats
    from simcore.episode import Observation
    from simcore.insertion.insertion import Insertion
    from simcore.insertion.state import Pose
    from simcore.mesh.mesh import MaterialPoints

Clock = Callable[[], float]

SHAFT_POINTS_PER_BEAM = 3
PATH_POINTS_APART_M = 0.5e-3  # in the tissue; the chords of a 1 mm sine over 120 mm then miss it by 0.1 um


@cache
def compile_kernels() -> None:
    """Run eight steps of a tiny insertion (contact, puncture, cutting, steering), once in a process: compiles every
    kernel, or loads it from the cache, so that compilation is in no measured time."""
    small = {
        "name": "warm-up",
        "tissue": {"size_mm": [24, 24, 30], "element_size_mm": 10, "rayleigh_stiffness_s": 0.001, "density_kg_m3": 1},
        "needle": {"length_mm": 60, "elements": 3},
        "trajectory": {"kind": "line", "entry_mm": [12, 12, 0], "target_mm": [12, 12, 4], "speed_mm_s": 50},
    }
    for derivative in ("fast", "exact"):
        scenario = Scenario.load({**small, "controller": {"kind": "ifem", "derivative": derivative}})
        _Loop(scenario, Silent(), time.perf_counter).run()


def run(
    scenario: Scenario | dict[str, Any] | str, observer: Observer | None = None, *, clock: Clock = time.perf_counter
) -> Rollout:
    """Simulate one scenario; the observer sees every step and changes nothing.

    scenario: also as JSON data or text, or by the name of a built-in one. Raises ScenarioError.

    A step that fails ends the run with its named status; the last good state is the last row of the series. Exceptions
    of the observer pass through: that is how a run is cancelled.

    >>> rollout = run(Scenario.load({"tissue": {"element_size_mm": 10}, "trajectory": {"target_mm": [18, 31, 5]}}))
    >>> print(rollout.status, rollout.series["tip_m"].shape, rollout.metrics["rmse_commanded_mm"] < 0.1)
    completed (51, 3) True
    """
    chosen = scenario if isinstance(scenario, Scenario) else Scenario.load(scenario)
    with threadpool_limits(1):
        compile_kernels()
        return _Loop(chosen, observer or Silent(), clock).run()


def material_path(insertion: Insertion, path: Path) -> MaterialPoints:
    """The material points along a path in rest space, at most 0.5 mm apart at rest: a path in the tissue frame."""
    pieces = int(np.ceil(path.length_m / PATH_POINTS_APART_M))
    return insertion.tissue.mesh.material(path.point(np.linspace(0.0, path.length_m, pieces + 1)))


class _Loop:
    """An episode and the controller of its scenario; targets, robot and plant are the episode's."""

    def __init__(self, scenario: Scenario, observer: Observer, clock: Clock) -> None:
        self.scenario, self.observer, self.clock = scenario, observer, clock
        self.episode = episode = Episode(scenario, clock=clock)
        self.insertion, self.path, self.steps = episode.insertion, scenario.path(), episode.steps
        self.model = make_model(scenario, self.insertion, lambda: (episode.before, episode.state))
        self.carried_cross_track_m: list[float] = []
        self.entry_point = self.insertion.tissue.mesh.material(self.insertion.entry_m[None])
        self.response: Linearisation | None = None
        self.jacobian_s = 0.0
        self.controller = make_controller(
            scenario,
            entry_m=self.insertion.entry_m,
            needle_length_m=self.insertion.needle.length_m,
            model=self._timed_model if self.model else None,
        )

    def run(self) -> Rollout:
        """The loop itself; a controller that holds something lets go of it, whatever ends the loop."""
        try:
            return self._run()
        finally:
            if callable(close := getattr(self.controller, "close", None)):
                close(self.episode.status, self.episode.message)

    def _run(self) -> Rollout:
        episode, series = self.episode, SeriesBuilder(self.scene())
        seen = episode.observation
        first = self._record(episode.state.base, seen, StepTiming(0.0, 0.0, 0.0))
        series.add(first, 0.0)
        self.observer.begin(series.scene, first)
        begun = self.clock()
        while not episode.done:
            made = episode.step_number
            seen, command, command_s = self._advance(seen)
            if command is None or episode.step_number == made:
                break
            record = self._record(command, seen, StepTiming(episode.plant_s, self.jacobian_s, command_s))
            started = self.clock()
            self.observer.step(record)
            series.add(record, self.clock() - started)
        rollout = self._finished(series, self.clock() - begun)
        self.observer.end(rollout)
        return rollout

    def _advance(self, seen: Observation) -> tuple[Observation, Pose | None, float]:
        """Ask the controller and step the episode: what is seen then, the command, and the time that it took, s. A
        controller that fails ends the episode."""
        episode = self.episode
        self.response, self.jacobian_s, started = None, 0.0, self.clock()
        try:
            command = self.controller.command(seen)
        except ModelFailureError as failure:
            episode.end(failure.status, f"the controller's model: {failure.message}")
            return seen, None, 0.0
        except ControllerError as error:
            episode.end(Status.CONTROLLER_FAILED, str(error))
            return seen, None, 0.0
        command_s = self.clock() - started - self.jacobian_s
        episode.authority.append(rcm_authority(self.response, seen.base.rotation))
        try:
            seen, _ = episode.step(command, limited=self.controller.limited)
        except CommandError as error:
            episode.end(Status.CONTROLLER_FAILED, f"controller {self._label} answered with {error.problem}")
            return seen, None, 0.0
        if self.path_in_tissue is not None:
            path = self.path_in_tissue.positions(episode.state.bodies.x, self.insertion.tissue.mesh.nodes_m)
            self.carried_cross_track_m.append(polyline_distance_m(episode.state.tip_m, path))
        return seen, command, command_s

    @property
    def _label(self) -> str:
        """What messages call the controller."""
        settings = self.scenario.controller
        return repr(settings.name if isinstance(settings, Plugin | Remote) else settings.kind)

    def _timed_model(self, observation: Observation) -> Linearisation:
        assert self.model is not None
        started = self.clock()
        self.response = self.model(observation)
        self.jacobian_s = self.clock() - started
        return self.response

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
            steps=self.steps,
            tissue_rest_m=mesh.nodes_m.copy(),
            tissue_tets=mesh.tets.copy(),
            surface_triangles=mesh.surface_triangles.copy(),
            held_nodes=np.flatnonzero(self.insertion.tissue.unknown < 0),
            path_m=self.path.curve(np.linspace(0.0, 1.0, 2 if self.path.is_straight else 101)),
            entry_m=self.insertion.entry_m.copy(),
            needle_radius_m=self.insertion.needle.outer_radius_m,
        )
        return sealed(scene)

    def _record(self, command: Pose, seen: Observation, timing: StepTiming) -> StepRecord:
        episode, state, recording = self.episode, self.episode.state, self.scenario.recording
        step = episode.step_number
        base = state.base
        mesh = self.insertion.tissue.mesh
        displacement = state.bodies.x - mesh.nodes_m
        strain = strain_extremes(state.bodies.x, mesh.tets, self.insertion.tissue.gradients)
        offset = lateral_offset(self.insertion.model, state.bodies, state.inserted_m)[0]
        frame = step in (0, self.steps) or (recording.enabled and step % recording.every_steps == 0)
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
            insertion_force_n=float(state.base_wrench[:3] @ base.rotation[:, 2]),
            rcm_error_m=float(np.hypot(*offset)),
            iterations=state.report.iterations,
            residual_n=state.report.residual_n,
            violation_m=state.report.violation_m,
            min_det_f=state.report.min_det_f,
            min_det_f_at_m=mesh.nodes_m[mesh.tets[strain.least_det_tet]].mean(axis=0),
            max_displacement_m=float(np.sqrt((displacement**2).sum(axis=1).max())),
            max_strain=strain.largest_strain,
            entry_drag_m=self._entry_drag_m(),
            needle_stress_pa=self._needle_stress_pa(),
            shaft_m=self._shaft(),
            points_m=state.points_m.copy(),
            point_forces_n=state.point_forces_n.copy(),
            tissue_m=state.bodies.x.copy() if frame else None,
            timing=timing,
        )
        return sealed(record)

    def _entry_drag_m(self) -> float:
        """How far the needle has dragged the tissue at the entry along the surface; the held nodes' motion apart."""
        mesh, inward = self.insertion.tissue.mesh, self.insertion.model.channel.inward
        state = self.episode.state
        place = self.entry_point.positions(state.bodies.x, mesh.nodes_m)[0]
        drag = place - self.insertion.entry_m - self.insertion.held_shift_m(state)
        return float(np.linalg.norm(drag - (drag @ inward) * inward))

    def _needle_stress_pa(self) -> float:
        needle, b = self.insertion.needle, self.episode.state.bodies
        strain = largest_strain(b.needle_x, b.needle_R, needle.section, needle.outer_radius_m)
        return self.scenario.needle.young_gpa * 1e9 * strain

    def _shaft(self) -> Floats:
        needle, b = self.insertion.needle, self.episode.state.bodies
        points = SHAFT_POINTS_PER_BEAM * needle.elements + 1
        return shaft_polyline(b.needle_x, b.needle_R, needle.element_length_m, points)

    def _finished(self, builder: SeriesBuilder, wall_s: float) -> Rollout:
        status, message = self.episode.status, self.episode.message
        series = builder.arrays(self.episode.state.bodies.x, self.episode.authority)
        dt, done = self.scenario.dt_s, len(series["t_s"]) - 1
        return Rollout(
            scenario=self.scenario,
            status=status,
            message=message,
            series=series,
            metrics=metrics(
                status,
                series,
                self.path if self.has_path else None,
                dt_s=dt,
                steps=self.steps,
                success_mm=self.scenario.success_mm,
                yield_mpa=self.scenario.needle.yield_mpa,
                cross_track_m=np.array(self.carried_cross_track_m) if self.carried_cross_track_m else None,
            ),
            timing=builder.timing(wall_s=wall_s, simulated_s=done * dt),
            solver=builder.solver(),
        )
