"""What each number of a result means: unit, definition and the range in which a sane run has it.

A range belongs to a steered insertion at full depth (122 mm) with the default discretisation [ours]. A number outside
its range is not an error: `outside` says what that means, or what to look at before the run is trusted.
"""

from __future__ import annotations

from typing import NamedTuple

UNIT_OF_SUFFIX = {"_mm": "mm", "_m": "m", "_n": "N", "_nm": "N m", "_s": "s", "_ms": "ms", "_mpa": "MPa", "_pa": "Pa"}
UNITS = frozenset({*UNIT_OF_SUFFIX.values(), "1", "J", "yes or no"})


class Metric(NamedTuple):
    """One number of result.json. key: dotted path in it. low, high: inclusive sane range, high None = no bound."""

    key: str
    unit: str
    definition: str
    low: float
    high: float | None
    outside: str

    @property
    def sane_range(self) -> str:
        """The range as text."""
        if self.high is None:
            return f"at least {self.low:g}"
        return f"{self.low:g}" if self.low == self.high else f"{self.low:g} to {self.high:g}"


class SeriesArray(NamedTuple):
    """One array of series.npz. shape: `rows` = steps + 1, row 0 the initial state; frames = recorded tissue states."""

    name: str
    unit: str
    shape: tuple[str, ...]
    definition: str


METRICS = (
    Metric(
        "metrics.stable",
        "yes or no",
        "the run completed: every step converged, every number finite, no tetrahedron inverted; the paper's S is the "
        "share of stable insertions",
        1,
        1,
        "`status` and `message` name the failure; the other numbers cover the steps before it",
    ),
    Metric(
        "metrics.success",
        "yes or no",
        "stable, the tip never more than 2 mm from the target of its command for more than 0.5 s, at most `success_mm` "
        "from the end of the path after the last step, and the needle below `needle.yield_mpa`",
        1,
        1,
        "the target was lost on the way or at the end, or the needle would have yielded",
    ),
    Metric("metrics.steps_completed", "1", "converged steps", 1, None, "the run failed in its first step"),
    Metric(
        "metrics.steps",
        "1",
        "planned steps: ceil(path length / (speed dt)), or the number of poses of a replay",
        1,
        None,
        "",
    ),
    *(
        Metric(f"metrics.{quantity}_{family}_mm", "mm", f"{name} of {text}", 0, high, outside)
        for family, text in (
            (
                "commanded",
                "|e_i|, e_i = n_tip(t_i+1) - n_traj(t_i): the tip after each step against the target that its command "
                "was computed for [paper]",
            ),
            (
                "same_time",
                "|n_tip(t_i) - n_traj(t_i)|, tip and target at the same time: it includes the lag of one step, 0.1 mm "
                "at 10 mm/s and 10 ms",
            ),
        )
        for quantity, name, high, outside in (
            ("rmse", "root mean square over all steps", 1, "the controller does not follow the path"),
            ("p95", "95th percentile", 1, "the error is large for a while"),
            ("max", "largest value", 2, "above 2 mm the target counts as lost while it lasts"),
            ("final", "value after the last completed step", 1, "the tip ends beside its target"),
        )
    ),
    Metric(
        "metrics.cross_track_rmse_mm",
        "mm",
        "root mean square of the distance from the tip to the nearest point of the path; a path in the tissue frame is "
        "carried along first",
        0,
        1,
        "the tip is off the path, not only late on it",
    ),
    Metric(
        "metrics.rcm_mean_mm",
        "mm",
        "mean lateral distance of the shaft from the entry point, the remote centre of motion, which is fixed in space",
        0,
        0.5,
        "the needle drags the entry sideways",
    ),
    Metric(
        "metrics.rcm_max_mm",
        "mm",
        "largest lateral distance of the shaft from the entry point",
        0,
        1,
        "the entry is dragged: a small tip error was paid for there; look at min_det_f",
    ),
    Metric(
        "metrics.entry_drag_mm",
        "mm",
        "largest displacement along the surface of the tissue at the entry, that of the held nodes apart",
        0,
        2,
        "the needle drags the entry sideways; beside it tetrahedra collapse",
    ),
    Metric(
        "metrics.max_push_n",
        "N",
        "largest force of the robot on the needle's base along its axis, positive when it pushes",
        0.1,
        5,
        "below: the needle was never pushed in; above: it is bent so far that the push no longer reaches its tip",
    ),
    Metric(
        "metrics.max_lateral_n",
        "N",
        "largest force of the robot on the needle's base across its axis",
        0,
        2,
        "the needle is steered by force rather than by where it points",
    ),
    Metric(
        "metrics.max_tissue_displacement_mm",
        "mm",
        "largest displacement of a node of the tissue from its place at rest",
        0.5,
        10,
        "below: hardly any contact; above: far beyond small strains, the tissue law is linear",
    ),
    Metric(
        "metrics.max_strain",
        "1",
        "largest |principal stretch - 1| of the tissue over all tetrahedra and steps, in practice beside the needle, "
        "where it grows as the mesh and the spread of the forces shrink",
        0.05,
        0.5,
        "below: hardly any contact; above: far beyond small strains, the tissue law is linear",
    ),
    Metric(
        "metrics.min_det_f",
        "1",
        "smallest determinant of the deformation gradient over all tetrahedra and steps; 1 = no change of volume; at "
        "0.1 and below the run ends as inverted",
        0.5,
        1.0,
        "tetrahedra collapse, mostly beside the entry",
    ),
    Metric(
        "metrics.max_needle_stress_mpa",
        "MPa",
        "largest stress of the needle over all beams and steps: E r kappa of bending plus |N| / A",
        0,
        500,
        "from `needle.yield_mpa` on the needle would stay bent: the run is outside the model and no success",
    ),
    Metric(
        "metrics.lambda_ratio",
        "1",
        "median over steps of sum |lambda_n| / |sum lambda_n|, lateral forces of the constraint points; null where the "
        "lateral load never exceeds 0.01 N",
        1,
        3,
        "neighbouring points fight each other (locking), or lateral forces cancel along a needle that nobody steers",
    ),
    Metric(
        "metrics.limited_fraction",
        "1",
        "share of steps in which the robot's speed limits scaled the command",
        0,
        0.1,
        "the limits decide what the needle does, as they do under target noise (0.9)",
    ),
    *(
        Metric(
            f"timing.{part}.{quantile}_ms",
            "ms",
            f"{name}, {text} over the steps, wall time",
            0,
            high,
            "a busy machine, a finer mesh, or a more expensive Jacobian",
        )
        for part, name, high in (
            ("plant", "solution of the coupled step", 50),
            ("jacobian", "Jacobian of the controller's model, 0 for a controller without one", 50),
            ("command", "command of the controller, its Jacobian apart", 10),
            ("recording", "observers of the run: recording and progress", 50),
        )
        for quantile, text in (
            ("median", "median"),
            ("p95", "95th percentile"),
            ("p99", "99th percentile"),
            ("max", "maximum"),
        )
    ),
    Metric("timing.loop_wall_s", "s", "wall time of all steps, set-up apart", 0, 600, "a busy machine or a fine mesh"),
    Metric("timing.simulated_s", "s", "simulated time: completed steps times dt", 0, None, ""),
    Metric(
        "timing.realtime_factor",
        "1",
        "simulated_s / loop_wall_s; null if no time passed",
        0.1,
        100,
        "below: slower than a tenth of real time",
    ),
    Metric(
        "solver.iterations_mean",
        "1",
        "mean iterations of a coupled step; 0 = the extrapolated state was an equilibrium already",
        0,
        3,
        "the contact state changes in most steps, or the tissue factor is stale",
    ),
    Metric("solver.iterations_max", "1", "most iterations of a step", 0, 30, "a step came close to failing"),
    Metric(
        "solver.residual_max_n",
        "N",
        "largest nodal force residual that a step left",
        0,
        1e-5,
        "only with a larger solver.force_tolerance_n, or with solver.mode = linearised",
    ),
    Metric(
        "solver.violation_max_m",
        "m",
        "largest violation of a constraint that a step left",
        0,
        1e-8,
        "only with a larger solver.violation_tolerance_mm, or with solver.mode = linearised",
    ),
    Metric(
        "solver.held_nodes", "1", "nodes of the tissue that are held still", 3, 1e6, "never: such scenarios are refused"
    ),
)

SERIES = (
    SeriesArray("t_s", "s", ("rows",), "time"),
    SeriesArray("base_position_m", "m", ("rows", "3"), "base of the needle, the robot's end-effector"),
    SeriesArray("base_rotation", "1", ("rows", "4"), "its orientation, quaternion wxyz; identity = needle along +z"),
    SeriesArray("tip_m", "m", ("rows", "3"), "tip of the needle, n_tip"),
    SeriesArray("tip_seen_m", "m", ("rows", "3"), "tip that the controller saw, see `sensing`; in no digest"),
    SeriesArray("target_m", "m", ("rows", "3"), "target without noise, n_traj"),
    SeriesArray("target_noisy_m", "m", ("rows", "3"), "target that the controller saw"),
    SeriesArray("command_position_m", "m", ("rows", "3"), "base position commanded, before delay and limits"),
    SeriesArray("command_rotation", "1", ("rows", "4"), "commanded orientation, quaternion wxyz"),
    SeriesArray("limited", "yes or no", ("rows",), "whether the robot's limits scaled the executed command"),
    SeriesArray("depth_m", "m", ("rows",), "inserted length of the needle, measured along the channel at rest"),
    SeriesArray("base_force_n", "N", ("rows", "3"), "force of the robot on the base"),
    SeriesArray("base_torque_nm", "N m", ("rows", "3"), "torque of the robot about the base"),
    SeriesArray("insertion_force_n", "N", ("rows",), "base force along the base's axis, positive when it pushes"),
    SeriesArray("rcm_error_m", "m", ("rows",), "lateral distance of the shaft from the entry point"),
    SeriesArray("iterations", "1", ("rows",), "iterations of the step"),
    SeriesArray("residual_n", "N", ("rows",), "largest nodal force residual"),
    SeriesArray("violation_m", "m", ("rows",), "largest constraint violation"),
    SeriesArray("min_det_f", "1", ("rows",), "smallest determinant of the deformation gradient"),
    SeriesArray("min_det_f_at_m", "m", ("rows", "3"), "centre at rest of the tetrahedron that has it; not digested"),
    SeriesArray("max_strain", "1", ("rows",), "largest |principal stretch - 1| of the tissue; not digested"),
    SeriesArray("entry_drag_m", "m", ("rows",), "way of the tissue's entry along the surface; not digested"),
    SeriesArray("needle_stress_pa", "Pa", ("rows",), "largest stress of the needle; not digested"),
    SeriesArray("max_displacement_m", "m", ("rows",), "largest displacement of a tissue node"),
    SeriesArray("plant_s", "s", ("rows",), "wall time of the coupled step"),
    SeriesArray("jacobian_s", "s", ("rows",), "wall time of the Jacobian"),
    SeriesArray("command_s", "s", ("rows",), "wall time of the command, its Jacobian apart"),
    SeriesArray("recording_s", "s", ("rows",), "wall time of the observers"),
    SeriesArray("lateral_sum_n", "N", ("rows",), "sum of the magnitudes of the lateral constraint forces"),
    SeriesArray("lateral_resultant_n", "N", ("rows",), "magnitude of the sum of the lateral constraint forces"),
    SeriesArray(
        "rcm_authority",
        "1",
        ("rows", "2", "2"),
        "tip over base, sideways along x and y of its frame, remote centre kept; not digested; NaN where it is unknown",
    ),
    SeriesArray("rcm_sigma_min", "1", ("rows",), "smallest singular value of rcm_authority; not digested"),
    SeriesArray("tissue_rest_m", "m", ("nodes", "3"), "nodes of the tissue at rest"),
    SeriesArray("tissue_tets", "1", ("tetrahedra", "4"), "tetrahedra as rows of node numbers from 0"),
    SeriesArray("tissue_m", "m", ("frames", "nodes", "3"), "nodes in each recorded frame, the last state always one"),
    SeriesArray("tissue_frame_step", "1", ("frames",), "step of each frame"),
    SeriesArray("shaft_m", "m", ("frames", "points", "3"), "axis of the needle from base to tip, three points a beam"),
    SeriesArray("contact_points_m", "m", ("frames", "contacts", "3"), "constraint points; NaN beyond those of a frame"),
    SeriesArray("contact_forces_n", "N", ("frames", "contacts", "3"), "force of the needle on the tissue at each"),
    SeriesArray("strain_energy_j", "J", ("frames",), "elastic energy of the tissue"),
    SeriesArray("max_von_mises_pa", "Pa", ("frames",), "largest von Mises stress of a tetrahedron, damping left out"),
)
