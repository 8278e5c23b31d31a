"""What a job's page says in a few words: what was run, what was set, what its numbers mean."""

from __future__ import annotations

import json
import math
import shlex
from typing import Any

import pytest

from service.web.job_facts import as_given, differences, measures, path_words, ways_to_run
from simcore.metric_definitions import METRICS
from simcore.scenario.presets import preset, preset_names
from simcore.scenario.scenario import Scenario


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ({"target_mm": [18, 31, 40]}, "a straight line, (18, 31, 0) to (18, 31, 40) mm, 10 mm/s"),
        ({"kind": "sine", "target_mm": [18, 31, 40], "amplitude_mm": 1.5}, "a sine of 1.5 mm, (18, 31, 0) to"),
        ({"kind": "arc", "target_mm": [18, 31, 40], "radius_mm": 400}, "an arc with a radius of 400 mm, "),
        (
            {"kind": "waypoints", "points_mm": [[18, 31, 20], [19, 31, 40]]},
            "a curve through 2 points, (18, 31, 0) to (19",
        ),
        ({"kind": "reach", "target_mm": [18, 31, 40]}, "a target without a path, (18, 31, 0) to (18, 31, 40) mm"),
    ],
)
def test_a_path_in_words(path: dict[str, Any], words: str) -> None:
    assert path_words(Scenario.load({"trajectory": path}).resolved()).startswith(words)


def test_nothing_differs_from_the_defaults_but_what_was_set() -> None:
    assert differences(Scenario.load({"name": "mine"}).resolved()) == []
    changes = {"trajectory": {"kind": "sine", "target_mm": [20, 31, 100]}, "controller": {"kind": "elm"}, "seed": 4}
    found = {one.field: (one.value, one.default) for one in differences(Scenario.load(changes).resolved())}
    assert found == {"seed": (4, 0), "trajectory.target_mm": ([20.0, 31.0, 100.0], [18.0, 31.0, 122.0])}
    dt_s = {one.field for one in differences(Scenario.load({"dt_s": 0.02}).resolved())}
    assert dt_s == {"dt_s"}, "a default that follows from another field is no difference of its own"


@pytest.mark.parametrize("name", preset_names())
def test_every_built_in_scenario_can_be_told(name: str) -> None:
    scenario = preset(name).resolved()
    assert path_words(scenario)
    assert all(one.field != "name" for one in differences(scenario))


@pytest.mark.parametrize(
    "given",
    [
        {"name": "mine"},
        {"name": "its (own)", "trajectory": {"kind": "sine", "target_mm": [18, 31, 40]}, "controller": {"kind": "elm"}},
        {"tissue": {"fixed_faces": ["z_max"]}, "controller": {"orientation": "axis"}, "dt_s": 0.02, "seed": 3},
    ],
)
def test_what_is_offered_to_be_copied_is_the_same_scenario(given: dict[str, Any]) -> None:
    scenario = Scenario.load(given).resolved()
    assert Scenario.load(as_given(scenario)).resolved() == scenario
    ways = ways_to_run(scenario, "http://127.0.0.1:1")
    spoken = shlex.split(ways["curl"])
    assert Scenario.load(json.loads(spoken[-1])["scenario"]).resolved() == scenario
    file, *_ = shlex.split(ways["Command line"].partition(" > ")[0].removeprefix("echo "))
    assert Scenario.load(json.loads(file)).resolved() == scenario
    seen: list[Any] = []
    code = ways["Python"].replace("from needlebench import Scenario, run", "")
    exec(code, {"Scenario": Scenario, "run": seen.append})  # the text under test
    assert seen[0].resolved() == scenario


def test_a_long_scenario_is_not_offered_to_be_copied() -> None:
    poses = [[0.018, 0.031, -0.126 + 1e-5 * i, 1.0, 0.0, 0.0, 0.0] for i in range(200)]
    scenario = {**Scenario().resolved(), "controller": {"kind": "replay", "poses": poses}}
    assert ways_to_run(scenario, "http://127.0.0.1:1") == {}


def test_a_number_says_what_it_means_and_whether_it_is_odd() -> None:
    values = {"rcm_max_mm": 0.2, "max_needle_stress_mpa": 5000.0, "success": False, "own": 1, "rmse_axis_mm": [1, 2, 3]}
    told = {one.name: one for one in measures("metrics", values)}
    assert not told["rcm_max_mm"].odd
    assert (told["rcm_max_mm"].unit, told["max_needle_stress_mpa"].unit) == ("mm", "MPa")
    assert told["max_needle_stress_mpa"].odd
    assert told["success"].odd
    assert told["success"].sane_range == "yes"
    assert told["own"].definition == ""
    assert {"rmse_axis_mm x", "rmse_axis_mm y", "rmse_axis_mm z"} <= told.keys()


def test_every_metric_is_known_by_its_key() -> None:
    for metric in METRICS:
        part, _, name = metric.key.partition(".")
        (one,) = measures(part, {name: math.nan})
        assert one.definition == metric.definition
        assert not one.odd
