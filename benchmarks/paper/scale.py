"""How large a rerun of the paper is: the numbers that distinguish a look from the full experiment."""

from __future__ import annotations

import json
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, ValidationError

from simcore.errors import Problem, ScenarioError
from simcore.scenario.validation import problems_of

Count = Annotated[int, Field(strict=True, ge=0, le=1000)]
Positive = Annotated[int, Field(strict=True, ge=1, le=100_000)]


BAND_FIELDS = {"band_mm", "band_difference_mm"}  # in no digest of a plan


class ExperimentScale(BaseModel):
    """What every experiment's scale settles: the discretisation that all insertions share, data set and ELM."""

    model_config = ConfigDict(extra="forbid", frozen=True, hide_input_in_errors=True)

    name: Annotated[str, StringConstraints(pattern=r"^[a-z0-9][a-z0-9-]{0,29}$")]
    element_size_mm: float = Field(6.0, ge=2.0, le=20.0, description="edge of a cell of the tissue")
    dt_s: float = Field(0.01, ge=1e-3, le=0.05, description="time step")
    band_mm: float | None = Field(
        None,
        ge=0.0,
        le=100.0,
        description="band of a controller's RMSE for the discretisation, by a convergence study of closed loops; null "
        "= the measured one on the default discretisation, else unknown. Only the claims read it: it may be set later",
    )
    band_difference_mm: float | None = Field(
        None,
        ge=0.0,
        le=100.0,
        description="band of the paired difference of two controllers, likewise; null beside a `band_mm` = twice that",
    )
    training: int = Field(105, ge=1, le=105, description="data-set insertions, of the 7 x 15 grid")
    samples: Positive = Field(10_000, description="samples drawn from them")
    nodes: Positive = Field(25, description="hidden nodes of the ELM")


AnyScale = TypeVar("AnyScale", bound=ExperimentScale)


class Scale(ExperimentScale):
    """Counts of insertions of the paper's rerun.

    Subsets are the first end points of the same list, so that a smaller scale is part of a larger one.
    """

    retraining: Count = Field(
        105, le=105, description="insertions of each data set of the training study; 0 = no such study, else 2 or more"
    )
    quiet: int = Field(100, ge=0, le=100, description="end points of the ELM trained without noise, LIN and CUR")
    seeds: int = Field(20, ge=1, le=100, description="ELM trainings that differ in their random input weights")
    lin: int = Field(
        100, ge=1, le=100, description="straight test paths; each of four sine overlays over `cur` of them"
    )
    cur: int = Field(100, ge=1, le=100, description="end points whose four curved test paths are run")
    young: int = Field(100, ge=0, le=100, description="end points run at a Young's modulus of their own")
    young_ifem: int = Field(
        0, ge=0, le=100, description="of these, the first that I-FEM runs too, with a model of the nominal modulus"
    )
    reference_lin: Count = Field(100, description="straight paths of the open-loop and rigid-needle arms")
    reference_cur: Count = Field(100, description="end points of these arms on curved paths")
    reference_directions: int = Field(1, ge=1, le=4, description="directions at each, 1 = a different one in turn")
    reference_young: Count = Field(0, description="end points of these arms at variable Young's modulus, LIN and CUR")
    noise: Count = Field(25, description="straight paths with target noise in the test, every arm")
    baselines: Count = Field(0, description="end points of the learned baselines, LIN and CUR")
    seed_paths: Count = Field(8, description="paths on which every ELM seed is run")
    timing: int = Field(2, ge=1, le=20, description="paths of the one-worker timing pass")
    sensitivity_lin: Count = Field(1, description="straight paths of each variation of the sensitivity study")
    sensitivity_cur: Count = Field(1, description="curved paths of each variation, one direction an end point")
    curve_nodes: tuple[Positive, ...] = Field(
        (5, 10, 15, 25, 50, 100, 200), max_length=20, description="node counts of the learning curve"
    )
    curve_samples: tuple[Positive, ...] = Field(
        (100, 300, 1000, 3000, 10_000), max_length=20, description="sample counts of the learning curve"
    )
    recordings: Count = Field(
        2, description="failed cases that are recorded, besides best, median and worst of each arm"
    )


_COARSE = {"element_size_mm": 8.0, "dt_s": 0.02}
SCALES = {
    "smoke": Scale(
        name="smoke",
        element_size_mm=10.0,
        dt_s=0.05,
        training=24,
        retraining=2,
        quiet=1,
        samples=3000,
        seeds=3,
        lin=4,
        cur=2,
        young=2,
        young_ifem=1,
        reference_lin=4,
        reference_cur=2,
        reference_young=1,
        noise=1,
        baselines=1,
        seed_paths=2,
        timing=1,
        sensitivity_lin=0,
        curve_nodes=(5, 25, 100),
        curve_samples=(100, 1000, 3000),
        recordings=1,
    ),
    "quick": Scale(
        name="quick",
        **_COARSE,
        training=35,
        retraining=35,
        quiet=15,
        seeds=5,
        lin=25,
        cur=15,
        young=15,
        young_ifem=5,
        reference_lin=25,
        reference_cur=15,
        reference_young=5,
        noise=10,
        baselines=5,
        seed_paths=8,
        timing=2,
        sensitivity_lin=4,
        sensitivity_cur=4,
    ),
    "full": Scale(name="full", young_ifem=25, reference_young=10, baselines=5, timing=10),
    "extended": Scale(
        name="extended",
        young_ifem=100,
        reference_directions=4,
        reference_young=100,
        noise=100,
        baselines=100,
        seed_paths=25,
        timing=10,
        sensitivity_lin=10,
        sensitivity_cur=10,
    ),
}
SCALE_TEXT = {
    "smoke": "does everything work? a coarse mesh and time step, a handful of paths",
    "quick": "a first look: coarser mesh and time step, a quarter of the paths; it decides nothing either",
    "full": "the paper: 105 + 500 I-FEM + 500 ELM + 500 ELM at variable stiffness, and what they are compared with",
    "extended": "full, with all of I-FEM at variable stiffness, all references, 20 seeds x 25 paths, more sensitivity",
}


def scale_of(data: Any, kind: type[AnyScale], *, field: str) -> AnyScale:
    """A scale of an experiment from JSON data. Raises ScenarioError, which names every wrong field."""
    text = json.dumps(data)
    try:
        return kind.model_validate_json(text)
    except ValidationError as error:
        raise ScenarioError(problems_of(error, kind, text)) from None
    except RecursionError:
        raise ScenarioError([Problem(field, type(data).__name__, "is nested too deeply")]) from None
