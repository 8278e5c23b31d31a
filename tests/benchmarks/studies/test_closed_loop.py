"""Bands of closed loops: by hand, unknown where a run fails, the widest of a suite; what an interruption leaves."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path as Folder
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import pytest

from benchmarks.observed_run import ObservedRun
from benchmarks.paper.bands import MEASURED, MEASURED_ON, UNKNOWN
from benchmarks.paper.scale import SCALES
from benchmarks.paper.suites import cases_along, resolve_cases
from benchmarks.ports import BenchPorts
from benchmarks.settling.scale import END_POINTS
from benchmarks.studies import closed_loop
from benchmarks.studies.closed_loop import (
    CONTROLLERS,
    LOOP_PATHS,
    STORE,
    LoopRun,
    closed_loops,
    identity,
    loop_scenarios,
    loop_suite_bands,
    quantities,
)
from benchmarks.studies.closed_loop_report import loop_json, loop_markdown, loop_picture, loop_tables
from benchmarks.studies.discretisation import FULL, QUICK
from simcore.scenario.scenario import Scenario
from tests.benchmarks.studies.loops import made_path, made_paths

if TYPE_CHECKING:
    from collections.abc import Sequence

RESULTS = Folder(__file__).parents[3] / "benchmarks" / "results" / "convergence"


# ---- bands


def test_a_band_by_hand() -> None:
    """First order in the mesh: 1.25 times what is left at 4.4 mm, and the way there from 6 mm."""
    path = made_path("cur-073+y", "CUR", 0.004, extra=0.002)
    for name, slope in (("ifem", 0.004), ("elm", 0.006), ("elm minus ifem", 0.002)):
        band = path.band(name)
        assert band.band == pytest.approx(slope * (1.6 + 1.25 * 4.4))
        assert band.parts is not None
        assert band.parts["mesh"].order == pytest.approx(1.0, abs=1e-6)
        assert band.parts["spacing"].default == band.parts["ball"].default == 0.0
    assert path.band("elm minus ifem").values["mesh", 6.0] == pytest.approx(0.08 + 6.0 * 0.002)


def test_a_difference_may_have_no_band_where_both_have_one() -> None:
    path = made_path("cur-073+y", "CUR", 0.004)
    assert path.band("elm").band == pytest.approx(0.004 * 7.1)
    assert path.band("elm minus ifem").band == pytest.approx(0.0, abs=1e-12)


def test_mesh_spacing_and_ball_are_added() -> None:
    path = made_path("cur-073+y", "CUR", 0.004)
    runs = {**path.runs, ("elm", "ball", 4.0): LoopRun("completed", 0.13, 1.0)}
    runs["elm", "spacing", 2.0] = LoopRun("completed", 0.122, 1.0)
    band = replace(path, runs=runs).band("elm")
    assert band.parts is not None
    assert band.parts["ball"].default == pytest.approx(3.0 * 0.006)
    assert band.parts["spacing"].default == pytest.approx(3.0 * 0.002)
    assert band.band == pytest.approx(0.004 * 7.1 + 0.018 + 0.006)


@pytest.mark.parametrize("failed", [LoopRun("inverted", 0.05, 1.0), LoopRun("completed", None, None)])
def test_a_run_that_fails_leaves_its_controller_without_a_band(failed: LoopRun) -> None:
    paths = made_paths()
    paths[3] = replace(paths[3], runs={**paths[3].runs, ("elm", "mesh", 4.4): failed})
    bands = loop_suite_bands(paths)
    assert bands["CUR"]["elm"] is bands["CUR"]["elm minus ifem"] is None
    assert bands["CUR"]["ifem"] is not None
    assert bands["LIN"]["elm"] is not None


def test_a_suite_carries_the_widest_of_its_paths() -> None:
    bands = loop_suite_bands(made_paths())
    assert bands["LIN"]["ifem"] == pytest.approx(0.001 * 7.1)
    assert bands["CUR"]["ifem"] == pytest.approx(0.004 * 7.1)
    assert bands["CUR"]["elm minus ifem-axis"] == pytest.approx(0.001 * 7.1)
    assert set(bands["CUR"]) == set(quantities())


# ---- what is run


def test_the_paths_are_none_of_the_settling_experiment() -> None:
    assert not {path.end_point for path in LOOP_PATHS} & set(END_POINTS)
    curved = [path for path in LOOP_PATHS if path.direction]
    assert len(curved) >= 6
    assert {path.direction for path in curved} == {"+x", "-x", "+y", "-y"}
    assert len({path.name for path in LOOP_PATHS}) == len(LOOP_PATHS)


@pytest.mark.parametrize("chosen", [FULL, QUICK])
def test_six_discretisations_of_each_controller(chosen: Any) -> None:
    scenarios = loop_scenarios(LOOP_PATHS[2], chosen, quick=chosen is QUICK)
    for name in CONTROLLERS:
        mine = {key: scenario for key, scenario in scenarios.items() if key[0] == name}
        assert len(mine) == 8
        assert len({identity(scenario) for scenario in mine.values()}) == 6
    assert scenarios["elm", "ball", 4.0].interaction.spread_mm == 4.0
    assert all(scenario.controller.delay_s == 0.0 for scenario in scenarios.values())


@pytest.mark.slow
def test_the_default_is_what_the_paper_is_rerun_on() -> None:
    """The same scenarios as those of the full scale but for names and recordings."""
    for path in LOOP_PATHS:
        mine = loop_scenarios(path, FULL, quick=False)
        cases = resolve_cases(cases_along(SCALES["full"], {}, [path], ("ifem", "elm")))
        for case in cases:
            here, there = mine[str(case.labels["arm"]), "mesh", 6.0], Scenario.load(case.scenario)
            assert here.model_dump(exclude={"name"}) == there.model_dump(exclude={"name"})


def test_the_claims_have_the_committed_bands() -> None:
    """benchmarks/results is in no wheel, so the numbers stand in `bands.MEASURED` too."""
    committed = json.loads((RESULTS / "convergence.json").read_text()).get("closed_loop")
    if committed is None:
        assert MEASURED == UNKNOWN
        return
    assert committed["suites"] == MEASURED.suites
    assert str(committed["commit"])[:12] in MEASURED.source
    here = committed["discretisation"]
    assert {name: here[name] for name in MEASURED_ON} == MEASURED_ON
    plain = Scenario.load({})
    assert (here["spacing_mm"], here["spread_mm"]) == (plain.interaction.spacing_mm, plain.interaction.spread_mm)


# ---- a study that is interrupted


class Counting:
    """A crew that makes results up, and breaks off after some paths."""

    def __init__(self, paths: int) -> None:
        self.left, self.ran = paths, 0

    def __enter__(self) -> Counting:
        return self

    def __exit__(self, *_error: object) -> None:
        return None

    def seconds(self, _batches: Sequence[Sequence[Scenario]]) -> float:
        raise NotImplementedError

    def run_many(self, scenarios: Sequence[Scenario]) -> list[ObservedRun]:
        if not self.left:
            raise KeyboardInterrupt
        self.left, self.ran = self.left - 1, self.ran + len(scenarios)
        metrics = {"rmse_commanded_mm": 0.1, "rcm_max_mm": 0.5}
        return [ObservedRun("completed", "", metrics, {}, {}) for _ in scenarios]


def made_ports(crew: Counting, notes: dict[str, str], folder: Folder) -> BenchPorts:
    return BenchPorts(
        say=lambda _: None,
        recorder=lambda _: (_ for _ in ()).throw(NotImplementedError),
        recorder_name="",
        crew=lambda _: crew,
        folder=folder,
        kept=notes.get,
        keep=notes.__setitem__,
    )


@pytest.mark.parametrize(("commit", "again"), [("abc", 7), ("abc-dirty", 8), (None, 8)])
def test_it_goes_on_where_it_was_interrupted(
    commit: str | None, again: int, monkeypatch: pytest.MonkeyPatch, tmp_path: Folder
) -> None:
    """By the same commit; what a changed checkout ran is run again."""
    monkeypatch.setattr(closed_loop, "commit", lambda: commit)
    notes: dict[str, str] = {}
    with pytest.raises(KeyboardInterrupt):
        closed_loops(made_ports(Counting(1), notes, tmp_path))
    assert len(json.loads(notes[STORE])["runs"]) == 18
    second = Counting(99)
    done = closed_loops(made_ports(second, notes, tmp_path))
    assert second.ran == 18 * again
    assert [path.name for path in done] == [path.name for path in LOOP_PATHS]


# ---- what is written


def test_what_is_written() -> None:
    paths = made_paths()
    failed = {**paths[3].runs, ("elm", "mesh", 4.4): LoopRun("inverted", 0.05, 1.0)}
    paths[3] = replace(paths[3], runs=failed)
    document = json.loads(json.dumps(loop_json(paths, FULL), allow_nan=False))
    assert document["suites"]["CUR"]["elm"] is None
    assert document["suites"]["LIN"]["ifem"] == pytest.approx(0.0071)
    assert document["discretisation"] == {"element_size_mm": 6.0, "spacing_mm": 3.0, "spread_mm": 6.0, "dt_s": 0.01}
    steep = document["paths"]["cur-073+y"]
    assert steep["statuses"]["elm"]["mesh 4.4"] == "inverted"
    assert steep["rmse_commanded_mm"]["elm"]["values"]["mesh 4.4"] is None
    carried, bands, rcm = loop_tables(paths)
    assert [row[0] for row in carried.rows] == ["LIN", "CUR"]
    assert len(bands.rows) == 4 * 5
    assert len(bands.columns) == len(bands.rows[0])
    assert bands.columns[3:8] == ("mesh 8", "mesh 4.4", "spacing 4.5", "spacing 2", "ball 4")
    assert len(rcm.rows) == 4 * 3
    assert "| CUR | 0.0284 | 0.0284 | - |" in loop_markdown(paths)
    ElementTree.fromstring(loop_picture(paths))
