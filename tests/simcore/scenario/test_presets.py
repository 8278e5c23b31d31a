"""The built-in scenarios and changes by dotted path."""

from __future__ import annotations

import copy
import json
import math
from typing import Any

import numpy as np
import pytest

from simcore.errors import ScenarioError
from simcore.scenario.point_rules import without_derived
from simcore.scenario.presets import preset, preset_names, start, with_changes
from simcore.scenario.scenario import InverseFem, Replay, Scenario, SineTrajectory, StraightTrajectory
from simcore.trajectory import targets

RESOLVED = Scenario().resolved()
HARD = Scenario.load({"interaction": {"line_compliance": False}}).resolved()


def test_names_and_texts() -> None:
    names = preset_names()
    assert list(names) == ["demo", "line", "sine", "replay"]
    assert all(text and "\n" not in text for text in names.values())


@pytest.mark.parametrize("name", preset_names())
def test_a_preset_is_valid_and_resolves_to_itself(name: str) -> None:
    scenario = preset(name)
    assert scenario.name == name
    assert Scenario.load(json.dumps(scenario.resolved())) == scenario
    assert scenario.interaction.spacing_mm == 3.0
    assert scenario.warnings() == []


@pytest.mark.parametrize("name", ["", "Demo", "demo ", "nosuch"])
def test_an_unknown_preset_is_refused_with_the_known_ones(name: str) -> None:
    with pytest.raises(ScenarioError, match="is not a built-in scenario: demo, line, sine, replay"):
        preset(name)


def test_presets_do_not_share_state() -> None:
    first = preset("demo").resolved()
    first["trajectory"]["target_mm"][2] = 1.0
    assert preset("demo").resolved()["trajectory"]["target_mm"][2] == 122.0


def test_demo_is_curved_full_depth_and_steered() -> None:
    demo = preset("demo")
    assert isinstance(demo.controller, InverseFem)
    assert isinstance(demo.trajectory, SineTrajectory)
    assert demo.trajectory.target_mm[2] == demo.tissue.size_mm[2] == 122.0
    path = demo.path()
    chord = path.end_m - path.entry_m
    away = np.linalg.norm(np.cross(path.curve(np.linspace(0, 1, 101)) - path.entry_m, chord), axis=1)
    assert away.max() / np.linalg.norm(chord) > 1.5e-3
    aside = path.curve(np.linspace(0, 1, 101))[:, 0] - path.entry_m[0]
    assert (aside.min(), aside.max()) == pytest.approx((-2e-3, 2e-3), rel=1e-3), "to both sides along x"
    assert path.end_m[1] - path.entry_m[1] == pytest.approx(7e-3), "and oblique along y"
    assert demo.recording.enabled


def test_line_is_oblique_and_sine_overlays_it_by_a_millimetre() -> None:
    line, sine = preset("line"), preset("sine")
    assert type(line.trajectory) is StraightTrajectory
    assert isinstance(sine.trajectory, SineTrajectory)
    assert sine.trajectory.amplitude_mm == 1.0
    assert line.trajectory.target_mm == sine.trajectory.target_mm
    assert line.trajectory.target_mm[:2] != line.trajectory.entry_mm[:2]


def test_replay_begins_at_the_entry_and_keeps_its_depth_below_the_needle() -> None:
    scenario = preset("replay")
    assert isinstance(scenario.controller, Replay)
    poses = np.array(scenario.controller.poses)
    tips = poses[:, :3] + [0.0, 0.0, scenario.needle.length_mm]
    gaps = np.linalg.norm(np.diff(np.vstack([scenario.trajectory.entry_mm, tips]), axis=0), axis=1)
    assert gaps.max() < 0.1 + 1e-6
    assert 0.0 < tips[:, 2].max() < scenario.tissue.size_mm[2]
    assert (np.diff(tips[:, 2]) < -1e-3).any(), "pulls back"
    assert scenario.steps == len(poses)


@pytest.mark.parametrize("name", ["demo", "line", "sine"])
def test_the_targets_of_a_preset_stay_in_the_block(name: str) -> None:
    scenario = preset(name)
    points = targets(scenario.path(), speed_m_s=0.01, dt_s=scenario.dt_s, steps=scenario.steps) * 1e3
    assert (points >= -1e-9).all()
    assert (points <= np.array(scenario.tissue.size_mm) + 1e-9).all()
    np.testing.assert_allclose(points[-1], scenario.trajectory.end_mm, atol=1e-9)


# ---- with_changes


def changed(*changes: str, data: dict[str, Any] | None = None) -> dict[str, Any]:
    return with_changes(copy.deepcopy(RESOLVED) if data is None else data, list(changes))


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("5.5", 5.5),
        ("1e-3", 1e-3),
        (" 7 ", 7),
        ("true", True),
        ("null", None),
        ("[1, 2]", [1, 2]),
        ('{"a": 1}', {"a": 1}),
        ('"5"', "5"),
        ("", ""),
        ("soft tissue", "soft tissue"),
        ("a=b", "a=b"),
        ("[1, 2", "[1, 2"),
        ("True", "True"),
        ("0x10", "0x10"),
    ],
)
def test_a_value_is_json_else_a_string(text: str, value: Any) -> None:
    assert changed(f"name={text}", data={}) == {"name": value}


@pytest.mark.parametrize("text", ["9" * 5000, "[" * 100_000, '{"a":' * 100_000])
def test_a_monstrous_value_is_a_string_that_the_scenario_refuses(text: str) -> None:
    data = changed(f"name={text}")
    assert data["name"] == text
    with pytest.raises(ScenarioError, match="name = "):
        Scenario.load(data)


def test_not_a_number_surfaces_from_load() -> None:
    data = changed("dt_s=NaN")
    assert math.isnan(data["dt_s"])
    with pytest.raises(ScenarioError, match="dt_s = nan: should be a finite number"):
        Scenario.load(data)


def test_changes_apply_left_to_right() -> None:
    assert changed("seed=1", "seed=2")["seed"] == 2
    data = changed("trajectory.amplitude_mm=2", "trajectory.kind=sine", "trajectory.periods=2", "tissue.young_kpa=5")
    assert data["trajectory"] == {"kind": "sine", "periods": 2}
    scenario = Scenario.load(data)
    assert isinstance(scenario.trajectory, SineTrajectory)
    assert (scenario.trajectory.amplitude_mm, scenario.trajectory.periods) == (1.0, 2.0)
    assert scenario.tissue.young_kpa == 5.0


def test_a_new_kind_replaces_its_block_by_its_defaults() -> None:
    data = preset("sine").resolved()
    line = Scenario.load(with_changes(data, ["trajectory.kind=line"]))
    assert line.trajectory == StraightTrajectory()
    assert Scenario.load(with_changes(data, ["controller.kind=open_loop"])).controller.kind == "open_loop"
    replay = preset("replay").resolved()
    assert Scenario.load(with_changes(replay, ["controller.kind=ifem"])).controller == InverseFem()


def test_the_same_kind_keeps_its_block() -> None:
    data = preset("sine").resolved()
    assert with_changes(data, ["trajectory.kind=sine", 'controller.kind="ifem"']) == data


def test_a_block_can_be_given_whole() -> None:
    data = changed('trajectory={"kind": "sine", "amplitude_mm": 2}')
    assert Scenario.load(data).resolved()["trajectory"]["amplitude_mm"] == 2.0


def test_blanks_around_the_path_do_not_matter() -> None:
    assert changed(" tissue.young_kpa =5")["tissue"]["young_kpa"] == 5


def test_the_original_is_left_alone() -> None:
    data = preset("demo").resolved()
    before = copy.deepcopy(data)
    with_changes(data, ["trajectory.kind=line", "tissue.young_kpa=1", "seed=9"])
    assert data == before


@pytest.mark.parametrize("change", ["seed", "", "=5", " =5", "tissue.young_kpa"])
def test_a_change_without_path_or_value_is_refused(change: str) -> None:
    with pytest.raises(ScenarioError, match="must be PATH=VALUE"):
        changed(change)


@pytest.mark.parametrize("change", ["seed.x=1", "tissue.young_kpa.low=1", "controller.gain.kind=ifem"])
def test_a_path_through_a_value_is_refused(change: str) -> None:
    with pytest.raises(ScenarioError, match=r"seed|young_kpa|gain"):
        changed(change)


@pytest.mark.parametrize(
    "change",
    ["tisue.young_kpa=5", "tissue.young=5", "sed=1", "kind=sine", "tissue..young_kpa=5", ".seed=1", "tissue.=1"],
)
def test_a_path_to_no_field_is_refused_by_load(change: str) -> None:
    with pytest.raises(ScenarioError, match="unknown field; known here"):
        Scenario.load(changed(change))


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ("tissue.poisson=0.5", "tissue.poisson"),
        ("interaction.line_compliance=false", "interaction.spacing_mm"),
        ("trajectory.kind=circle", "trajectory.kind"),
        ("controller.kind=replay", "controller.poses"),
        ("tissue=5", "tissue"),
        ("name=5", "name"),
        ("needle.length_mm=100", "needle.length_mm"),
    ],
)
def test_a_wrong_value_is_refused_by_load(change: str, field: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        Scenario.load(changed(change))
    assert [problem.field for problem in caught.value.problems] == [field]


def test_null_derives_the_spacing_anew() -> None:
    null = ("tissue.element_size_mm=10", "interaction.spacing_mm=null")
    assert Scenario.load(changed(*null, data=HARD)).interaction.spacing_mm == 10.0
    assert Scenario.load(changed(*null)).interaction.spacing_mm == 3.0


# ---- a start for changes


@pytest.mark.parametrize("name", preset_names())
def test_the_spacing_of_a_built_in_scenario_follows_its_elements_where_points_are_hard(name: str) -> None:
    assert start(name)["interaction"]["spacing_mm"] is None
    assert Scenario.load(start(name)) == preset(name)
    coarse = ["tissue.element_size_mm=10"]
    assert Scenario.load(with_changes(start(name), coarse)).interaction.spacing_mm == 3.0
    hard = Scenario.load(with_changes(start(name), ["interaction.line_compliance=false", *coarse]))
    assert hard.interaction.spacing_mm == 10.0
    again = without_derived(hard.resolved())
    assert again["interaction"]["spacing_mm"] is None
    assert Scenario.load(with_changes(again, ["tissue.element_size_mm=8"])).interaction.spacing_mm == 8.0


@pytest.mark.parametrize("line_compliance", [True, False])
def test_a_spacing_that_was_chosen_stays(line_compliance: bool) -> None:
    chosen = Scenario.load({"interaction": {"spacing_mm": 9, "line_compliance": line_compliance}}).resolved()
    assert without_derived(chosen) == chosen
    assert chosen["interaction"]["spacing_mm"] == 9.0


@pytest.mark.parametrize(("line_compliance", "derived"), [(True, 3.0), (False, 8.0)])
def test_the_spacing_of_a_separate_model_is_derived_too(line_compliance: bool, derived: float) -> None:
    asked = {
        "interaction": {"line_compliance": line_compliance},
        "controller": {"kind": "ifem", "model": {"kind": "separate", "element_size_mm": 8}},
    }
    resolved = Scenario.load(asked).resolved()
    assert resolved["controller"]["model"]["spacing_mm"] == derived
    opened = without_derived(resolved)
    assert opened["controller"]["model"]["spacing_mm"] is None
    assert Scenario.load(opened).resolved() == resolved
    chosen = without_derived(Scenario.load(with_changes(asked, ["controller.model.spacing_mm=9"])).resolved())
    assert chosen["controller"]["model"]["spacing_mm"] == 9.0


def test_a_model_by_its_name_is_left_alone() -> None:
    resolved = Scenario.load({"controller": {"kind": "elm"}}).resolved()
    assert without_derived(resolved)["controller"] == resolved["controller"]
