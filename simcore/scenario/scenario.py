"""The frozen, validated description of one insertion: JSON in, JSON out. Its blocks are in `blocks`."""

from __future__ import annotations

import json
import re
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import ConfigDict, Field, ValidationError, model_validator

from simcore.errors import Problem, ScenarioError
from simcore.scenario.blocks import (
    MAXIMUM_CELLS,
    MAXIMUM_STEPS,
    MINIMUM_DEPTH_MM,
    SCHEMA,
    STAND_OFF_MM,
    Block,
    Breathing,
    Interaction,
    Motion,
    Name,
    Needle,
    Number,
    Recording,
    Robot,
    Solver,
    Still,
    Tissue,
    bounded,
)
from simcore.scenario.controller_blocks import (
    Controller,
    ExtremeLearning,
    FrozenJacobian,
    InverseFem,
    Learned,
    LinearRegression,
    Neighbours,
    OpenLoop,
    Plugin,
    Remote,
    Replay,
    RigidNeedle,
    SeparateModel,
    SharedModel,
    SmallNetwork,
)
from simcore.scenario.controller_rules import CONDITIONS, training_warnings, with_file_digest
from simcore.scenario.point_rules import separate_model, with_model_spacing, with_spacing
from simcore.scenario.preset_data import PRESETS, unknown_preset
from simcore.scenario.rules import (
    delay_steps,
    hold_problems,
    problems_between,
    steps_along,
    with_entry,
    with_mesh,
)
from simcore.scenario.sensing import Sensing, sensing_problems
from simcore.scenario.trajectory_blocks import (
    ArcTrajectory,
    ReachTrajectory,
    SineTrajectory,
    StraightTrajectory,
    Trajectory,
    WaypointTrajectory,
)
from simcore.scenario.validation import problems_of
from simcore.trajectory import Path

__all__ = [
    "MAXIMUM_CELLS",
    "MAXIMUM_STEPS",
    "MINIMUM_DEPTH_MM",
    "SCHEMA",
    "STAND_OFF_MM",
    "ArcTrajectory",
    "Breathing",
    "ExtremeLearning",
    "FrozenJacobian",
    "Interaction",
    "InverseFem",
    "Learned",
    "LinearRegression",
    "Needle",
    "Neighbours",
    "OpenLoop",
    "Plugin",
    "ReachTrajectory",
    "Recording",
    "Remote",
    "Replay",
    "RigidNeedle",
    "Robot",
    "Scenario",
    "Sensing",
    "SeparateModel",
    "SharedModel",
    "SineTrajectory",
    "SmallNetwork",
    "Solver",
    "Still",
    "StraightTrajectory",
    "Tissue",
    "WaypointTrajectory",
]

LARGEST_SEED = 2**53 - 1  # what JSON readers keep exactly
SHARED_WITH_SENSING = (
    "controller.model.kind = shared: the Jacobian is that of the plant as it is, whatever sensing does to the tip; "
    "separate has a model of its own"
)
SHORT_MM = 1.0  # a path so short was probably written in metres


class Scenario(Block):
    """One insertion. `Scenario.load` turns any JSON value into one, or says what is wrong with it.

    >>> scenario = Scenario.load({"tissue": {"young_kpa": 5.5}, "trajectory": {"target_mm": [18, 31, 60]}})
    >>> scenario.steps, scenario.interaction.spacing_mm
    (600, 3.0)
    """

    model_config = ConfigDict(extra="forbid", frozen=True, hide_input_in_errors=True, serialize_by_alias=True)

    schema_id: Literal["needlebench/scenario/1"] = Field(
        default=SCHEMA, alias="schema", description="version of this format"
    )
    name: Name = Field(default="unnamed", description="1 to 100 letters, digits, spaces and . , : + ( ) / - _")
    seed: Annotated[int, Field(strict=True)] = Field(default=0, ge=0, le=LARGEST_SEED, description="0 to 2^53 - 1")
    dt_s: Number = bounded(0.01, 1e-4, 0.1, "time step [ours]")
    noise_mm: Number = bounded(
        0.0, 0.0, 5.0, "uniform noise of the target per axis, held for noise_hold_s [paper: 0.25 in training]"
    )
    noise_hold_s: Number | None = Field(
        default=None,
        ge=1e-4,
        le=10.0,
        description="s until the target noise is redrawn, a multiple of dt_s, 0.0001 to 10; null = 10 ms, which is "
        "every step at the default dt_s, and every step where steps are longer [paper: every step; ours: its length]",
    )
    success_mm: Number = bounded(
        2.0, 0.01, 50.0, "success needs the tip this near to the end of the path after the last step [ours]"
    )
    tissue: Tissue = Field(default=Tissue(), description="the soft block")
    needle: Needle = Field(default=Needle(), description="the flexible tube that the robot holds")
    interaction: Interaction = Field(default=Interaction(), description="forces between needle and tissue")
    trajectory: Trajectory = Field(default=StraightTrajectory(), description="what the tip is asked to follow")
    sensing: Sensing = Field(default=Sensing(), description="how the tip is seen")
    motion: Motion = Field(default=Still(), description="how the held nodes of the tissue move")
    robot: Robot = Field(default=Robot(), description="speed limits of the needle's base")
    controller: Controller = Field(default=InverseFem(), description="what steers the base")
    solver: Solver = Field(default=Solver(), description="how a step is solved")
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
        """Settle the derived fields, then check the rules between fields."""
        settle = object.__setattr__
        settle(self, "tissue", with_mesh(self.tissue))
        settle(self, "trajectory", with_entry(self.trajectory, self.tissue))
        settle(self, "interaction", with_spacing(self.interaction, self.tissue))
        controller = with_model_spacing(self.controller, self.interaction, self.tissue)
        settle(self, "controller", with_file_digest(controller))
        problems = [*hold_problems(self.noise_hold_s, self.dt_s), *sensing_problems(self.sensing, self.dt_s)]
        problems += problems_between(
            tissue=self.tissue,
            needle=self.needle,
            interaction=self.interaction,
            trajectory=self.trajectory,
            motion=self.motion,
            controller=self.controller,
            solver=self.solver,
            dt_s=self.dt_s,
        )
        if problems:
            raise ScenarioError(problems)
        return self

    @classmethod
    def load(cls, data: Any) -> Scenario:
        """Validate a JSON value (dict, in which arrays of numpy count as lists), a JSON text, or the name of a built-in
        scenario. Raises ScenarioError, which names every wrong field.

        Files that it names are looked up as `simcore.file_names` says at that moment.
        """
        try:
            if isinstance(data, bytes):
                data = data.decode(json.detect_encoding(data))  # a redirected PowerShell writes UTF-16
            text = data if isinstance(data, str) else json.dumps(data, default=_plain)
        except (TypeError, ValueError, RecursionError) as error:
            raise ScenarioError([Problem("scenario", type(data).__name__, f"is not JSON: {error}")]) from None
        if isinstance(data, str) and re.fullmatch(r"[\w./\\:~ -]+", data.strip()):
            return cls._named(data.strip())
        try:
            return cls.model_validate_json(text)
        except ValidationError as error:
            raise ScenarioError(problems_of(error, cls, text)) from None

    @classmethod
    def _named(cls, name: str) -> Scenario:
        """The built-in scenario of a name, which is neither an object nor a list as JSON."""
        if name in PRESETS:
            return cls.load({"name": name, **PRESETS[name][1]})
        allowed = f"is not JSON, and {unknown_preset(name)}; for a file: Scenario.load(open(name).read())"
        raise ScenarioError([Problem("scenario", name, allowed)])

    def resolved(self) -> dict[str, Any]:
        """Every field with its value, as JSON data."""
        data: dict[str, Any] = self.model_dump(mode="json", by_alias=True)
        return data

    def path(self) -> Path:
        """The path in rest space, metres."""
        return self.trajectory.path()

    @property
    def steps(self) -> int:
        """Number of steps: the replay's poses, or ceil(path length / (speed dt)), or of a target without a path
        ceil(time / dt)."""
        return steps_along(self.trajectory, self.controller, self.dt_s)

    @property
    def delay_steps(self) -> int:
        """Number of steps by which commands are executed late."""
        return delay_steps(self.controller, self.dt_s)

    def warnings(self) -> list[str]:
        """What is allowed but unusual."""
        frictions = {"interaction.friction": self.interaction.friction}
        if model := separate_model(self.controller):
            frictions["controller.model.friction"] = model.friction
        far = [
            f"{field} = {value}: above 0.3 the friction law is far from associated"
            for field, value in frictions.items()
            if value > 0.3
        ]
        if self.interaction.puncture_n > 0.0:
            slides = "where the tip slides to before it enters depends on the mesh, by millimetres on a steep path"
            far.append(f"interaction.puncture_n = {self.interaction.puncture_n:g} N: {slides}; 0 = nicked beforehand")
        if (length_mm := 1e3 * self.path().length_m) < SHORT_MM:
            far.append(f"{self.trajectory.end_field}: the path is {length_mm:.3g} mm long; are its points in metres?")
        if self.sensing.degrades and isinstance(self.controller, InverseFem) and not separate_model(self.controller):
            far.append(SHARED_WITH_SENSING)
        conditions = self.model_dump(mode="json", include=set(CONDITIONS))
        return [*far, *training_warnings(self.controller, self.trajectory, conditions)]


def _plain(value: Any) -> Any:
    """An array or a number of numpy as JSON has it. Raises TypeError for anything else."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    raise TypeError(f"Object of type {type(value).__name__} is not JSON serializable")
