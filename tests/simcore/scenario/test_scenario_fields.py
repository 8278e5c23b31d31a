"""Every field of the scenario model: documented, with a default, each wrong value refused by name."""

from __future__ import annotations

import json
import math
import re
from typing import Any

import pytest
from pydantic import BaseModel

from simcore.scenario.scenario import Scenario
from tests.simcore.scenario.scenario_fields import (
    NUMBERS,
    Json,
    NumberField,
    every_number_field,
    refusal,
    refusal_or_none,
    refused,
    value_at,
)


def test_the_schema_was_walked() -> None:
    names = {field.name for field in NUMBERS.values()}
    assert {"seed", "dt_s", "tissue.size_mm[2]", "interaction.spacing_mm", "trajectory.direction[0]"} <= names
    assert {"controller.gain", "controller.poses[0][6]", "solver.max_iterations", "recording.every_steps"} <= names


@every_number_field
def test_the_base_of_a_number_is_valid(field: NumberField) -> None:
    data = field.with_value(value_at(field.base, field.name))
    assert Scenario.load(data).resolved() == field.base


@pytest.mark.slow
@every_number_field
@pytest.mark.parametrize("wrong", [True, False, "1", "x", None, [], {}, [1.0]], ids=repr)
def test_a_number_of_another_type_is_refused(field: NumberField, wrong: Any) -> None:
    if wrong is None and field.optional:
        assert Scenario.load(field.with_value(None))
        return
    refused(field.with_value(wrong), field.name, "number" if field.schema["type"] == "number" else "integer")


@every_number_field
@pytest.mark.parametrize("word", ["NaN", "Infinity", "-Infinity", "1e999", "-1e999"])
def test_a_number_that_is_not_finite_is_refused(field: NumberField, word: str) -> None:
    text = json.dumps(field.with_value("HERE")).replace('"HERE"', word)
    (problem,) = refusal(text).problems
    assert problem.field == field.name
    assert not math.isfinite(problem.value)
    refusal(field.with_value(float(word)))


@every_number_field
@pytest.mark.parametrize("end", ["minimum", "maximum"])
def test_a_number_out_of_range_is_refused_with_the_range(field: NumberField, end: str) -> None:
    outward = -1 if end == "minimum" else 1
    if end not in field.schema:  # bounded by the block or by the other values of its list
        far = refusal(field.with_value(outward * 1e12)).problems[0]
        assert far.field == field.holder or far.field.startswith(f"{field.holder}[")
        assert re.search(r"must (lie|hold)", far.message)
        return
    limit = field.schema[end]
    step = 1 if field.schema["type"] == "integer" else max(1e-9, abs(limit) * 1e-9)
    for wrong in (limit + outward * step, outward * 10**15 * max(1, abs(limit))):
        refused(field.with_value(wrong), field.name, "allowed: ")
    assert_documents(refusal(field.with_value(limit + outward * step)).problems[0].message, limit)


@every_number_field
def test_the_ends_of_a_range_are_allowed(field: NumberField) -> None:
    """A limit may still break a rule between fields; then the message is that rule's, not the range's."""
    for end in ("minimum", "maximum"):
        if end in field.schema:
            error = refusal_or_none(field.with_value(field.schema[end]))
            for problem in error.problems if error else []:
                assert "must" in problem.message or "gives" in problem.message


def assert_documents(text: str, limit: float) -> None:
    written = [text.replace(f"2^{53} - 1", str(2**53 - 1))]
    values = {float(word) for word in re.findall(r"-?\d+(?:\.\d+)?(?:e-?\d+)?", written[0])}
    assert float(limit) in values, f"{limit} is not in: {text}"


def test_a_whole_number_is_a_number_but_a_float_is_no_integer() -> None:
    assert Scenario.load({"dt_s": 0.1, "needle": {"length_mm": 200}}).needle.length_mm == 200.0
    for wrong in (1.0, 1.5, 1e3):
        refused({"seed": wrong}, "seed", "integer", "2^53 - 1")


# ---- every field has a description, a default and a documented range


def models(model: type[BaseModel] = Scenario) -> set[type[BaseModel]]:
    found = {model}
    for info in model.model_fields.values():
        for member in (info.annotation, *getattr(info.annotation, "__args__", ())):
            if isinstance(member, type) and issubclass(member, BaseModel):
                found |= models(member)
    return found


MODELS = sorted(models(), key=lambda m: m.__name__)
FIELDS = [pytest.param(model, name, id=f"{model.__name__}.{name}") for model in MODELS for name in model.model_fields]


@pytest.mark.parametrize(("model", "name"), FIELDS)
def test_a_field_has_a_description_and_a_default(model: type[BaseModel], name: str) -> None:
    info = model.model_fields[name]
    assert info.description
    assert "\n" not in info.description
    assert not info.is_required() or (model.__name__, name) == ("Plugin", "name")


@pytest.mark.parametrize("model", MODELS)
def test_a_model_says_what_it_is(model: type[BaseModel]) -> None:
    assert model.__doc__


@pytest.mark.slow
@every_number_field
def test_a_range_is_in_the_description(field: NumberField) -> None:
    schema = Scenario.model_json_schema()
    owner: Json = schema
    holders = [n for n in field.path if isinstance(n, str)][:-1]
    for depth, name in enumerate(holders, start=1):
        node = owner["properties"][name]
        block = value_at(field.base, ".".join(holders[:depth]))
        reference = node.get("$ref") or node["discriminator"]["mapping"][block["kind"]]
        owner = schema["$defs"][reference.rsplit("/", 1)[1]]
    text = owner["properties"][[n for n in field.path if isinstance(n, str)][-1]]["description"]
    for end in ("minimum", "maximum"):
        if end in field.schema:
            assert_documents(text, field.schema[end])
    assert "minimum" in field.schema or "inside" in text or "within" in text or "on the face" in text


def test_the_defaults_in_one_place() -> None:
    """Whoever changes a default says so here, and in the changelog why."""
    assert Scenario().resolved() == {
        "schema": "needlebench/scenario/1",
        "name": "unnamed",
        "seed": 0,
        "dt_s": 0.01,
        "noise_mm": 0.0,
        "noise_hold_s": None,
        "success_mm": 2.0,
        "tissue": {
            "size_mm": [36.0, 62.0, 122.0],
            "element_size_mm": 6.0,
            "young_kpa": 6.3,
            "poisson": 0.4,
            "density_kg_m3": 0.0,
            "rayleigh_mass_per_s": 0.0,
            "rayleigh_stiffness_s": 0.0,
            "fixed_faces": None,
            "fixed_sets": [],
            "fixed_regions": [],
            "mesh_file": None,
            "mesh_unit_mm": 1.0,
            "mesh_sha256": None,
        },
        "needle": {
            "length_mm": 180.0,
            "outer_diameter_mm": 1.27,
            "inner_diameter_mm": 0.838,
            "young_gpa": 200.0,
            "poisson": 0.29,
            "elements": 20,
            "yield_mpa": 1030.0,
        },
        "interaction": {
            "line_compliance": True,
            "tip": "free",
            "spacing_mm": 3.0,
            "spread_mm": 6.0,
            "friction": 0.1,
            "adhesion_n_per_mm": 0.01,
            "cutting_n": 0.1,
            "puncture_n": 0.0,
        },
        "trajectory": {
            "kind": "line",
            "entry_mm": [18.0, 31.0, 0.0],
            "entry_snap_mm": 0.0,
            "target_mm": [18.0, 31.0, 122.0],
            "speed_mm_s": 10.0,
            "frame": "world",
        },
        "robot": {"max_speed_mm_s": 50.0, "max_turn_deg_s": 30.0},
        "controller": {
            "kind": "ifem",
            "gain": 1.0,
            "rcm_gain": 1.0,
            "rcm_weight": 0.3,
            "orientation": "rcm",
            "direction_speed_mm_s": 1000.0,
            "lever_arm_mm": 100.0,
            "jacobian": "constraint",
            "derivative": "fast",
            "perturbation_mm": 0.05,
            "model": {"kind": "shared"},
            "delay_s": 0.0,
        },
        "sensing": {"rate_hz": None, "latency_s": 0.0, "noise_mm": 0.0, "tip": "true", "registration_mm": 1.0},
        "motion": {"kind": "none"},
        "solver": {
            "mode": "converged",
            "force_tolerance_n": 1e-5,
            "violation_tolerance_mm": 1e-5,
            "max_iterations": 60,
        },
        "recording": {"enabled": True, "every_steps": 10},
    }
    sine = Scenario.load({"trajectory": {"kind": "sine"}}).resolved()["trajectory"]
    assert sine["amplitude_mm"] == sine["periods"] == 1.0
    assert sine["direction"] == [1.0, 0.0, 0.0]
