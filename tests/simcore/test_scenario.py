"""The scenario model: every field documented, every wrong value refused by name, JSON in and out without loss."""

from __future__ import annotations

import copy
import json
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import BaseModel, ValidationError

from simcore.controller_blocks import KINDS as CONTROLLERS
from simcore.errors import ScenarioError
from simcore.scenario import SCHEMA, Scenario
from tests.strategies import scenarios

Json = dict[str, Any]
Path = tuple[str | int, ...]

STRAIGHT_IN = [0.0, 0.0, -100.0, 1.0, 0.0, 0.0, 0.0]
KINDS: list[Json] = [
    {},
    {"trajectory": {"kind": "sine"}},
    {"controller": {"kind": "replay", "poses": [STRAIGHT_IN]}},
    {"controller": {"kind": "open_loop"}},
    {"controller": {"kind": "ifem", "model": {"kind": "separate"}}},
]


def refusal(data: Any) -> ScenarioError:
    """The error of a scenario that must be refused; one line for each problem."""
    with pytest.raises(ScenarioError) as caught:
        Scenario.load(data)
    error = caught.value
    assert str(error).splitlines() == [str(problem) for problem in error.problems]
    assert all(line.isprintable() for line in str(error).splitlines())
    return error


def refusal_or_none(data: Any) -> ScenarioError | None:
    try:
        Scenario.load(data)
    except ScenarioError as error:
        return error
    return None


def refused(data: Any, field: str, *words: str) -> None:
    """Assert that exactly one problem is found: on this field, with its value, its message holding all words."""
    (problem,) = refusal(data).problems
    assert problem.field == field
    value = value_at(data, field)
    assert problem.value == value or (value != value and problem.value != problem.value)
    for word in words:
        assert word in problem.message


def value_at(data: Any, field: str) -> Any:
    for name in re.findall(r"[^.\[\]]+", field):
        data = data[int(name) if name.isdigit() else name]
    return data


# ---- the fields, found in the model's own schema


@dataclass(frozen=True)
class NumberField:
    """A number somewhere in the schema, and a valid scenario that has it."""

    path: Path
    schema: Json
    base: Json
    holder: str  # what the error names when the value is refused by a rule between fields
    optional: bool  # null stands for a derived value

    @property
    def name(self) -> str:
        return "".join(f"[{n}]" if isinstance(n, int) else f".{n}" for n in self.path).lstrip(".")

    def with_value(self, value: Any) -> Json:
        data = copy.deepcopy(self.base)
        at: Any = data
        for name in self.path[:-1]:
            at = at[name]
        at[self.path[-1]] = value
        return data


def numbers(
    node: Json, defs: Json, base: Json, at: Any, path: Path = (), optional: bool = False
) -> Iterator[tuple[Path, Json, bool]]:
    """Path and schema of every number of a model, following the kinds that `at`, a resolved scenario, has."""
    if "$ref" in node:
        yield from numbers(defs[node["$ref"].rsplit("/", 1)[1]], defs, base, at, path)
    elif "discriminator" in node:
        yield from numbers({"$ref": node["discriminator"]["mapping"][at["kind"]]}, defs, base, at, path)
    elif "anyOf" in node:
        for option in node["anyOf"]:
            yield from numbers(option, defs, base, at, path, optional={"type": "null"} in node["anyOf"])
    elif node.get("type") == "object":
        for name, field in node["properties"].items():
            yield from numbers(field, defs, base, at[name], (*path, name))
    elif node.get("type") == "array":
        for i, item in enumerate((node.get("prefixItems") or [node["items"]])[: len(at)]):
            yield from numbers(item, defs, base, at[i], (*path, i))
    elif node.get("type") in ("number", "integer"):
        yield path, node, optional


def every_number() -> dict[str, NumberField]:
    schema = Scenario.model_json_schema()
    found: dict[str, NumberField] = {}
    for base in (Scenario.load(kind).resolved() for kind in KINDS):
        for path, node, optional in numbers(schema, schema["$defs"], base, base):
            names = [name for name in path if isinstance(name, str)]
            field = NumberField(path, node, base, ".".join(names), optional)
            kind = base[names[0]].get("kind") if isinstance(base[names[0]], dict) else None
            found[f"{field.name} ({kind})" if kind else field.name] = field
    return found


NUMBERS = every_number()
every_number_field = pytest.mark.parametrize("field", NUMBERS.values(), ids=NUMBERS.keys())


def test_the_schema_was_walked() -> None:
    names = {field.name for field in NUMBERS.values()}
    assert {"seed", "dt_s", "tissue.size_mm[2]", "interaction.spacing_mm", "trajectory.direction[0]"} <= names
    assert {"controller.gain", "controller.poses[0][6]", "solver.max_iterations", "recording.every_steps"} <= names


@every_number_field
def test_the_base_of_a_number_is_valid(field: NumberField) -> None:
    data = field.with_value(value_at(field.base, field.name))
    assert Scenario.load(data).resolved() == field.base


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


FIELDS = [
    pytest.param(model, name, id=f"{model.__name__}.{name}")
    for model in sorted(models(), key=lambda m: m.__name__)
    for name in model.model_fields
]


@pytest.mark.parametrize(("model", "name"), FIELDS)
def test_a_field_has_a_description_and_a_default(model: type[BaseModel], name: str) -> None:
    info = model.model_fields[name]
    assert info.description
    assert "\n" not in info.description
    assert not info.is_required() or (model.__name__, name) in (("Replay", "poses"), ("Plugin", "name"))


@pytest.mark.parametrize("model", sorted(models(), key=lambda m: m.__name__))
def test_a_model_says_what_it_is(model: type[BaseModel]) -> None:
    assert model.__doc__


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


def test_defaults_are_those_of_version_1() -> None:
    """A default never changes within a schema version: this literal may only grow by new fields."""
    assert Scenario().resolved() == {
        "schema": "needlebench/scenario/1",
        "name": "unnamed",
        "seed": 0,
        "dt_s": 0.01,
        "noise_mm": 0.0,
        "tissue": {
            "size_mm": [36.0, 62.0, 122.0],
            "element_size_mm": 6.0,
            "young_kpa": 6.3,
            "poisson": 0.4,
            "density_kg_m3": 0.0,
            "rayleigh_mass_per_s": 0.0,
            "rayleigh_stiffness_s": 0.0,
            "fixed_faces": ["y_min", "y_max"],
            "fixed_sets": [],
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
        },
        "interaction": {
            "spacing_mm": 6.0,
            "spread_mm": 4.0,
            "friction": 0.1,
            "adhesion_n_per_mm": 0.01,
            "cutting_n": 0.1,
            "puncture_n": 0.1,
        },
        "trajectory": {
            "kind": "line",
            "entry_mm": [18.0, 31.0, 0.0],
            "target_mm": [18.0, 31.0, 122.0],
            "speed_mm_s": 10.0,
            "frame": "world",
        },
        "robot": {"max_speed_mm_s": 50.0, "max_turn_deg_s": 30.0},
        "controller": {
            "kind": "ifem",
            "gain": 1.0,
            "rcm_gain": 1.0,
            "damping": 0.05,
            "lever_arm_mm": 100.0,
            "jacobian": "constraint",
            "derivative": "fast",
            "perturbation_mm": 0.05,
            "model": {"kind": "shared"},
        },
        "motion": {"kind": "none"},
        "solver": {"force_tolerance_n": 1e-5, "violation_tolerance_mm": 1e-5, "max_iterations": 60},
        "recording": {"enabled": True, "every_steps": 10},
    }
    sine = Scenario.load({"trajectory": {"kind": "sine"}}).resolved()["trajectory"]
    assert sine["amplitude_mm"] == sine["periods"] == 1.0
    assert sine["direction"] == [1.0, 0.0, 0.0]


# ---- JSON in and out


@settings(max_examples=60, deadline=None)
@given(scenarios())
def test_round_trip(data: Json) -> None:
    scenario = Scenario.load(data)
    resolved = scenario.resolved()
    assert Scenario.load(resolved) == scenario
    assert Scenario.load(json.dumps(resolved)) == scenario
    assert Scenario.load(resolved).resolved() == resolved
    given_spacing = data["interaction"]["spacing_mm"]
    assert resolved["interaction"]["spacing_mm"] == (given_spacing or max(5.0, data["tissue"]["element_size_mm"]))
    data["interaction"]["spacing_mm"] = resolved["interaction"]["spacing_mm"]
    for name, value in data.items():
        given_fields = {key: resolved[name][key] for key in value} if isinstance(value, dict) else resolved[name]
        assert given_fields == value
    assert 1 <= scenario.steps <= 1_000_000


def test_load_leaves_its_argument_alone() -> None:
    data = {"trajectory": {"speed_mm_s": 5.0}, "controller": {"gain": 0.5}}
    before = copy.deepcopy(data)
    Scenario.load(data)
    assert data == before


def test_a_scenario_is_frozen_and_hashable_by_value() -> None:
    scenario = Scenario()
    with pytest.raises(ValidationError, match="frozen"):
        scenario.seed = 3  # type: ignore[misc]
    assert scenario == Scenario.load({})
    assert hash(scenario) == hash(Scenario.load({}))


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-32"])
def test_bytes_in_the_encodings_of_json(encoding: str) -> None:
    assert Scenario.load('{"name": "Nadel ä"}'.encode(encoding)).name == "Nadel ä"


def test_the_derived_spacing_follows_the_element_size() -> None:
    for element, spacing in ((1.0 + 1.5, 5.0), (5.0, 5.0), (6.0, 6.0), (7.5, 7.5)):
        found = Scenario.load({"tissue": {"element_size_mm": element}}).interaction.spacing_mm
        assert found == spacing


def test_cells_are_rounded_sizes() -> None:
    nodes = {10.0: 455, 7.5: 918, 6.0: 1617, 5.0: 2600, 4.0: 5270}
    for element, expected in nodes.items():
        cells = Scenario.load({"tissue": {"element_size_mm": element}}).tissue.cells
        assert math.prod(c + 1 for c in cells) == expected


def test_steps_are_path_over_pace_or_the_poses() -> None:
    assert Scenario().steps == 1220
    assert Scenario.load({"dt_s": 0.03}).steps == 407
    assert Scenario.load({"controller": {"kind": "replay", "poses": [STRAIGHT_IN] * 7}}).steps == 7
    sine = Scenario.load({"trajectory": {"kind": "sine", "amplitude_mm": 3.0}})
    assert sine.steps == math.ceil(sine.path().length_m / 1e-4) > 1220


def test_high_friction_is_allowed_with_a_warning() -> None:
    assert Scenario.load({"interaction": {"friction": 0.3}}).warnings() == []
    (warning,) = Scenario.load({"interaction": {"friction": 0.31}}).warnings()
    assert "interaction.friction = 0.31" in warning
    assert "0.3 " in warning


# ---- unknown names, versions and kinds


@pytest.mark.parametrize("block", ["", *(n for n, v in Scenario().resolved().items() if isinstance(v, dict))])
@pytest.mark.parametrize("name", ["speed", "kind_", "Seed", "line", "ifem", " seed", "schema_id", "scenario"])
def test_an_unknown_field_is_refused_with_the_known_ones(block: str, name: str) -> None:
    data: Json = {block: {name: 1}} if block else {name: 1}
    field = f"{block}.{name}" if block else name
    holder = Scenario().resolved()[block] if block else Scenario().resolved()
    refused(data, field, "unknown field", ", ".join(sorted(holder)))


@pytest.mark.parametrize("kinds", KINDS[1:])
def test_an_unknown_field_of_a_kind_is_refused(kinds: Json) -> None:
    (block,) = kinds
    data = copy.deepcopy(kinds)
    data[block]["line"] = 3
    refused(data, f"{block}.line", "unknown field", "kind")


def test_a_field_of_another_kind_is_unknown() -> None:
    refused({"trajectory": {"amplitude_mm": 1.0}}, "trajectory.amplitude_mm", "known here: entry_mm, frame, kind")
    refused({"controller": {"kind": "open_loop", "gain": 1.0}}, "controller.gain", "known here: kind")


@pytest.mark.parametrize("kind", ["circle", "", "LINE", 5, None, [], {}, ["line"], True])
@pytest.mark.parametrize(
    ("block", "known"),
    [("trajectory", "line, sine"), ("controller", CONTROLLERS.replace(" or ", ", "))],
    ids=["path", "control"],
)
def test_an_unknown_kind_is_refused_with_the_known_ones(block: str, known: str, kind: Any) -> None:
    refused({block: {"kind": kind}}, f"{block}.kind", f"must be one of {known}")


@pytest.mark.parametrize("version", ["needlebench/scenario/2", "needlebench/scenario/0", "", 1, None, SCHEMA + " "])
def test_another_schema_version_is_refused(version: Any) -> None:
    refused({"schema": version}, "schema", SCHEMA)


@pytest.mark.parametrize("block", [n for n, v in Scenario().resolved().items() if isinstance(v, dict)])
@pytest.mark.parametrize("value", [None, 1, "x", [], True])
def test_a_block_must_be_an_object(block: str, value: Any) -> None:
    refused({block: value}, block, "should be an object")


@pytest.mark.parametrize("name", ["", "x" * 101, "line\nbreak", "tab\t", "a\x00", "semi;colon", "<b>", 5, None, "a\n"])
def test_a_bad_name_is_refused(name: Any) -> None:
    refused({"name": name}, "name", "1 to 100 letters")


@pytest.mark.parametrize(
    ("faces", "field"),
    [
        ([], "tissue.fixed_faces"),
        (["z_min"], "tissue.fixed_faces[0]"),
        (["y_min", "Y_MAX"], "tissue.fixed_faces[1]"),
        (["y_min", "x_min", "y_min"], "tissue.fixed_faces"),
        ("y_min", "tissue.fixed_faces"),
        ([["y_min"]], "tissue.fixed_faces[0]"),
    ],
)
def test_bad_fixed_faces_are_refused(faces: Any, field: str) -> None:
    refused({"tissue": {"fixed_faces": faces}}, field)


# ---- rules between fields


def test_the_inner_diameter_is_below_the_outer_one() -> None:
    for inner in (1.27, 1.3, 5.0):
        refused({"needle": {"inner_diameter_mm": inner}}, "needle.inner_diameter_mm", "needle.outer_diameter_mm = 1.27")
    assert Scenario.load({"needle": {"inner_diameter_mm": 0.0}}).needle.inner_diameter_mm == 0.0


def test_the_needle_is_longer_than_path_and_stand_off() -> None:
    refused({"needle": {"length_mm": 141.9}}, "needle.length_mm", "at least 142", "path 122", "stand-off 20")
    assert Scenario.load({"needle": {"length_mm": 142.0}}).needle.length_mm == 142.0
    wavy = {"kind": "sine", "amplitude_mm": 10.0, "periods": 10.0}
    refused({"trajectory": wavy, "needle": {"length_mm": 180.0}}, "needle.length_mm", "at least 4")  # by arc length


def test_the_spacing_is_not_below_the_element_size() -> None:
    refused({"interaction": {"spacing_mm": 5.9}}, "interaction.spacing_mm", "tissue.element_size_mm = 6", "null")
    resolved = Scenario().resolved()
    resolved["tissue"]["element_size_mm"] = 10.0
    refused(resolved, "interaction.spacing_mm", "at least tissue.element_size_mm = 10")


@pytest.mark.parametrize(
    "entry",
    [[0, 31, 0], [36, 31, 0], [-1, 31, 0], [18, 0, 0], [18, 62, 0], [18, 31, 1e-9], [18, 31, -1], [18, 31, 122]],
)
def test_the_entry_lies_on_the_entry_face(entry: list[float]) -> None:
    refused({"trajectory": {"entry_mm": entry}}, "trajectory.entry_mm", "z = 0", "0 < x < 36", "0 < y < 62")


@pytest.mark.parametrize(
    "target",
    [
        [18, 31, 0],
        [18, 31, -5],
        [18, 31, 122.1],
        [0, 31, 122],
        [36, 31, 122],
        [18, 62, 50],
        [18, 31, 1e-200],
        [18, 31, 0.09],
    ],
)
def test_the_target_lies_in_the_block_below_the_entry(target: list[float]) -> None:
    refused({"trajectory": {"target_mm": target}}, "trajectory.target_mm", "0 < x < 36", "0.1 <= z <= 122")


@pytest.mark.parametrize("direction", [[0, 0, 1], [0, 0, -7], [0, 0, 0], [1e-12, 0, 1], [0, 1e-320, 0]])
def test_a_sine_direction_across_the_path_is_needed(direction: list[float]) -> None:
    refused({"trajectory": {"kind": "sine", "direction": direction}}, "trajectory.direction", "across the path")


@pytest.mark.parametrize("direction", [[1e-6, 0, 0], [1000, 0, 0], [1, 0, 1000], [1e-3, 0, 1]])
def test_a_sine_direction_has_any_length(direction: list[float]) -> None:
    path = Scenario.load({"trajectory": {"kind": "sine", "direction": direction}}).path()
    assert path.overlay == pytest.approx([1.0, 0.0, 0.0], abs=1e-9)


@pytest.mark.parametrize(
    "sine",
    [
        {"amplitude_mm": 18.1},
        {"amplitude_mm": 3.0, "entry_mm": [2, 31, 0], "target_mm": [2, 31, 122]},
        {"amplitude_mm": 10.0, "direction": [0, 1, 0], "entry_mm": [18, 55, 0], "target_mm": [18, 55, 122]},
        {"amplitude_mm": 15.0, "periods": 10.0, "target_mm": [30, 31, 20]},  # through the entry face
        {"amplitude_mm": 15.0, "periods": 0.5, "target_mm": [30, 31, 20], "direction": [0, 0, 1]},  # through the back
    ],
)
def test_a_path_stays_inside_the_block(sine: Json) -> None:
    depth = sine.get("target_mm", [18, 31, 122])[2]
    data = {
        "trajectory": {"kind": "sine", **sine},
        "tissue": {"size_mm": [36, 62, depth]},
        "needle": {"length_mm": 1000},
    }
    refused(data, "trajectory.amplitude_mm", "inside the block")
    assert refusal_or_none({**data, "trajectory": {**data["trajectory"], "amplitude_mm": 0.1}}) is None


def test_too_many_cells_and_steps_are_refused() -> None:
    refused(
        {"tissue": {"size_mm": [500, 500, 500], "element_size_mm": 1.0}},
        "tissue.element_size_mm",
        "125000000",
        "200000",
    )
    slow = {"trajectory": {"speed_mm_s": 0.1}, "dt_s": 1e-4}
    refused(slow, "dt_s", "12200000 steps", "1000000")


def replay(*poses: Any) -> Json:
    return {"controller": {"kind": "replay", "poses": list(poses)}}


@pytest.mark.parametrize(
    ("pose", "word"),
    [
        ([0, 0, 0, 1, 0, 0, 0.1], "1.00499"),
        ([0, 0, 0, 0, 0, 0, 0], "norm is 0"),
        ([0, 0, 0, 0.99, 0, 0, 0], "norm is 0.99"),
        ([0, 0, 0, 1e300, 1e300, 0, 0], "unit quaternion"),
        ([1e5, 0, 0, 1, 0, 0, 0], "+-10000 mm"),
        ([0, 0, -10000.1, 1, 0, 0, 0], "+-10000 mm"),
    ],
)
def test_a_bad_pose_is_refused(pose: list[float], word: str) -> None:
    refused(replay(STRAIGHT_IN, pose), "controller.poses[1]", word)


@pytest.mark.parametrize(
    ("poses", "field"),
    [
        ([], "controller.poses"),
        ("x", "controller.poses"),
        ({}, "controller.poses"),
        ([1.0], "controller.poses[0]"),
        ([STRAIGHT_IN, [*STRAIGHT_IN, 0.0]], "controller.poses[1]"),
        ([[0, 0, 0, math.nan, 0, 0, 0]], "controller.poses[0][3]"),
        ([[0, 0, 0, 1, 0, 0, "0"]], "controller.poses[0][6]"),
    ],
)
def test_a_bad_list_of_poses_is_refused(poses: Any, field: str) -> None:
    refused({"controller": {"kind": "replay", "poses": poses}}, field)


def test_missing_poses_and_short_poses_are_named() -> None:
    (problem,) = refusal({"controller": {"kind": "replay"}}).problems
    assert (problem.field, problem.value) == ("controller.poses", None)
    assert problem.message.startswith("is missing (allowed: 1 to 1000000 poses [x_mm,")
    (problem,) = refusal(replay([0, 0, 0, 1, 0, 0])).problems
    assert problem.field == "controller.poses[0][6]"


def test_a_quaternion_within_a_thousandth_of_unit_is_taken() -> None:
    assert Scenario.load(replay([0, 0, 0, 0.9995, 0, 0, 0])).steps == 1


def test_several_problems_are_all_named() -> None:
    error = refusal({"seed": -1, "tissue": {"poisson": 0.5, "elastic": 1}, "controller": {"gain": 3, "kind": "ifem"}})
    assert sorted(p.field for p in error.problems) == ["controller.gain", "seed", "tissue.elastic", "tissue.poisson"]
    between = {"needle": {"inner_diameter_mm": 2.0}, "interaction": {"spacing_mm": 5.0}, "dt_s": 0.1}
    assert {p.field for p in refusal(between).problems} == {"needle.inner_diameter_mm", "interaction.spacing_mm"}


# ---- hostile and broken input


@pytest.mark.parametrize("data", [None, True, 3, 2.5, [], [{}], math.nan])
def test_json_that_is_no_object_is_refused(data: Any) -> None:
    assert refusal(data).problems[0].field == "scenario"


@pytest.mark.parametrize(
    "data",
    ["", "{", "demo", "{}{}", "{'a': 1}", '{"a": 1,}', "\x00", b"", b"\xff\xff\xff", b"\x80{}", '{"name": "\\ud800"}'],
)
def test_text_that_is_no_json_is_refused(data: str | bytes) -> None:
    (problem,) = refusal(data).problems
    assert problem.field == "scenario"
    assert "is not JSON" in problem.message


class Other:
    """Something that JSON cannot say."""


@pytest.mark.parametrize("value", [{1, 2}, Other(), object, b"x", 1j, {(1, 2): 3}, bytearray(b"{}")], ids=repr)
def test_values_that_json_cannot_say_are_refused(value: Any) -> None:
    for data in (value, {"dt_s": value}) if not isinstance(value, bytes) else ({"dt_s": value},):
        (problem,) = refusal(data).problems
        assert "is not JSON" in problem.message


def test_a_loop_in_the_data_is_refused() -> None:
    data: Json = {}
    data["tissue"] = data
    assert "is not JSON" in str(refusal(data))


@pytest.mark.parametrize("depth", [150, 5_000, 200_000])
@pytest.mark.parametrize(("opening", "closing"), [("[", "]"), ('{"a":', "}")])
def test_deep_json_is_refused(depth: int, opening: str, closing: str) -> None:
    text = opening * depth + "1" + closing * depth
    for data in (text, f'{{"tissue": {text}}}', f'{{"dt_s": {text}}}'):
        assert len(str(refusal(data))) < 1000


def test_deep_data_is_refused() -> None:
    data: Any = 1
    for _ in range(100_000):
        data = [data]
    assert "is not JSON" in str(refusal({"seed": data}))
    while isinstance(data, list):  # take it apart: freeing it at once would recurse
        data = data[0]


@pytest.mark.parametrize("digits", [20, 309, 400, 4300, 4301, 100_000])
def test_a_number_of_very_many_digits_is_refused(digits: int) -> None:
    for field in ("seed", "dt_s"):
        assert len(str(refusal(f'{{"{field}": {"9" * digits}}}'))) < 1000
    if digits <= 4300:
        refused({"seed": 10 ** (digits - 1)}, "seed", "0 to 2^53 - 1")
    else:
        refusal({"seed": 10 ** (digits - 1)})


def test_huge_input_gives_a_short_answer() -> None:
    for data in (
        {"x" * 1_000_000: 1},
        {"name": "x" * 1_000_000},
        {"a\nb\x1b[31m": 1},
        {f"f{i}": 0 for i in range(5_000)},
    ):
        error = refusal(data)
        assert len(error.problems) <= 21
        assert max(map(len, str(error).splitlines())) < 400
    many = refusal(replay(*[[0.0, 0.0, 0.0]] * 5_000))
    assert len(many.problems) == 21
    assert "20000 problems" in str(many.problems[-1])


def test_a_replay_of_a_long_log_loads() -> None:
    assert Scenario.load(json.dumps(replay(*[STRAIGHT_IN] * 50_000))).steps == 50_000


values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=8,
)


@settings(max_examples=100, deadline=None)
@given(st.sampled_from(list(NUMBERS.values())), st.integers(1, 4), values)
def test_any_value_anywhere_is_taken_or_refused_by_name(field: NumberField, depth: int, value: Any) -> None:
    data = replace(field, path=field.path[:depth]).with_value(value)
    if refusal_or_none(data):
        assert refusal(data).problems
