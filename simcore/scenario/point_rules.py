"""The rules of constraint points: how far apart they are, and how wide the balls of tissue around them."""

from __future__ import annotations

import copy
from typing import Any

from simcore.contact.line_radius import LINE_RADIUS_OF_BALL, smallest_ball_radius
from simcore.errors import Problem
from simcore.scenario.blocks import HARD_SPACING_MM, SPACING_MM, Interaction, Needle, Tissue
from simcore.scenario.controller_blocks import Controller, FrozenJacobian, InverseFem, SeparateModel


def point_problems(
    needle: Needle, interaction: Interaction, tissue: Tissue, model: SeparateModel | None
) -> list[Problem]:
    """All that is wrong with spacing and spread; model: the tissue that the controller has for itself."""
    if interaction.line_compliance:
        return _ball_problems(needle, interaction.spread_mm)
    spread, problems = interaction.spread_mm, list[Problem]()
    if 0.0 < spread < 0.1:
        problems.append(Problem("interaction.spread_mm", spread, "must be 0 (bare point) or 0.1 to 20"))
    problems += _hard_spacing_problems("interaction", interaction.spacing_mm, "tissue", tissue.element_size_mm)
    if model:
        name = "controller.model"
        problems += _hard_spacing_problems(name, model.spacing_mm, name, model.element_size_mm)
    return problems


def with_spacing(interaction: Interaction, tissue: Tissue) -> Interaction:
    """The interaction with its derived spacing."""
    if interaction.spacing_mm is not None:
        return interaction
    derived = derived_spacing_mm(line_compliance=interaction.line_compliance, element_mm=tissue.element_size_mm)
    return interaction.model_copy(update={"spacing_mm": derived})


def derived_spacing_mm(*, line_compliance: bool, element_mm: float) -> float:
    """Rest distance of constraint points: 3 mm, of hard ones max(5 mm, element size), closer ones lock."""
    return SPACING_MM if line_compliance else max(HARD_SPACING_MM, element_mm)


def separate_model(controller: Controller) -> SeparateModel | None:
    """The tissue that the controller has for itself, if it has one."""
    if isinstance(controller, InverseFem | FrozenJacobian) and isinstance(controller.model, SeparateModel):
        return controller.model
    return None


def with_model_spacing(controller: Controller, interaction: Interaction, tissue: Tissue) -> Controller:
    """The controller with the derived mesh and spacing of its separate model, if it has one."""
    model = separate_model(controller)
    return controller.model_copy(update={"model": _with_spacing(model, interaction, tissue)}) if model else controller


def without_derived(resolved: dict[str, Any]) -> dict[str, Any]:
    """Resolved scenario JSON as a start for changes: a spacing that is what it would be derived as is null again.

    It loads to the same scenario, and with another element size to one whose rows of constraint points follow it.
    """
    data = copy.deepcopy(resolved)
    interaction, model = data["interaction"], data["controller"].get("model")
    hard = not interaction["line_compliance"]
    if isinstance(model, dict) and model.get("spacing_mm") is not None:
        derived = max(interaction["spacing_mm"], model["element_size_mm"] if hard else 0.0)
        model["spacing_mm"] = None if model["spacing_mm"] == derived else model["spacing_mm"]
    element_mm = data["tissue"]["element_size_mm"]
    if interaction["spacing_mm"] == derived_spacing_mm(line_compliance=not hard, element_mm=element_mm):
        interaction["spacing_mm"] = None
    return data


def _hard_spacing_problems(
    block: str, spacing_mm: float | None, element_block: str, element_mm: float
) -> list[Problem]:
    """Hard points that are closer than the elements lock."""
    least = max(HARD_SPACING_MM, element_mm)
    if spacing_mm is None or spacing_mm >= least:
        return []
    allowed = (
        f"must be {least:g} to 50 or null with interaction.line_compliance = false: closer points than "
        f"{HARD_SPACING_MM:g} mm and {element_block}.element_size_mm = {element_mm:g} lock"
    )
    return [Problem(f"{block}.spacing_mm", spacing_mm, allowed)]


def _ball_problems(needle: Needle, spread_mm: float) -> list[Problem]:
    """The ball is wider than the needle, where the line's compliance is the difference of both."""
    least = smallest_ball_radius(0.5 * needle.outer_diameter_mm)
    if spread_mm > least:
        return []
    allowed = (
        f"must be above {least:.4g} and at most 20: the needle's radius / {LINE_RADIUS_OF_BALL}; "
        "0 and any from 0.1 only with interaction.line_compliance = false"
    )
    return [Problem("interaction.spread_mm", spread_mm, allowed)]


def _with_spacing(model: SeparateModel, interaction: Interaction, tissue: Tissue) -> SeparateModel:
    if tissue.mesh_file is not None:
        model = model.model_copy(update={"element_size_mm": tissue.element_size_mm})
    if model.spacing_mm is not None:
        return model
    assert interaction.spacing_mm is not None
    least = 0.0 if interaction.line_compliance else model.element_size_mm
    return model.model_copy(update={"spacing_mm": max(interaction.spacing_mm, least)})
