"""From the fields of a scenario, in the units that people use, to the SI objects of the physics: every conversion."""

from __future__ import annotations

import math

import numpy as np

from simcore.contact.channel import ChannelModel
from simcore.contact.laws import ContactLaw
from simcore.contact.line import LineCoupling, cylinder_compliance
from simcore.contact.line_calibration import mesh_deficit
from simcore.insertion.insertion import Insertion
from simcore.insertion.model import CoupledModel, Tolerances
from simcore.linear_algebra.products import norm
from simcore.mesh.mesh import Mesh, box_mesh
from simcore.mesh.reader import load_mesh
from simcore.needle.model import NeedleModel, Tube
from simcore.robot import RobotLimits
from simcore.scenario.blocks import Breathing, Interaction, Needle, Robot, Solver, Still, Tissue
from simcore.scenario.held_parts import held_of
from simcore.scenario.scenario import Scenario
from simcore.tissue.breathing import BreathingMotion
from simcore.tissue.model import Material, TissueModel


def insertion_of(scenario: Scenario, *, keeps_tissue: bool = True) -> Insertion:
    """The plant of a scenario. Raises ScenarioError for a mesh file that is no longer the one it names.

    keeps_tissue: whether its steps can be linearised exactly, see `Insertion`.
    """
    tissue, needle, interaction = tissue_model(scenario.tissue), needle_model(scenario.needle), scenario.interaction
    entry_m = np.array(scenario.trajectory.entry_mm) * 1e-3
    assert interaction.spacing_mm is not None
    channel = ChannelModel.of(
        spacing_m=interaction.spacing_mm * 1e-3,
        bevel_m=scenario.needle.outer_diameter_mm * 1e-3,
        spread_m=interaction.spread_mm * 1e-3,
        longest_m=needle.length_m,
        mesh=tissue.mesh,
        entry_m=entry_m,
        hard=not interaction.line_compliance,
    )
    allowed = tolerances(scenario.solver)
    model = CoupledModel(
        tissue=tissue,
        needle=needle,
        channel=channel,
        law=contact_law(interaction),
        line=line_coupling(scenario, tissue, channel, allowed),
        tolerances=allowed,
        entry_m=entry_m,
        dt_s=scenario.dt_s,
        linearised=scenario.solver.mode == "linearised",
    )
    return Insertion(model, motion=breathing_motion(scenario.motion), keeps_tissue=keeps_tissue)


def line_coupling(
    scenario: Scenario, tissue: TissueModel, channel: ChannelModel, tolerances: Tolerances
) -> LineCoupling:
    """The compliance along the needle's line: of a cylinder of its radius, and what the mesh owes."""
    compliance, hard = np.zeros((3, 3)), not scenario.interaction.line_compliance
    if not hard:
        across, along = cylinder_compliance(
            shear_pa=tissue.mu_pa,
            poisson=scenario.tissue.poisson,
            needle_radius_m=0.5e-3 * scenario.needle.outer_diameter_mm,
            ball_radius_m=channel.ball.radius_m,
        )
        entry_m = np.array(scenario.trajectory.entry_mm) * 1e-3
        inward = np.outer(channel.inward, channel.inward)
        compliance = across * (np.eye(3) - inward) + along * inward + mesh_deficit(tissue, channel, entry_m)
    share = tolerances.violation_m / tolerances.force_n
    diameter_m = 1e-3 * scenario.needle.outer_diameter_mm
    return LineCoupling(hard, compliance, scenario.interaction.tip == "free", diameter_m, share)


def tissue_model(tissue: Tissue) -> TissueModel:
    """The tissue of a scenario. Raises ScenarioError for a mesh file that is no longer the one it names."""
    mesh = mesh_of(tissue)
    material = Material(
        young_pa=tissue.young_kpa * 1e3,
        poisson=tissue.poisson,
        density_kg_m3=tissue.density_kg_m3,
        rayleigh_mass_per_s=tissue.rayleigh_mass_per_s,
        rayleigh_stiffness_s=tissue.rayleigh_stiffness_s,
    )
    return TissueModel.of(mesh, held_of(tissue, mesh), material)


def mesh_of(tissue: Tissue) -> Mesh:
    """The block, or the mesh from the scenario's file. Raises ScenarioError for a file that cannot be used."""
    if tissue.mesh_file is None:
        return box_mesh(np.array(tissue.size_mm) * 1e-3, tissue.cells)
    return load_mesh(tissue.mesh_file, unit_mm=tissue.mesh_unit_mm, names=tissue.fixed_sets, sha256=tissue.mesh_sha256)


def needle_model(needle: Needle) -> NeedleModel:
    """The needle of a scenario."""
    return NeedleModel.from_tube(
        Tube(
            length_m=needle.length_mm * 1e-3,
            elements=needle.elements,
            outer_diameter_m=needle.outer_diameter_mm * 1e-3,
            inner_diameter_m=needle.inner_diameter_mm * 1e-3,
            young_pa=needle.young_gpa * 1e9,
            poisson=needle.poisson,
        )
    )


def contact_law(interaction: Interaction) -> ContactLaw:
    """The forces between needle and tissue."""
    return ContactLaw(
        friction=interaction.friction,
        adhesion_n_per_m=interaction.adhesion_n_per_mm * 1e3,
        cutting_n=interaction.cutting_n,
        puncture_n=interaction.puncture_n,
    )


def tolerances(solver: Solver) -> Tolerances:
    """When a step counts as converged."""
    return Tolerances(solver.force_tolerance_n, solver.violation_tolerance_mm * 1e-3, solver.max_iterations)


def breathing_motion(motion: Still | Breathing) -> BreathingMotion | None:
    """The motion of the held nodes; None if they stay where they are."""
    if isinstance(motion, Still):
        return None
    direction = np.array(motion.direction)
    return BreathingMotion(motion.amplitude_mm * 1e-3, motion.period_s, direction / norm(direction))


def robot_limits(robot: Robot) -> RobotLimits:
    """The speed limits of the end-effector."""
    return RobotLimits(robot.max_speed_mm_s * 1e-3, math.radians(robot.max_turn_deg_s))
