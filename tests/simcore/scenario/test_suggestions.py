"""Messages that say what was probably meant: names, units, lists; and scenarios given by name or as data."""

from __future__ import annotations

import tracemalloc
from typing import Any

import pytest

from simcore.errors import ScenarioError
from simcore.scenario.presets import preset
from simcore.scenario.scenario import Scenario
from tests.simcore.mesh.test_mesh_cases import FILES


def message(data: Any) -> str:
    with pytest.raises(ScenarioError) as caught:
        Scenario.load(data)
    return str(caught.value)


@pytest.mark.parametrize(
    ("data", "meant"),
    [
        ({"tissue": {"young_kp": 5}}, "did you mean young_kpa?"),
        ({"tisue": {}}, "did you mean tissue?"),
        ({"tissue": {"friction": 0.1}}, "did you mean interaction.friction?"),
        ({"controller": {"kind": "ifm"}}, "did you mean ifem?"),
        ({"trajectory": {"kind": "sinus"}}, "did you mean sine?"),
        ({"tissue": {"fixed_faces": ["ymin"]}}, "did you mean y_min?"),
        ({"controller": {"kind": "ifem", "rcm_weigt": 1}}, "did you mean rcm_weight?"),
        ({"controller": {"kind": "plugin", "name": "ifm"}}, "did you mean ifem?"),
        ({"controller": {"kind": "plugin", "name": "mcp"}}, "did you mean mpc?"),
        ("deno", "did you mean demo?"),
    ],
)
def test_a_name_that_is_nearly_right(data: Any, meant: str) -> None:
    assert meant in message(data)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"tissue": {"young_kpa": 6300}}, "0.1 to 1000 kPa); is it 6300 Pa? that is 6.3 kPa"),
        ({"tissue": {"size_mm": [0.036, 0.062, 0.122]}}, "is it 0.036 m? that is 36 mm"),
        ({"needle": {"length_mm": 0.18}}, "20 to 1000 mm); is it 0.18 m? that is 180 mm"),
        ({"needle": {"young_gpa": 200_000}}, "is it 200000 MPa? that is 200 GPa"),
        ({"robot": {"max_speed_mm_s": 0.05}}, "is it 0.05 m/s? that is 50 mm/s"),
        ({"dt_s": 10}, "0.0001 to 0.1 s); is it 10 ms? that is 0.01 s"),
    ],
)
def test_a_range_has_its_unit_and_a_number_that_fits_another_is_noticed(data: Any, words: str) -> None:
    assert words.replace("0.1 to 1000 kPa)", "0.1 to 1000 kPa)") in message(data)


def test_a_number_that_fits_no_other_unit_is_not_guessed_at() -> None:
    assert "is it" not in message({"tissue": {"young_kpa": -1}})


@pytest.mark.parametrize(
    ("value", "written"),
    [("18,31,80", "write [18,31,80]"), ("18 31 80", "write [18,31,80]"), ("18, 31, 80", "write [18,31,80]")],
)
def test_a_list_as_text_is_written_as_one(value: str, written: str) -> None:
    assert written in message({"trajectory": {"target_mm": value}})


def test_names_as_text_are_written_as_a_list() -> None:
    assert 'write ["y_min", "y_max"]' in message({"tissue": {"fixed_faces": "y_min,y_max"}})


@pytest.mark.parametrize(
    ("trajectory", "words"),
    [
        (
            {"target_mm": [0.018, 0.031, 0.08]},
            "0.1 <= z <= 122 mm; is it [0.018, 0.031, 0.08] m? that is [18, 31, 80] mm",
        ),
        ({"target_mm": [180000, 310000, 800000]}, "0.1 <= z <= 122 mm"),
        ({"target_mm": [18000, 31000, 80000]}, "is it [18000, 31000, 80000] um? that is [18, 31, 80] mm"),
        ({"entry_mm": [18000, 31000, 0]}, "0 < y < 62 mm; is it [18000, 31000, 0] um? that is [18, 31, 0] mm"),
        ({"kind": "waypoints", "points_mm": [[0.018, 0.031, 0.08]]}, "is it [0.018, 0.031, 0.08] m?"),
    ],
)
def test_a_point_that_fits_in_another_unit_is_noticed(trajectory: dict[str, Any], words: str) -> None:
    assert words in message({"trajectory": trajectory})


def test_points_on_a_mesh_in_metres_are_noticed() -> None:
    """Of the whole path, or of the entry alone. The box begins at x = 100 mm."""
    tissue = {"mesh_file": str(FILES / "instance_translated.inp"), "fixed_sets": ["Fixed"]}
    path = {"entry_mm": [0.12, 0.02, 0.06], "target_mm": [120, 20, 20]}
    assert "is it [0.12, 0.02, 0.06] m? that is [120, 20, 60] mm" in message({"tissue": tissue, "trajectory": path})
    path["target_mm"] = [0.12, 0.02, 0.02]
    assert "is 0.04 mm from trajectory.entry_mm; it must be at least 0.1 mm; are its points in metres?" in message(
        {"tissue": tissue, "trajectory": path}
    )


def test_a_list_that_is_too_long_is_one_problem() -> None:
    """However wrong its items are: to describe each of a third of a million took more than a gigabyte."""
    lists = [("tissue", "fixed_faces", 100), ("tissue", "fixed_sets", 100), ("tissue", "fixed_regions", 100)]
    for block, field, most in [*lists, ("trajectory", "points_mm", 500)]:
        kind = {"kind": "waypoints"} if block == "trajectory" else {}
        tracemalloc.start()
        said = message({block: {**kind, field: [[]] * 100_000}})
        _, peak_bytes = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert f"{block}.{field} = " in said
        assert f"holds 100000 items, at most {most} are allowed" in said
        assert peak_bytes < 30e6, f"{field}: {peak_bytes / 1e6:.0f} MB"


def test_a_path_in_metres_is_warned_of() -> None:
    short = {"trajectory": {"entry_mm": [0.018, 0.031, 0], "target_mm": [0.018, 0.031, 0.122]}}
    assert "0.122 mm long; are its points in metres?" in Scenario.load(short).warnings()[0]
    assert preset("demo").warnings() == []


def test_a_built_in_scenario_is_loaded_by_its_name() -> None:
    assert Scenario.load("demo") == preset("demo")
    assert "for a file: Scenario.load(open(name).read())" in message("mine.json")
    assert "is not JSON" in message('{"tissue": ')
    assert message("deno").startswith("scenario = 'deno': is not JSON, and is not a built-in scenario")
