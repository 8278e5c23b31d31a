"""Messages that say what was probably meant: names, units, lists; and scenarios given by name or as data."""

from __future__ import annotations

from typing import Any

import pytest

from simcore.errors import ScenarioError
from simcore.scenario.presets import preset
from simcore.scenario.scenario import Scenario


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


def test_a_path_in_metres_is_warned_of() -> None:
    short = {"trajectory": {"entry_mm": [0.018, 0.031, 0], "target_mm": [0.018, 0.031, 0.122]}}
    assert "0.122 mm long; are its points in metres?" in Scenario.load(short).warnings()[0]
    assert preset("demo").warnings() == []


def test_a_built_in_scenario_is_loaded_by_its_name() -> None:
    assert Scenario.load("demo") == preset("demo")
    assert "for a file: Scenario.load(open(name).read())" in message("mine.json")
    assert "is not JSON" in message('{"tissue": ')
