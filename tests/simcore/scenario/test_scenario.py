"""The scenario model: JSON in and out without loss, unknown names, versions and kinds refused."""

from __future__ import annotations

import copy
import json
import math
from typing import Any

import pytest
from hypothesis import given, settings
from pydantic import ValidationError

from simcore.scenario.controller_blocks import KINDS as CONTROLLERS
from simcore.scenario.scenario import SCHEMA, Scenario, Tissue
from tests.budget import examples
from tests.simcore.scenario.scenario_fields import KINDS, STRAIGHT_IN, Json, refused
from tests.strategies import scenarios


@pytest.mark.slow
@settings(max_examples=examples(60), deadline=None)
@given(scenarios())
def test_round_trip(data: Json) -> None:
    scenario = Scenario.load(data)
    resolved = scenario.resolved()
    assert Scenario.load(resolved) == scenario
    assert Scenario.load(json.dumps(resolved)) == scenario
    assert Scenario.load(resolved).resolved() == resolved
    interaction, element = data["interaction"], data["tissue"]["element_size_mm"]
    derived = 3.0 if interaction["line_compliance"] else max(5.0, element)
    assert resolved["interaction"]["spacing_mm"] == (interaction["spacing_mm"] or derived)
    interaction["spacing_mm"] = resolved["interaction"]["spacing_mm"]
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


@pytest.mark.parametrize(("element", "hard"), [(2.5, 5.0), (5.0, 5.0), (6.0, 6.0), (7.5, 7.5), (40.0, 40.0)])
def test_the_derived_spacing_is_3_mm_and_of_hard_points_follows_the_element_size(element: float, hard: float) -> None:
    tissue = {"element_size_mm": element}
    assert Scenario.load({"tissue": tissue}).interaction.spacing_mm == 3.0
    stiff = Scenario.load({"tissue": tissue, "interaction": {"line_compliance": False}})
    assert stiff.interaction.spacing_mm == hard
    derived = {"tissue": tissue, "interaction": {"line_compliance": False, "spacing_mm": hard}}
    assert Scenario.load(derived) == stiff


@pytest.mark.parametrize(
    ("element", "cells"),
    [
        (50.0, (2, 2, 2)),
        (20.0, (2, 4, 6)),
        (10.0, (4, 6, 12)),
        (8.0, (4, 8, 16)),
        (7.5, (4, 8, 16)),
        (6.0, (6, 10, 20)),
        (5.0, (8, 12, 24)),
        (4.0, (8, 16, 30)),
    ],
)
def test_cells_are_even_so_that_nodes_lie_in_the_middle(element: float, cells: tuple[int, int, int]) -> None:
    assert Scenario.load({"tissue": {"element_size_mm": element}}).tissue.cells == cells


@pytest.mark.parametrize("edge", [10.0, 14.9, 17.0, 250.0, 500.0])
def test_any_block_has_even_cells_near_the_element_size(edge: float) -> None:
    for element in (3.0, 7.5, 11.0, 50.0):
        tissue = Tissue(size_mm=(edge, edge, edge), element_size_mm=element)
        assert all(count >= 2 and count % 2 == 0 for count in tissue.cells)
        assert abs(tissue.cells[0] - edge / element) <= max(1.0, 2.0 - edge / element)


def test_steps_are_path_over_pace_or_the_poses() -> None:
    assert Scenario().steps == 1220
    assert Scenario.load({"dt_s": 0.03}).steps == 407
    assert Scenario.load({"controller": {"kind": "replay", "poses": [STRAIGHT_IN] * 7}}).steps == 7
    sine = Scenario.load({"trajectory": {"kind": "sine", "amplitude_mm": 3.0}})
    assert sine.steps == math.ceil(sine.path().length_m / 1e-4) > 1220


def test_a_puncture_is_not_calibrated_and_says_so() -> None:
    assert Scenario.load({}).warnings() == []
    (warning,) = Scenario.load({"interaction": {"puncture_n": 0.1}}).warnings()
    assert "puncture_n = 0.1 N" in warning
    assert "depends on the mesh" in warning


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
    refused(
        {"trajectory": {"amplitude_mm": 1.0}},
        "trajectory.amplitude_mm",
        "known here: entry_mm, entry_snap_mm, frame, kind",
    )
    refused({"controller": {"kind": "open_loop", "gain": 1.0}}, "controller.gain", "known here: delay_s, kind")


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
