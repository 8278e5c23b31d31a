"""The controller blocks of a scenario, field by field; tags of the defaults as in `blocks`."""

from __future__ import annotations

import json
from typing import Annotated, Any, Literal

from pydantic import Field, JsonValue, StringConstraints, field_validator, model_validator

from simcore.remote.link import LOOPBACK, Address
from simcore.scenario.blocks import LEAST_SPACING_MM, MAXIMUM_STEPS, Block, Number, bounded

KINDS = "ifem, elm, rigid, frozen, linear, neighbours, mlp, open_loop, replay, plugin or remote"
MAXIMUM_WRONG_POSES = 5_000  # that are described
LOOK_AHEAD = 100  # coming targets in an observation
MAXIMUM_SETTINGS = 100_000  # characters of a plug-in's settings as JSON

DELAY = bounded(
    0.0, 0.0, 1.0, "s from a command's making to its execution, a multiple of dt_s; the robot holds the last one [ours]"
)
DIRECTION_SPEED = bounded(
    1000.0,
    1.0,
    1e5,
    "largest speed that one singular direction of J may ask of the base, less for weak ones; rotations by the lever "
    "arm: selectively damped least squares [ours; rule cited]",
)

BasePose = tuple[Number, Number, Number, Number, Number, Number, Number]
Sha256 = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]


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
        ge=LEAST_SPACING_MM,
        le=50.0,
        description="rest distance of the model's constraint points; 0.5 to 50, without interaction.line_compliance at "
        "least 5 and its element size; null = interaction.spacing_mm, hard points not below its element size [ours]",
    )


IfemModel = Annotated[SharedModel | SeparateModel, Field(discriminator="kind")]


class InverseFem(Block):
    """Inverse finite element controller: T = X - J^+ (k o e), objectives tip and remote centre of motion [paper]."""

    kind: Literal["ifem"] = Field(default="ifem", description=KINDS)
    gain: Number = bounded(1.0, 0.0, 2.0, "k of the three tip objectives [ours]")
    rcm_gain: Number = bounded(1.0, 0.0, 2.0, "k of the two remote-centre objectives; 0 = rows left out [ours]")
    rcm_weight: Number = bounded(
        0.3,
        0.0,
        10.0,
        "weight of the two remote-centre rows, of J and of e; 0 = rows left out [ours: chosen on exploratory runs]",
    )
    orientation: Literal["rcm", "axis"] = Field(
        default="rcm",
        description="rcm = by the remote-centre rows, axis = the base's axis through the entry, its position by the "
        "three tip rows alone; rcm_gain and rcm_weight then do nothing [ours]",
    )
    direction_speed_mm_s: Number = DIRECTION_SPEED
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
    delay_s: Number = DELAY

    @model_validator(mode="before")
    @classmethod
    def _default_kind(cls, data: Any) -> Any:
        """A model without a kind is the shared one."""
        if isinstance(data, dict) and isinstance(data.get("model"), dict):
            return {**data, "model": {"kind": "shared", **data["model"]}}
        return data


class Learned(Block):
    """A regressor gives the base's move: T = P + Delta P(P, e_p); the base's axis passes through the entry."""

    model: Annotated[str, StringConstraints(min_length=1, max_length=1000)] = Field(
        default="default",
        description="file written by `needlebench train`; default = the one of this kind that comes along [ours]",
    )
    model_sha256: Sha256 | None = Field(
        default=None, description="SHA-256 of the model, 64 hexadecimal digits; null = that of the file now [ours]"
    )
    delay_s: Number = DELAY


class ExtremeLearning(Learned):
    """The paper's learned controller: Y = beta g(w X + b), trained on I-FEM insertions."""

    kind: Literal["elm"] = Field(default="elm", description=KINDS)


class LinearRegression(Learned):
    """Baseline: Delta P linear in P and e_p."""

    kind: Literal["linear"] = Field(default="linear", description=KINDS)


class Neighbours(Learned):
    """Baseline: the mean Delta P of the nearest samples; its model file holds them all and does not come along."""

    kind: Literal["neighbours"] = Field(default="neighbours", description=KINDS)


class SmallNetwork(Learned):
    """Baseline: a small multilayer perceptron."""

    kind: Literal["mlp"] = Field(default="mlp", description=KINDS)


class RigidNeedle(Block):
    """Baseline: a rigid needle through the entry with its tip at the observed target; no feedback of the tip."""

    kind: Literal["rigid"] = Field(default="rigid", description=KINDS)
    straight_mm: Number = bounded(
        10.0, 0.1, 1000.0, "nearer to the entry the needle keeps its first direction: target noise would turn it [ours]"
    )
    delay_s: Number = DELAY


class FrozenJacobian(Block):
    """Baseline: T = P + J^+ (k e_p) with a tip Jacobian kept from one depth of a straight insertion of its own; the
    base's axis passes through the entry."""

    kind: Literal["frozen"] = Field(default="frozen", description=KINDS)
    depth_mm: Number = bounded(80.0, 1.0, 1000.0, "depth at which J was taken, at most the path's [ours]")
    gain: Number = bounded(1.0, 0.0, 2.0, "k of the tip error [ours]")
    direction_speed_mm_s: Number = DIRECTION_SPEED
    model: SeparateModel = Field(
        default=SeparateModel(), description="tissue of the insertion that J comes from [ours]"
    )
    delay_s: Number = DELAY


class OpenLoop(Block):
    """The rigid needle's motion along the straight line from entry to target; no feedback."""

    kind: Literal["open_loop"] = Field(default="open_loop", description=KINDS)
    delay_s: Number = DELAY


class Replay(Block):
    """Prescribed base poses, one a step, not filtered by the robot limits: inline, or from a file for a long log."""

    kind: Literal["replay"] = Field(default="replay", description=KINDS)
    poses: tuple[BasePose, ...] | None = Field(
        default=None,
        min_length=1,
        max_length=MAXIMUM_STEPS,
        description="1 to 1000000 poses [x_mm, y_mm, z_mm, qw, qx, qy, qz] of the base: positions within +-10000, unit "
        "quaternions; identity = needle along +z, tip at base + length z; null = those of poses_file [ours]",
    )
    poses_file: Annotated[str, StringConstraints(min_length=1, max_length=1000)] | None = Field(
        default=None,
        description="1 to 1000000 such poses: the 7 columns of a .npy array or of a .csv file; null = poses [ours]",
    )
    poses_sha256: Sha256 | None = Field(
        default=None, description="SHA-256 of poses_file, 64 hexadecimal digits; null = that of the file now [ours]"
    )
    delay_s: Number = DELAY

    @field_validator("poses", mode="before")
    @classmethod
    def _mostly_poses(cls, poses: Any) -> Any:
        """A list of very many wrong poses is one error: to describe each would take half a minute for a megabyte."""
        if isinstance(poses, list):
            wrong = sum(not _looks_like_a_pose(pose) for pose in poses)
            if wrong > MAXIMUM_WRONG_POSES:
                raise ValueError(f"holds {wrong} items that are not 7 numbers")
        return poses


def _looks_like_a_pose(item: Any) -> bool:
    return isinstance(item, list | tuple) and len(item) == 7 and all(type(value) in (float, int) for value in item)


class Plugin(Block):
    """A controller of another package, found by its entry point in the group needlebench.controllers."""

    kind: Literal["plugin"] = Field(default="plugin", description=KINDS)
    name: Annotated[str, StringConstraints(min_length=1, max_length=100)] = Field(
        description="name of an installed controller [ours]"
    )
    settings: dict[str, JsonValue] = Field(
        default={}, description="what its factory is given; JSON of at most 100000 characters [ours]"
    )
    start_timeout_s: Number = bounded(600.0, 0.1, 86400.0, "s until it is made, what it loads included [ours]")
    step_timeout_s: Number = bounded(60.0, 0.001, 86400.0, "s until it has answered a step, or the run ends [ours]")
    delay_s: Number = DELAY

    @field_validator("settings")
    @classmethod
    def _finite_and_short(cls, settings: dict[str, JsonValue]) -> dict[str, JsonValue]:
        return _short_settings(settings)


def _short_settings(settings: dict[str, JsonValue]) -> dict[str, JsonValue]:
    if len(json.dumps(settings, allow_nan=False)) > MAXIMUM_SETTINGS:
        raise ValueError(f"must be at most {MAXIMUM_SETTINGS} characters of JSON")
    return settings


class Remote(Block):
    """A controller in another process, in any language: the run waits for it and asks it in lock step, one line of JSON
    each way a step. Not for the service."""

    kind: Literal["remote"] = Field(default="remote", description=KINDS)
    name: Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9][A-Za-z0-9._ -]{0,59}$")] = Field(
        default="remote", description="what results call it: letters, digits, . _ - and blanks, at most 60 [ours]"
    )
    address: Annotated[str, StringConstraints(min_length=1, max_length=120)] = Field(
        default=LOOPBACK, description="where the run waits for it: HOST:PORT on this machine, or unix:PATH [ours]"
    )
    connect_timeout_s: Number = bounded(60.0, 0.1, 86400.0, "s until it has connected and is ready [ours]")
    step_timeout_s: Number = bounded(10.0, 0.001, 86400.0, "s until it has answered a step [ours]")
    clock: Literal["simulated", "real"] = Field(
        default="simulated",
        description="simulated: the plant waits for an answer; real: it goes on for as many steps as the answer takes, "
        "with the last command, so that no two runs are alike [ours]",
    )
    look_ahead: int = Field(
        default=0,
        strict=True,
        ge=0,
        le=LOOK_AHEAD,
        description="how many coming targets it is told at each step; 0 to 100 [ours]",
    )
    settings: dict[str, JsonValue] = Field(
        default={}, description="what it is told at the start; JSON of at most 100000 characters [ours]"
    )
    delay_s: Number = DELAY

    @field_validator("address")
    @classmethod
    def _on_this_machine(cls, address: str) -> str:
        Address.parse(address)
        return address

    @field_validator("settings")
    @classmethod
    def _finite_and_short(cls, settings: dict[str, JsonValue]) -> dict[str, JsonValue]:
        return _short_settings(settings)


Controller = Annotated[
    InverseFem
    | ExtremeLearning
    | RigidNeedle
    | FrozenJacobian
    | LinearRegression
    | Neighbours
    | SmallNetwork
    | OpenLoop
    | Replay
    | Plugin
    | Remote,
    Field(discriminator="kind"),
]
