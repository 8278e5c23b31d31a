"""Rules between the fields of a scenario: what breaks one is refused with field, value and limit."""

from __future__ import annotations

import math
from typing import Any, get_args

import pytest

from simcore.scenario import controller_blocks
from simcore.scenario.scenario import Scenario
from simcore.trajectory.curves import SinePath
from tests.simcore.scenario.scenario_fields import STRAIGHT_IN, Json, refusal, refusal_or_none, refused, replay

EVERY_KIND: list[Json] = [  # that needs no file of its own and no plug-in
    *({"kind": kind} for kind in ("ifem", "rigid", "frozen", "open_loop", "linear", "remote")),
    {"kind": "replay", "poses": [STRAIGHT_IN]},
]


def test_the_inner_diameter_is_below_the_outer_one() -> None:
    for inner in (1.27, 1.3, 5.0):
        refused({"needle": {"inner_diameter_mm": inner}}, "needle.inner_diameter_mm", "needle.outer_diameter_mm = 1.27")
    assert Scenario.load({"needle": {"inner_diameter_mm": 0.0}}).needle.inner_diameter_mm == 0.0


def test_the_needle_is_longer_than_path_and_stand_off() -> None:
    refused({"needle": {"length_mm": 141.9}}, "needle.length_mm", "at least 142", "path 122", "stand-off 20")
    assert Scenario.load({"needle": {"length_mm": 142.0}}).needle.length_mm == 142.0
    wavy = {"kind": "sine", "amplitude_mm": 10.0, "periods": 10.0}
    refused({"trajectory": wavy, "needle": {"length_mm": 180.0}}, "needle.length_mm", "at least 4")  # by arc length


HARD = {"line_compliance": False}


@pytest.mark.parametrize(("spacing", "element", "least"), [(5.9, 6.0, "6"), (4.9, 3.0, "5"), (9.99, 10.0, "10")])
def test_hard_points_are_not_closer_than_elements(spacing: float, element: float, least: str) -> None:
    data: Json = {"interaction": {**HARD, "spacing_mm": spacing}, "tissue": {"element_size_mm": element}}
    words = (f"must be {least} to 50 or null", "interaction.line_compliance = false", "5 mm", f"_mm = {element:g}")
    refused(data, "interaction.spacing_mm", *words)
    assert Scenario.load({**data, "interaction": {"spacing_mm": spacing}}).interaction.spacing_mm == spacing
    assert Scenario.load({**data, "interaction": {**HARD, "spacing_mm": float(least)}})


def test_compliant_points_may_be_closer_than_elements_but_not_arbitrarily() -> None:
    for spacing in (0.5, 3.0, 50.0):
        assert Scenario.load({"interaction": {"spacing_mm": spacing}}).interaction.spacing_mm == spacing
    for spacing in (0.499, 50.1, 0.0, -3.0):
        refused({"interaction": {"spacing_mm": spacing}}, "interaction.spacing_mm", "0.5 to 50")


@pytest.mark.parametrize(("outer", "least"), [(1.27, "1.24"), (0.9, "0.8791"), (5.0, "4.884")])
def test_the_ball_is_wider_than_the_needle(outer: float, least: str) -> None:
    needle = {"outer_diameter_mm": outer, "inner_diameter_mm": 0.0}
    for spread in (0.0, 0.5 * outer / 0.5119, 0.5 * outer):
        data: Json = {"needle": needle, "interaction": {"spread_mm": spread}}
        words = (f"must be above {least} and at most 20", "the needle's radius / 0.5119", "line_compliance = false")
        refused(data, "interaction.spread_mm", *words)
    assert Scenario.load({"needle": needle, "interaction": {"spread_mm": 0.5 * outer / 0.5118}})
    assert Scenario.load({"needle": needle, "interaction": {**HARD, "spread_mm": 0.0}})


def test_the_ball_of_a_hard_point_is_a_bare_point_or_not_tiny() -> None:
    for spread in (1e-9, 0.05, 0.0999):
        refused({"interaction": {**HARD, "spread_mm": spread}}, "interaction.spread_mm", "0 (bare point) or 0.1 to 20")
    for spread in (0.0, 0.1, 20.0):
        assert Scenario.load({"interaction": {**HARD, "spread_mm": spread}}).interaction.spread_mm == spread
    for interaction in ({}, HARD):
        refused({"interaction": {**interaction, "spread_mm": 20.1}}, "interaction.spread_mm", "0 = bare", "0 to 20")


def test_the_hard_points_of_a_separate_model_are_not_closer_than_its_elements() -> None:
    model = {"kind": "separate", "element_size_mm": 8.0, "spacing_mm": 7.0}
    data: Json = {"controller": {"kind": "ifem", "model": model}}
    assert Scenario.load(data).resolved()["controller"]["model"]["spacing_mm"] == 7.0
    words = ("must be 8 to 50 or null", "interaction.line_compliance = false", "controller.model.element_size_mm = 8")
    refused({**data, "interaction": HARD}, "controller.model.spacing_mm", *words)


@pytest.mark.parametrize("tip", ["loose", "", None, True, 1])
def test_an_unknown_tip_is_refused(tip: Any) -> None:
    refused({"interaction": {"tip": tip}}, "interaction.tip", "'free' or 'held'")


@pytest.mark.parametrize("value", [1, 0, "yes", None, []])
def test_line_compliance_is_a_truth_value(value: Any) -> None:
    refused({"interaction": {"line_compliance": value}}, "interaction.line_compliance", "boolean")


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
    assert isinstance(path, SinePath)
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


@pytest.mark.parametrize("block", EVERY_KIND, ids=lambda block: block["kind"])
def test_a_delay_is_a_whole_number_of_steps(block: Json) -> None:
    base = {"dt_s": 0.02}
    refused(
        {**base, "controller": {**block, "delay_s": 0.03}}, "controller.delay_s", "multiple of dt_s = 0.02 s", "0 to 1"
    )
    (problem,) = refusal({**base, "controller": {**block, "delay_s": 0.013}}).problems
    assert str(problem).startswith("controller.delay_s = 0.013: must be a multiple of dt_s = 0.02 s")
    assert "the nearest is 0.02" in problem.message
    assert Scenario.load({**base, "controller": block}).delay_steps == 0
    for steps in (1, 3, 7, 50):
        assert Scenario.load({**base, "controller": {**block, "delay_s": steps * 0.02}}).delay_steps == steps


def test_every_kind_of_controller_has_been_asked() -> None:
    kinds = {kind.model_fields["kind"].default for kind in get_args(get_args(controller_blocks.Controller)[0])}
    assert kinds - {block["kind"] for block in EVERY_KIND} == {"elm", "neighbours", "mlp", "plugin"}
    assert all("delay_s" in kind.model_fields for kind in get_args(get_args(controller_blocks.Controller)[0]))


@pytest.mark.parametrize("field", ["delay_s", "rcm_weight"])
@pytest.mark.parametrize("value", [-1e-3, 10.001])
def test_delay_and_weight_out_of_range_are_refused_with_it(field: str, value: float) -> None:
    allowed = {"delay_s": "0 to 1", "rcm_weight": "0 to 10"}[field]
    refused({"controller": {"kind": "ifem", field: value}}, f"controller.{field}", allowed)


def test_an_unknown_orientation_is_refused() -> None:
    refused({"controller": {"kind": "ifem", "orientation": "free"}}, "controller.orientation", "'rcm' or 'axis'")


def test_several_problems_are_all_named() -> None:
    error = refusal({"seed": -1, "tissue": {"poisson": 0.5, "elastic": 1}, "controller": {"gain": 3, "kind": "ifem"}})
    assert sorted(p.field for p in error.problems) == ["controller.gain", "seed", "tissue.elastic", "tissue.poisson"]
    hard = {**HARD, "spacing_mm": 5.0, "spread_mm": 0.05}
    between = {"needle": {"inner_diameter_mm": 2.0}, "interaction": hard, "dt_s": 0.1}
    fields = {"needle.inner_diameter_mm", "interaction.spacing_mm", "interaction.spread_mm"}
    assert {p.field for p in refusal(between).problems} == fields
