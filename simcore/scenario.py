"""The frozen, validated description of one insertion: JSON in, JSON out. The only place where a default stands.

Each field's description ends with the tag of its default: [paper] Perrusi et al. 2021, [cited] a published source,
[ours] our choice because no source states it. A default never changes within a schema version.
"""

from __future__ import annotations

import json
import math
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    StringConstraints,
    ValidationError,
    ValidationInfo,
    model_validator,
)

from simcore.errors import Problem, ScenarioError
from simcore.trajectory import Path, step_count
from simcore.validation import problems_of

SCHEMA: Literal["needlebench/scenario/1"] = "needlebench/scenario/1"
MINIMUM_SPACING_MM = 5.0
STAND_OFF_MM = 20.0
MINIMUM_DEPTH_MM = 0.1
MAXIMUM_CELLS = 200_000
MAXIMUM_STEPS = 1_000_000

Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Triple = tuple[Number, Number, Number]
Component = Annotated[Number, Field(ge=-1000, le=1000)]
SetName = Annotated[str, StringConstraints(min_length=1, max_length=100)]
Face = Literal["x_min", "x_max", "y_min", "y_max", "z_max"]


class Block(BaseModel):
    """Common rules: frozen, unknown fields refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, hide_input_in_errors=True)


def bounded(default: float, low: float, high: float, text: str) -> Any:
    """A number field with its inclusive range."""
    return Field(default=default, ge=low, le=high, description=f"{text}; {low:g} to {high:g}")


class Tissue(Block):
    """Soft tissue, co-rotational linear elasticity: the block [0, size], entered at z = 0, or a mesh from a file."""

    size_mm: tuple[
        Annotated[Number, Field(ge=10, le=500)],
        Annotated[Number, Field(ge=10, le=500)],
        Annotated[Number, Field(ge=10, le=500)],
    ] = Field(
        default=(36.0, 62.0, 122.0),
        description="edges x, y, z, each 10 to 500; with mesh_file, those of its bounding box replace them [paper]",
    )
    element_size_mm: Number = bounded(
        6.0, 1.0, 50.0, "edge of a cell of six tetrahedra; with mesh_file, its mean element replaces it [ours]"
    )
    young_kpa: Number = bounded(6.3, 0.1, 1000.0, "Young's modulus [paper]")
    poisson: Number = bounded(0.4, 0.0, 0.49, "Poisson's ratio [paper]")
    density_kg_m3: Number = bounded(0.0, 0.0, 20_000.0, "mass density; 0 = quasi-static [ours]; tissue 1000 [cited]")
    rayleigh_mass_per_s: Number = bounded(0.0, 0.0, 1000.0, "alpha of the damping C = alpha M + beta K [ours]")
    rayleigh_stiffness_s: Number = bounded(0.0, 0.0, 10.0, "beta of the damping C = alpha M + beta K [ours]")
    fixed_faces: tuple[Face, ...] = Field(
        default=("y_min", "y_max"),
        description="faces held still, one or more of x_min, x_max, y_min, y_max, z_max (z = 0 is the entry); with "
        "mesh_file, flat sides of its bounding box, by default none where fixed_sets names some [ours]",
    )
    fixed_sets: tuple[SetName, ...] = Field(
        default=(),
        max_length=100,
        description="held parts of mesh_file by name: node set, cell set, physical group, array or array=number [ours]",
    )
    mesh_file: Annotated[str, StringConstraints(min_length=1, max_length=1000)] | None = Field(
        default=None,
        description="linear tetrahedra in a .msh, .vtu, .vtk, .mesh or .inp file instead of the block [ours]",
    )
    mesh_unit_mm: Number = bounded(1.0, 1e-3, 1e4, "unit of length of mesh_file; 1 = mm, 1000 = m [ours]")
    mesh_sha256: Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")] | None = Field(
        default=None,
        description="SHA-256 of mesh_file, 64 hexadecimal digits; null = that of the file now [ours]",
    )

    @model_validator(mode="after")
    def _take_mesh(self, info: ValidationInfo) -> Self:
        """From a mesh file: digest, size, element size; refused without being looked at where files are not allowed."""
        if self.mesh_file is None:
            return self
        from simcore.mesh_checks import fields_of_mesh

        if not (info.context or {}).get("files", True):
            refused = "names a file on this machine, which is not accepted here: run it with the command line"
            raise ScenarioError([Problem("tissue.mesh_file", self.mesh_file, refused)])
        for name, value in fields_of_mesh(self).items():
            object.__setattr__(self, name, value)
        return self

    @property
    def cells(self) -> tuple[int, int, int]:
        """Cells along x, y, z: round(size / element_size), at least 1."""
        x, y, z = (max(1, round(edge / self.element_size_mm)) for edge in self.size_mm)
        return x, y, z


class Needle(Block):
    """Straight elastic tube; the base is held by the robot."""

    length_mm: Number = bounded(180.0, 20.0, 1000.0, "base to tip [ours]")
    outer_diameter_mm: Number = bounded(1.27, 0.1, 5.0, "18G [cited]")
    inner_diameter_mm: Number = bounded(0.838, 0.0, 5.0, "18G [cited]; below the outer diameter, 0 = solid")
    young_gpa: Number = bounded(200.0, 0.1, 500.0, "Young's modulus, stainless steel [cited]")
    poisson: Number = bounded(0.29, 0.0, 0.49, "Poisson's ratio, stainless steel [cited]")
    elements: Annotated[int, Field(strict=True)] = Field(default=20, ge=2, le=200, description="beams; 2 to 200 [ours]")


class Interaction(Block):
    """Forces between needle and tissue."""

    spacing_mm: Number | None = Field(
        default=None,
        ge=MINIMUM_SPACING_MM,
        le=50.0,
        description="rest distance of shaft constraint points; 5 to 50, not below tissue.element_size_mm; "
        "null = max(5, tissue.element_size_mm) [ours]",
    )
    spread_mm: Number = bounded(
        4.0,
        0.0,
        20.0,
        "radius of the ball over which a point force is spread, 0 = bare point, else at least 0.1 [ours]",
    )
    friction: Number = bounded(0.1, 0.0, 1.0, "Coulomb coefficient; above 0.3 with a warning [ours]")
    adhesion_n_per_mm: Number = bounded(
        0.01, 0.0, 1.0, "shaft force per inserted length, without pressure [cited, weak]"
    )
    cutting_n: Number = bounded(0.1, 0.0, 10.0, "axial force at which the tip cuts [ours]")
    puncture_n: Number = bounded(0.1, 0.0, 10.0, "normal force at which the surface is punctured [ours]")


class StraightTrajectory(Block):
    """A target that slides along a straight line."""

    kind: Literal["line"] = Field(default="line", description="line or sine")
    entry_mm: Triple = Field(
        default=(18.0, 31.0, 0.0), description="on the face z = 0, inside its edges; on the surface of mesh_file [ours]"
    )
    target_mm: Triple = Field(
        default=(18.0, 31.0, 122.0), description="inside the block, at least 0.1 below the face z = 0 [paper: z = 122]"
    )
    speed_mm_s: Number = bounded(10.0, 0.1, 1000.0, "speed of the target along the path [paper]")
    frame: Literal["world", "tissue"] = Field(
        default="world",
        description="world = path fixed in space, tissue = path carried by the deforming tissue [ours]",
    )

    def path(self) -> Path:
        """The path in rest space, metres."""
        return Path(np.array(self.entry_mm) * 1e-3, np.array(self.target_mm) * 1e-3)


class SineTrajectory(StraightTrajectory):
    """The straight line with a sine overlay across it."""

    kind: Literal["sine"] = Field(default="sine", description="line or sine")  # type: ignore[assignment]
    amplitude_mm: Number = bounded(1.0, 0.0, 20.0, "amplitude of the overlay [ours]")
    periods: Number = bounded(1.0, 0.1, 10.0, "periods over the whole path [paper: one]")
    direction: tuple[Component, Component, Component] = Field(
        default=(1.0, 0.0, 0.0),
        description="world vector of any length, made perpendicular to the path; each -1000 to 1000 [paper: +-x, +-y]",
    )

    def path(self) -> Path:
        """The path in rest space, metres."""
        return Path(
            np.array(self.entry_mm) * 1e-3,
            np.array(self.target_mm) * 1e-3,
            self.amplitude_mm * 1e-3,
            self.periods,
            np.array(self.direction),
        )


class Still(Block):
    """The held nodes stay where they are."""

    kind: Literal["none"] = Field(default="none", description="none or breathing")


class Breathing(Block):
    """The held nodes move by amplitude (1 - cos(2 pi t / period)) along the direction: from rest to twice the
    amplitude and back."""

    kind: Literal["breathing"] = Field(default="breathing", description="none or breathing")
    amplitude_mm: Number = bounded(6.0, 0.0, 50.0, "half of the peak-to-peak excursion [cited: 12 mm peak to peak]")
    period_s: Number = bounded(4.0, 0.5, 60.0, "time of one breath [cited: 0.25 Hz]")
    direction: tuple[Component, Component, Component] = Field(
        default=(0.0, 0.0, 1.0), description="world vector of any length but 0; each -1000 to 1000 [ours]"
    )


class Robot(Block):
    """Speed limits of the end-effector; a limited command is scaled by one factor for the whole twist."""

    max_speed_mm_s: Number = bounded(50.0, 0.1, 1000.0, "translation [ours]")
    max_turn_deg_s: Number = bounded(30.0, 0.1, 3600.0, "rotation [ours]")


class SharedModel(Block):
    """The model that is linearised is the plant itself [paper]."""

    kind: Literal["shared"] = Field(default="shared", description="shared or separate")


class SeparateModel(Block):
    """The controller steps an insertion of its own with the executed base poses; all else is as in the plant."""

    kind: Literal["separate"] = Field(default="separate", description="shared or separate")
    young_kpa: Number = bounded(6.3, 0.1, 1000.0, "Young's modulus of the model [paper]")
    poisson: Number = bounded(0.4, 0.0, 0.49, "Poisson's ratio of the model [paper]")
    element_size_mm: Number = bounded(
        6.0, 1.0, 50.0, "edge of a cell of the model's mesh; with tissue.mesh_file, the model has that mesh too [ours]"
    )
    friction: Number = bounded(0.1, 0.0, 1.0, "Coulomb coefficient of the model; above 0.3 with a warning [ours]")
    spacing_mm: Number | None = Field(
        default=None,
        ge=MINIMUM_SPACING_MM,
        le=50.0,
        description="rest distance of the model's constraint points; its element size to 50, at least 5; "
        "null = the larger of interaction.spacing_mm and its element size [ours]",
    )


IfemModel = Annotated[SharedModel | SeparateModel, Field(discriminator="kind")]


class InverseFem(Block):
    """Inverse finite element controller: T = X - J^+ (k o e), objectives tip and remote centre of motion [paper]."""

    kind: Literal["ifem"] = Field(default="ifem", description="ifem, replay or open_loop")
    gain: Number = bounded(1.0, 0.0, 2.0, "k of the three tip objectives [ours]")
    rcm_gain: Number = bounded(1.0, 0.0, 2.0, "k of the two remote-centre objectives; 0 = rows left out [ours]")
    damping: Number = bounded(0.05, 1e-4, 10.0, "d of J^T (J J^T + d^2 I)^-1, dimensionless [ours]")
    lever_arm_mm: Number = bounded(
        100.0, 1.0, 1000.0, "length that makes rotations comparable with translations [ours]"
    )
    jacobian: Literal["constraint", "perturbation"] = Field(
        default="constraint",
        description="constraint = implicit differentiation of the converged step, "
        "perturbation = one re-solve of the last step per end-effector dof [cited]",
    )
    derivative: Literal["fast", "exact"] = Field(
        default="fast",
        description="form of the constraint Jacobian; fast drops slopes of frames and of the tissue's stiffness [ours]",
    )
    perturbation_mm: Number = bounded(
        0.05, 0.05, 1.0, "move of each dof for the perturbation Jacobian; rotations by the lever arm [ours]"
    )
    model: IfemModel = Field(default=SharedModel(), description="what is linearised [paper: shared]")

    @model_validator(mode="before")
    @classmethod
    def _default_kind(cls, data: Any) -> Any:
        """A model without a kind is the shared one."""
        if isinstance(data, dict) and isinstance(data.get("model"), dict):
            return {**data, "model": {"kind": "shared", **data["model"]}}
        return data


class Replay(Block):
    """Prescribed base poses, one a step, not filtered by the robot limits."""

    kind: Literal["replay"] = Field(default="replay", description="ifem, replay or open_loop")
    poses: tuple[tuple[Number, Number, Number, Number, Number, Number, Number], ...] = Field(
        min_length=1,
        max_length=MAXIMUM_STEPS,
        description="1 to 1000000 poses [x_mm, y_mm, z_mm, qw, qx, qy, qz] of the base: positions within +-10000, unit "
        "quaternions; identity = needle along +z, tip at base + length z",
    )


class OpenLoop(Block):
    """The rigid needle's motion along the straight line from entry to target; no feedback."""

    kind: Literal["open_loop"] = Field(default="open_loop", description="ifem, replay or open_loop")


class Solver(Block):
    """When a coupled step counts as converged. Results must not depend on it: see the convergence tests."""

    force_tolerance_n: Number = bounded(1e-5, 1e-12, 1e-2, "largest nodal force residual [ours]")
    violation_tolerance_mm: Number = bounded(1e-5, 1e-10, 1e-1, "largest constraint violation [ours]")
    max_iterations: Annotated[int, Field(strict=True)] = Field(
        default=60,
        ge=1,
        le=10_000,
        description="iterations of a step before it is a failure; 1 to 10000 [ours]",
    )


class Recording(Block):
    """What is kept for looking at; it never changes the simulation."""

    enabled: Annotated[bool, Field(strict=True)] = Field(
        default=True, description="write recording.rrd and tissue frames"
    )
    every_steps: Annotated[int, Field(strict=True)] = Field(
        default=10, ge=1, le=10_000, description="steps between two tissue frames; 1 to 10000 [ours]"
    )


Trajectory = Annotated[StraightTrajectory | SineTrajectory, Field(discriminator="kind")]
Motion = Annotated[Still | Breathing, Field(discriminator="kind")]
Controller = Annotated[InverseFem | Replay | OpenLoop, Field(discriminator="kind")]
Name = Annotated[str, StringConstraints(min_length=1, max_length=100, pattern=r"^[\w .,:+()/-]+$")]


class Scenario(Block):
    """One insertion. `Scenario.load` turns any JSON value into one, or says what is wrong with it."""

    model_config = ConfigDict(extra="forbid", frozen=True, hide_input_in_errors=True, serialize_by_alias=True)

    schema_id: Literal["needlebench/scenario/1"] = Field(
        default=SCHEMA, alias="schema", description="version of this format"
    )
    name: Name = Field(default="unnamed", description="1 to 100 letters, digits, spaces and . , : + ( ) / - _")
    seed: Annotated[int, Field(strict=True)] = Field(default=0, ge=0, le=2**53 - 1, description="0 to 2^53 - 1")
    dt_s: Number = bounded(0.01, 1e-4, 0.1, "time step [ours]")
    noise_mm: Number = bounded(
        0.0, 0.0, 5.0, "uniform noise of the target per axis, redrawn every 10 ms [paper: 0.25 in training]"
    )
    tissue: Tissue = Field(default=Tissue(), description="the soft block")
    needle: Needle = Field(default=Needle(), description="the flexible tube that the robot holds")
    interaction: Interaction = Field(default=Interaction(), description="forces between needle and tissue")
    trajectory: Trajectory = Field(default=StraightTrajectory(), description="what the tip is asked to follow")
    motion: Motion = Field(default=Still(), description="how the held nodes of the tissue move")
    robot: Robot = Field(default=Robot(), description="speed limits of the needle's base")
    controller: Controller = Field(default=InverseFem(), description="what steers the base")
    solver: Solver = Field(default=Solver(), description="when a step counts as converged")
    recording: Recording = Field(default=Recording(), description="what is kept for looking at")

    @model_validator(mode="before")
    @classmethod
    def _default_kinds(cls, data: Any) -> Any:
        """A block without a kind is of the default kind."""
        if not isinstance(data, dict):
            return data
        kinds = {"trajectory": "line", "controller": "ifem", "motion": "none"}
        absent = {k: v for k, v in kinds.items() if isinstance(data.get(k), dict) and "kind" not in data[k]}
        return {**data, **{block: {"kind": kind, **data[block]} for block, kind in absent.items()}}

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.interaction.spacing_mm is None:
            spacing = max(MINIMUM_SPACING_MM, self.tissue.element_size_mm)
            object.__setattr__(self, "interaction", self.interaction.model_copy(update={"spacing_mm": spacing}))
        if isinstance(self.controller, InverseFem) and isinstance(self.controller.model, SeparateModel):
            controller = self.controller.model_copy(update={"model": _with_spacing(self.controller.model, self)})
            object.__setattr__(self, "controller", controller)
        problems = [
            *_needle_problems(self),
            *_tissue_problems(self),
            *_path_problems(self),
            *_motion_problems(self),
            *_pose_problems(self),
            *_model_problems(self),
        ]
        if problems:
            raise ScenarioError(problems)
        return self

    @classmethod
    def load(cls, data: Any, *, files: bool = True) -> Scenario:
        """Validate a JSON value (dict) or a JSON text. Raises ScenarioError, which names every wrong field.

        files: whether a scenario may name files of this machine; if not, they are refused and never opened.
        """
        try:
            if isinstance(data, bytes):
                data = data.decode(json.detect_encoding(data))  # a redirected PowerShell writes UTF-16
            text = data if isinstance(data, str) else json.dumps(data)
        except (TypeError, ValueError, RecursionError) as error:
            raise ScenarioError([Problem("scenario", type(data).__name__, f"is not JSON: {error}")]) from None
        try:
            return cls.model_validate_json(text, context={"files": files})
        except ValidationError as error:
            raise ScenarioError(problems_of(error, cls, text)) from None

    def resolved(self) -> dict[str, Any]:
        """Every field with its value, as JSON data."""
        data: dict[str, Any] = self.model_dump(mode="json", by_alias=True)
        return data

    def path(self) -> Path:
        """The path in rest space, metres."""
        return self.trajectory.path()

    @property
    def steps(self) -> int:
        """Number of steps: the replay's poses, or ceil(path length / (speed dt))."""
        if isinstance(self.controller, Replay):
            return len(self.controller.poses)
        return step_count(self.path().length_m, self.trajectory.speed_mm_s * 1e-3, self.dt_s)

    def warnings(self) -> list[str]:
        """What is allowed but unusual."""
        frictions = {"interaction.friction": self.interaction.friction}
        if isinstance(self.controller, InverseFem) and isinstance(self.controller.model, SeparateModel):
            frictions["controller.model.friction"] = self.controller.model.friction
        return [
            f"{field} = {value}: above 0.3 the friction law is far from associated"
            for field, value in frictions.items()
            if value > 0.3
        ]


def _needle_problems(s: Scenario) -> list[Problem]:
    needle, spacing = s.needle, s.interaction.spacing_mm
    problems = []
    if needle.inner_diameter_mm >= needle.outer_diameter_mm:
        allowed = f"must be below needle.outer_diameter_mm = {needle.outer_diameter_mm:g}"
        problems.append(Problem("needle.inner_diameter_mm", needle.inner_diameter_mm, allowed))
    if spacing is not None and spacing < s.tissue.element_size_mm:
        allowed = f"must be at least tissue.element_size_mm = {s.tissue.element_size_mm:g}, closer rows lock; or null"
        problems.append(Problem("interaction.spacing_mm", spacing, allowed))
    if 0.0 < s.interaction.spread_mm < 0.1:
        problems.append(Problem("interaction.spread_mm", s.interaction.spread_mm, "must be 0 or 0.1 to 20"))
    return problems


def _tissue_problems(s: Scenario) -> list[Problem]:
    problems = []
    if len(set(s.tissue.fixed_faces)) < len(s.tissue.fixed_faces):
        problems.append(Problem("tissue.fixed_faces", list(s.tissue.fixed_faces), "must name each face once"))
    if s.tissue.mesh_file is not None:
        return problems
    if math.prod(s.tissue.cells) > MAXIMUM_CELLS:
        allowed = f"gives {math.prod(s.tissue.cells)} cells, at most {MAXIMUM_CELLS} are allowed"
        problems.append(Problem("tissue.element_size_mm", s.tissue.element_size_mm, allowed))
    if not s.tissue.fixed_faces:
        problems.append(Problem("tissue.fixed_faces", [], "must name at least one face"))
    for axis, cells in zip("xyz", s.tissue.cells, strict=True):
        if cells == 1 and {f"{axis}_min", f"{axis}_max"} <= set(s.tissue.fixed_faces):
            allowed = f"gives one cell along {axis} between two fixed faces: nothing could move"
            problems.append(Problem("tissue.element_size_mm", s.tissue.element_size_mm, allowed))
    for name, unset in (("fixed_sets", ()), ("mesh_unit_mm", 1.0), ("mesh_sha256", None)):
        value = getattr(s.tissue, name)
        if value != unset:
            problems.append(Problem(f"tissue.{name}", value, "must be left out: it belongs to tissue.mesh_file, which is not given"))
    return problems


def _path_problems(s: Scenario) -> list[Problem]:
    path, size = s.trajectory, s.tissue.size_mm
    if s.tissue.mesh_file is not None:
        return _mesh_path_problems(s) or [*_length_problems(s), *_step_problems(s)]
    x, y, z = path.entry_mm
    if z != 0.0 or not (0.0 < x < size[0] and 0.0 < y < size[1]):
        allowed = f"must lie on the face z = 0, inside 0 < x < {size[0]:g}, 0 < y < {size[1]:g}"
        return [Problem("trajectory.entry_mm", list(path.entry_mm), allowed)]
    tx, ty, tz = path.target_mm
    if not (0.0 < tx < size[0] and 0.0 < ty < size[1] and MINIMUM_DEPTH_MM <= tz <= size[2]):
        inside = f"0 < x < {size[0]:g}, 0 < y < {size[1]:g}, {MINIMUM_DEPTH_MM:g} <= z <= {size[2]:g}"
        return [Problem("trajectory.target_mm", list(path.target_mm), f"must lie below the entry, inside {inside}")]
    return _overlay_problems(s) or [*_length_problems(s), *_step_problems(s)]


def _mesh_path_problems(s: Scenario) -> list[Problem]:
    from simcore.mesh_checks import path_problems

    path = s.trajectory
    length = math.dist(path.entry_mm, path.target_mm)
    if length < MINIMUM_DEPTH_MM:
        allowed = f"is {length:.3g} mm from trajectory.entry_mm; it must be at least {MINIMUM_DEPTH_MM:g}"
        return [Problem("trajectory.target_mm", list(path.target_mm), allowed)]
    return _direction_problems(s) or path_problems(s.tissue, s.path())


def _direction_problems(s: Scenario) -> list[Problem]:
    path = s.trajectory
    if not isinstance(path, SineTrajectory):
        return []
    chord = np.subtract(path.target_mm, path.entry_mm)
    across = np.linalg.norm(np.cross(path.direction, chord))
    if across <= 1e-9 * np.linalg.norm(path.direction) * np.linalg.norm(chord):
        return [
            Problem(
                "trajectory.direction",
                list(path.direction),
                "must be a vector across the path, neither zero nor along it",
            )
        ]
    return []


def _overlay_problems(s: Scenario) -> list[Problem]:
    path = s.trajectory
    if not isinstance(path, SineTrajectory):
        return []
    if problems := _direction_problems(s):
        return problems
    points = path.path().curve(np.linspace(0.0, 1.0, 1001))
    low, high = points.min(axis=0), points.max(axis=0)
    if (low < -1e-12).any() or (high > np.array(s.tissue.size_mm) * 1e-3 + 1e-12).any():
        return [Problem("trajectory.amplitude_mm", path.amplitude_mm, "must keep the whole path inside the block")]
    return []


def _length_problems(s: Scenario) -> list[Problem]:
    length = 1e3 * s.path().length_m
    if s.needle.length_mm >= length + STAND_OFF_MM - 1e-9:
        return []
    allowed = f"must be at least {length + STAND_OFF_MM:.6g} (path {length:.6g} plus stand-off {STAND_OFF_MM:g})"
    return [Problem("needle.length_mm", s.needle.length_mm, allowed)]


def _step_problems(s: Scenario) -> list[Problem]:
    if s.steps <= MAXIMUM_STEPS:
        return []
    return [Problem("dt_s", s.dt_s, f"gives {s.steps} steps, at most {MAXIMUM_STEPS} are allowed")]


def _motion_problems(s: Scenario) -> list[Problem]:
    motion = s.motion
    if isinstance(motion, Breathing) and math.hypot(*motion.direction) < 1e-6:
        return [Problem("motion.direction", list(motion.direction), "must be a vector at least 1e-6 long")]
    return []


def _pose_problems(s: Scenario) -> list[Problem]:
    if not isinstance(s.controller, Replay):
        return []
    for i, pose in enumerate(s.controller.poses):
        norm = math.hypot(*pose[3:])
        if abs(norm - 1.0) > 1e-3:
            return [
                Problem(
                    f"controller.poses[{i}]",
                    list(pose),
                    f"must hold a unit quaternion qw, qx, qy, qz; its norm is {norm:.6g}",
                )
            ]
        if max(abs(c) for c in pose[:3]) > 10_000.0:
            return [Problem(f"controller.poses[{i}]", list(pose), "must lie within +-10000 mm")]
    return []


def _with_spacing(model: SeparateModel, s: Scenario) -> SeparateModel:
    if s.tissue.mesh_file is not None:
        model = model.model_copy(update={"element_size_mm": s.tissue.element_size_mm})
    if model.spacing_mm is not None:
        return model
    assert s.interaction.spacing_mm is not None
    return model.model_copy(update={"spacing_mm": max(s.interaction.spacing_mm, model.element_size_mm)})


def _model_problems(s: Scenario) -> list[Problem]:
    if not isinstance(s.controller, InverseFem) or not isinstance(s.controller.model, SeparateModel):
        return []
    model, problems = s.controller.model, []
    if model.spacing_mm is not None and model.spacing_mm < model.element_size_mm:
        allowed = f"must be at least controller.model.element_size_mm = {model.element_size_mm:g}: closer rows lock"
        problems.append(Problem("controller.model.spacing_mm", model.spacing_mm, allowed))
    cells = math.prod(s.tissue.model_copy(update={"element_size_mm": model.element_size_mm}).cells)
    if cells > MAXIMUM_CELLS and s.tissue.mesh_file is None:
        allowed = f"gives {cells} cells, at most {MAXIMUM_CELLS} are allowed"
        problems.append(Problem("controller.model.element_size_mm", model.element_size_mm, allowed))
    return problems
