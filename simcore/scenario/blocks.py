"""The blocks of a scenario, field by field: with the other files of blocks the only places where a default stands.

Each description ends with the tag of its default: [paper] Perrusi et al. 2021, [cited] published, [ours] our choice.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, StringConstraints

from simcore.mesh.regions import BallRegion, BoxRegion, PlaneRegion

SCHEMA: Literal["needlebench/scenario/1"] = "needlebench/scenario/1"
HARD_SPACING_MM = 5.0  # closest hard rows
SPACING_MM = 3.0
LEAST_SPACING_MM = 0.5
STAND_OFF_MM = 20.0
MINIMUM_DEPTH_MM = 0.1
MAXIMUM_CELLS = 200_000
MAXIMUM_STEPS = 1_000_000
MAXIMUM_PARTS = 100  # in which a tissue is held

Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Triple = tuple[Number, Number, Number]
Component = Annotated[Number, Field(ge=-1000, le=1000)]
SetName = Annotated[str, StringConstraints(min_length=1, max_length=100)]
Face = Literal["x_min", "x_max", "y_min", "y_max", "z_max"]
SIDES: tuple[Face, Face] = ("y_min", "y_max")  # what is held where nothing is named


def at_most(count: int) -> Any:
    """Refuses a longer list before its items are looked at: to describe what is wrong with each of very many takes a
    thousand times the room of the list."""

    def counted(items: Any) -> Any:
        if isinstance(items, list) and len(items) > count:
            raise ValueError(f"holds {len(items)} items, at most {count} are allowed")
        return items

    return BeforeValidator(counted)


class Block(BaseModel):
    """Common rules: frozen, unknown fields refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, hide_input_in_errors=True)


def bounded(default: float, low: float, high: float, text: str) -> Any:
    """A number field with its inclusive range."""
    return Field(default=default, ge=low, le=high, description=f"{text}; {low:g} to {high:g}")


class FixedBox(Block):
    """Holds what lies between two corners."""

    kind: Literal["box"] = Field(default="box", description="box, plane or sphere")
    min_mm: Triple = Field(description="lower corner")
    max_mm: Triple = Field(description="upper corner, above the lower one along each axis")

    def region(self) -> BoxRegion:
        """In metres."""
        return BoxRegion(np.array(self.min_mm) * 1e-3, np.array(self.max_mm) * 1e-3)


class FixedPlane(Block):
    """Holds what lies within a distance of a plane, on either side."""

    kind: Literal["plane"] = Field(default="plane", description="box, plane or sphere")
    point_mm: Triple = Field(description="a point of the plane")
    normal: tuple[Component, Component, Component] = Field(
        description="across the plane, of any length but 0; each -1000 to 1000"
    )
    within_mm: Number = bounded(0.5, 0.0, 500.0, "distance from the plane [ours]")

    def region(self) -> PlaneRegion:
        """In metres."""
        return PlaneRegion(np.array(self.point_mm) * 1e-3, np.array(self.normal), self.within_mm * 1e-3)


class FixedSphere(Block):
    """Holds what lies within a radius of a point."""

    kind: Literal["sphere"] = Field(default="sphere", description="box, plane or sphere")
    centre_mm: Triple = Field(description="centre")
    radius_mm: Number = bounded(10.0, 0.1, 1000.0, "radius [ours]")

    def region(self) -> BallRegion:
        """In metres."""
        return BallRegion(np.array(self.centre_mm) * 1e-3, self.radius_mm * 1e-3)


FixedRegion = Annotated[FixedBox | FixedPlane | FixedSphere, Field(discriminator="kind")]


class Tissue(Block):
    """Soft tissue, co-rotational linear elasticity: the block [0, size], entered at z = 0, or a mesh from a file."""

    size_mm: tuple[
        Annotated[Number, Field(ge=10, le=500)],
        Annotated[Number, Field(ge=10, le=500)],
        Annotated[Number, Field(ge=10, le=500)],
    ] = Field(
        default=(36.0, 62.0, 122.0),
        description="edges x, y, z, each 10 to 500 mm; with mesh_file, those of its bounding box replace them [paper]",
    )
    element_size_mm: Number = bounded(
        6.0, 1.0, 50.0, "edge of a cell of six tetrahedra; with mesh_file, its mean element replaces it [ours]"
    )
    young_kpa: Number = bounded(6.3, 0.1, 1000.0, "Young's modulus [paper]")
    poisson: Number = bounded(0.4, 0.0, 0.49, "Poisson's ratio [paper]")
    density_kg_m3: Number = bounded(0.0, 0.0, 20_000.0, "mass density; 0 = quasi-static [ours]; tissue 1000 [cited]")
    rayleigh_mass_per_s: Number = bounded(0.0, 0.0, 1000.0, "alpha of the damping C = alpha M + beta K [ours]")
    rayleigh_stiffness_s: Number = bounded(0.0, 0.0, 10.0, "beta of the damping C = alpha M + beta K [ours]")
    fixed_faces: Annotated[tuple[Face, ...] | None, at_most(MAXIMUM_PARTS)] = Field(
        default=None,
        description="faces held still, of x_min, x_max, y_min, y_max, z_max (z = 0 is the entry); with mesh_file, flat "
        "sides of its bounding box; null = y_min, y_max where neither fixed_sets nor fixed_regions is given [ours]",
    )
    fixed_sets: Annotated[tuple[SetName, ...], at_most(MAXIMUM_PARTS)] = Field(
        default=(),
        max_length=MAXIMUM_PARTS,
        description="held parts of mesh_file by name: node set, cell set, physical group, array or array=number [ours]",
    )
    fixed_regions: Annotated[tuple[FixedRegion, ...], at_most(MAXIMUM_PARTS)] = Field(
        default=(),
        max_length=MAXIMUM_PARTS,
        description="held parts by place, each a box, plane or sphere; what lies in one is held [ours]",
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

    @property
    def held_faces(self) -> tuple[Face, ...]:
        """The faces that are held: those that are named, by default y_min and y_max where nothing else is held."""
        if self.fixed_faces is not None:
            return self.fixed_faces
        return () if self.fixed_sets or self.fixed_regions else SIDES

    @property
    def cells(self) -> tuple[int, int, int]:
        """Cells along x, y, z: 2 round(edge / 2h), at least 2; a mirror image of itself, with nodes in the middle."""
        x, y, z = (2 * max(1, round(edge / (2.0 * self.element_size_mm))) for edge in self.size_mm)
        return x, y, z


class Needle(Block):
    """Straight elastic tube; the base is held by the robot."""

    length_mm: Number = bounded(180.0, 20.0, 1000.0, "base to tip [ours]")
    outer_diameter_mm: Number = bounded(1.27, 0.1, 5.0, "18G [cited]")
    inner_diameter_mm: Number = bounded(0.838, 0.0, 5.0, "18G [cited]; below the outer diameter, 0 = solid")
    young_gpa: Number = bounded(200.0, 0.1, 500.0, "Young's modulus, stainless steel [cited]")
    poisson: Number = bounded(0.29, 0.0, 0.49, "Poisson's ratio, stainless steel [cited]")
    elements: Annotated[int, Field(strict=True)] = Field(default=20, ge=2, le=200, description="beams; 2 to 200 [ours]")
    yield_mpa: Number = bounded(
        1030.0,
        1.0,
        10_000.0,
        "stress from which on the needle does not spring back, and a run is no success; tensile strength of hard-drawn "
        "austenitic tubing, ASTM A908, quoted second hand [cited, weak]",
    )


class Interaction(Block):
    """Forces between needle and tissue."""

    line_compliance: Annotated[bool, Field(strict=True)] = Field(
        default=True,
        description="the tissue gives way around a needle of this radius; false = shaft points are hard rows, as in "
        "Duriez et al. 2009 [ours]",
    )
    tip: Literal["free", "held"] = Field(
        default="free",
        description="free = no lateral force at the tip itself, the limit of a thin needle; held = a ball of radius "
        "spread_mm holds it sideways, which has no limit for small balls [ours]",
    )
    spacing_mm: Number | None = Field(
        default=None,
        ge=LEAST_SPACING_MM,
        le=50.0,
        description="rest distance of shaft constraint points; 0.5 to 50, without line_compliance at least 5 and not "
        "below tissue.element_size_mm; null = 3, without line_compliance max(5, tissue.element_size_mm) [ours]",
    )
    spread_mm: Number = bounded(
        6.0,
        0.0,
        20.0,
        "radius of the ball over which a point force is spread; with line_compliance above the needle's radius / "
        "0.5119, else 0 = bare point or at least 0.1 [ours]",
    )
    friction: Number = bounded(0.1, 0.0, 1.0, "Coulomb coefficient; above 0.3 with a warning [ours]")
    adhesion_n_per_mm: Number = bounded(
        0.01, 0.0, 1.0, "shaft force per inserted length, without pressure [cited, weak]"
    )
    cutting_n: Number = bounded(0.1, 0.0, 10.0, "axial force at which the tip cuts [ours]")
    puncture_n: Number = bounded(
        0.0, 0.0, 10.0, "normal force at which the surface is punctured; 0 = the skin is nicked beforehand [ours]"
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


class Solver(Block):
    """How a coupled step is solved, and when it counts as converged. Results must not depend on the tolerances: see the
    convergence tests."""

    mode: Literal["converged", "linearised"] = Field(
        default="converged",
        description="converged = to the tolerances, linearised = one linear solve from the start of the step, whatever "
        "residual it leaves, as in Duriez et al. 2009; the fields below then do nothing [ours]",
    )
    force_tolerance_n: Number = bounded(1e-5, 1e-12, 1e-2, "largest nodal force residual [ours]")
    violation_tolerance_mm: Number = bounded(1e-5, 1e-10, 1e-1, "largest constraint violation [ours]")
    max_iterations: Annotated[int, Field(strict=True)] = Field(
        default=60, ge=1, le=10_000, description="iterations of a step before it is a failure; 1 to 10000 [ours]"
    )


class Recording(Block):
    """What is kept for looking at; it never changes the simulation."""

    enabled: Annotated[bool, Field(strict=True)] = Field(
        default=True, description="write recording.rrd and tissue frames"
    )
    every_steps: Annotated[int, Field(strict=True)] = Field(
        default=10, ge=1, le=10_000, description="steps between two tissue frames; 1 to 10000 [ours]"
    )


Motion = Annotated[Still | Breathing, Field(discriminator="kind")]
Name = Annotated[str, StringConstraints(min_length=1, max_length=100, pattern=r"^[\w .,:+()/-]+$")]
