"""run(scenario, observer) -> Rollout: the one loop that every way of using the simulator goes through."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import cache, cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from threadpoolctl import threadpool_limits

from simcore.controllers import Observation, make_controller
from simcore.controllers.plant_model import make_model, needs_tissue
from simcore.controllers.remote_centre import rcm_authority
from simcore.errors import ModelFailureError, Status
from simcore.insertion.jacobian_fast import Linearisation, lateral_offset
from simcore.metrics import metrics
from simcore.needle.shaft import shaft_polyline
from simcore.needle.stress import largest_strain
from simcore.robot import DelayedCommands, limited_pose
from simcore.rollout.endings import after_failure, after_step
from simcore.rollout.records import Observer, Scene, Silent, StepRecord, StepTiming, sealed
from simcore.rollout.result import Rollout
from simcore.rollout.series import SeriesBuilder
from simcore.rotations import quaternion_from_matrix
from simcore.scenario.build import insertion_of, robot_limits
from simcore.scenario.scenario import Scenario
from simcore.tissue.strain import strain_extremes
from simcore.trajectory import Path, held_noise, polyline_distance_m, targets

if TYPE_CHECKING:
    from simcore.arrays import Floats
    from simcore.insertion.insertion import Insertion
    from simcore.insertion.state import Pose
    from simcore.mesh.mesh import MaterialPoints

Clock = Callable[[], float]

NOISE_HOLD_S = 0.01  # where the scenario names none
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
    """The loop's parts: targets, controller, robot, plant, records."""

    def __init__(self, scenario: Scenario, observer: Observer, clock: Clock) -> None:
        self.scenario, self.observer, self.clock = scenario, observer, clock
        self.insertion = insertion_of(scenario, keeps_tissue=needs_tissue(scenario.controller))
        self.limits = robot_limits(scenario.robot)
        self.path = scenario.path()
        self.steps = scenario.steps
        speed = scenario.trajectory.speed_mm_s * 1e-3
        self.targets_m = targets(self.path, speed_m_s=speed, dt_s=scenario.dt_s, steps=self.steps)
        self.noise_m = held_noise(
            np.random.default_rng(scenario.seed),
            amplitude_m=scenario.noise_mm * 1e-3,
            hold_s=scenario.noise_hold_s or NOISE_HOLD_S,
            dt_s=scenario.dt_s,
            steps=self.steps,
        )
        self.before = self.state = self.insertion.initial_state(self.path.first_tangent())
        self.model = make_model(scenario, self.insertion, lambda: (self.before, self.state))
        self.carried_cross_track_m: list[float] = []
        self.entry_point = self.insertion.tissue.mesh.material(self.insertion.entry_m[None])
        self.response: Linearisation | None = None
        self.authority: list[Floats] = []  # of each state that the controller was asked in, from row 0 on
        self.jacobian_s = 0.0
        self.commands = DelayedCommands(self.state.base, scenario.delay_steps)
        self.controller = make_controller(
            scenario,
            entry_m=self.insertion.entry_m,
            needle_length_m=self.insertion.needle.length_m,
            model=self._timed_model if self.model else None,
        )

    def run(self) -> Rollout:
        """The loop itself."""
        series = SeriesBuilder(self.scene())
        first = self._record(0, self.state.base, False, StepTiming(0.0, 0.0, 0.0))
        series.add(first, 0.0)
        self.observer.begin(series.scene, first)
        status, message = self.state.report.status, self.state.report.message
        begun = self.clock()
        for step in range(self.steps if status is Status.COMPLETED else 0):
            record, status, message = self._advance(step)
            if record is None:
                break
            started = self.clock()
            self.observer.step(record)
            series.add(record, self.clock() - started)
            if status is not Status.COMPLETED:
                break
        rollout = self._finished(series, status, message, self.clock() - begun)
        self.observer.end(rollout)
        return rollout

    def _advance(self, step: int) -> tuple[StepRecord | None, Status, str]:
        """Observe, command, wait for the delay, limit, step; no record if the step failed. A step that converged may
        end the run as well."""
        target = self._target(step)
        observation = Observation(step, self.state.base, self.state.tip_m.copy(), target + self.noise_m[step])
        self.response, self.jacobian_s, started = None, 0.0, self.clock()
        where = f"step {step + 1} of {self.steps}, depth {self.state.inserted_m * 1e3:.1f} mm"
        try:
            command = self.controller.command(observation)
        except ModelFailureError as failure:
            return None, failure.status, f"{where}: the controller's model: {failure.message}"
        command_s = self.clock() - started - self.jacobian_s
        self.authority.append(rcm_authority(self.response, observation.base.rotation))
        base, limited = self.commands.due(command), False
        if self.controller.limited:
            base, limited = limited_pose(self.state.base, base, self.limits, self.scenario.dt_s)
        started = self.clock()
        state = self.insertion.step(self.state, base)
        plant_s = self.clock() - started
        if state.report.status is not Status.COMPLETED:
            error_m = float(np.linalg.norm(observation.tip_m - target))
            status, message = after_failure(self.insertion, self.state, state, error_m, self.authority)
            return None, status, f"{where}: {message}"
        self.before, self.state = self.state, state
        if self.scenario.trajectory.frame == "tissue":
            path = self.path_in_tissue.positions(state.bodies.x, self.insertion.tissue.mesh.nodes_m)
            self.carried_cross_track_m.append(polyline_distance_m(state.tip_m, path))
        timing = StepTiming(plant_s, self.jacobian_s, command_s)
        error_m = float(np.linalg.norm(state.tip_m - target))
        status, message = after_step(self.scenario, self.insertion, state, error_m, self.authority)
        message = f"{where}: {message}" if message else ""
        return self._record(step + 1, command, limited, timing), status, message

    def _timed_model(self, observation: Observation) -> Linearisation:
        assert self.model is not None
        started = self.clock()
        self.response = self.model(observation)
        self.jacobian_s = self.clock() - started
        return self.response

    def _target(self, step: int) -> Floats:
        """n_traj(t_step) (3,) m, world; a path in the tissue frame is carried by the deforming tissue."""
        rest: Floats = self.targets_m[step]
        if self.scenario.trajectory.frame == "world":
            return rest
        return self.insertion.material_point_position(self.state, rest)

    @cached_property
    def path_in_tissue(self) -> MaterialPoints:
        """The path as the tissue carries it."""
        return material_path(self.insertion, self.path)

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

    def _record(self, step: int, command: Pose, limited: bool, timing: StepTiming) -> StepRecord:
        state, recording = self.state, self.scenario.recording
        base = state.base
        mesh = self.insertion.tissue.mesh
        displacement = state.bodies.x - mesh.nodes_m
        strain = strain_extremes(state.bodies.x, mesh.tets, self.insertion.tissue.gradients)
        offset = lateral_offset(self.insertion.model, state.bodies, state.inserted_m)[0]
        target = self._target(step)
        frame = step in (0, self.steps) or (recording.enabled and step % recording.every_steps == 0)
        record = StepRecord(
            step=step,
            t_s=step * self.scenario.dt_s,
            base_position_m=base.position_m.copy(),
            base_rotation=quaternion_from_matrix(base.rotation),
            tip_m=state.tip_m.copy(),
            target_m=target.copy(),
            target_noisy_m=target + self.noise_m[step],
            command_position_m=command.position_m.copy(),
            command_rotation=quaternion_from_matrix(command.rotation),
            limited=limited,
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
        place = self.entry_point.positions(self.state.bodies.x, mesh.nodes_m)[0]
        drag = place - self.insertion.entry_m - self.insertion.held_shift_m(self.state)
        return float(np.linalg.norm(drag - (drag @ inward) * inward))

    def _needle_stress_pa(self) -> float:
        needle, b = self.insertion.needle, self.state.bodies
        strain = largest_strain(b.needle_x, b.needle_R, needle.section, needle.outer_radius_m)
        return self.scenario.needle.young_gpa * 1e9 * strain

    def _shaft(self) -> Floats:
        needle, b = self.insertion.needle, self.state.bodies
        points = SHAFT_POINTS_PER_BEAM * needle.elements + 1
        return shaft_polyline(b.needle_x, b.needle_R, needle.element_length_m, points)

    def _finished(self, builder: SeriesBuilder, status: Status, message: str, wall_s: float) -> Rollout:
        series = builder.arrays(self.state.bodies.x, self.authority)
        dt, done = self.scenario.dt_s, len(series["t_s"]) - 1
        return Rollout(
            scenario=self.scenario,
            status=status,
            message=message,
            series=series,
            metrics=metrics(
                status,
                series,
                self.path,
                dt_s=dt,
                steps=self.steps,
                success_mm=self.scenario.success_mm,
                yield_mpa=self.scenario.needle.yield_mpa,
                cross_track_m=np.array(self.carried_cross_track_m) if self.carried_cross_track_m else None,
            ),
            timing=builder.timing(wall_s=wall_s, simulated_s=done * dt),
            solver=builder.solver(),
        )
