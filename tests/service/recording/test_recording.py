"""What is emitted is what is recorded, whatever happens to the buffers, the run or the process."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from service.display import job_text, plain_values
from service.recording.colors import DISPLACEMENT_SCALE_M, displacement_colors
from service.recording.legend import FORCE_ARROW_M_PER_N
from service.recording.observer import RerunObserver
from service.recording.plots import PLOTS, Moment, Step
from service.worker.attempt import ObserverGroup
from simcore.scenario.scenario import StraightTrajectory
from tests.service.fake_run import FakeRun
from tests.service.recording.recorded import STEPS, Keeper, reader, recorded, short, static

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from simcore.arrays import Floats
    from simcore.rollout.records import StepRecord


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Keeper]:
    """One recorded run, and what it emitted."""
    path, keeper = tmp_path_factory.mktemp("recorded") / "recording.rrd", Keeper()
    with RerunObserver(path, recording_id="kept", provenance={"commit": "abc1234", "job_id": "j"}) as recorder:
        FakeRun(short()).run(ObserverGroup((recorder, keeper)))
    assert recorder.warning is None
    return path, keeper


def test_the_fake_run_overwrites_what_it_handed_out() -> None:
    run = FakeRun(short())
    first = run.record(10)
    tip, shaft, tissue = first.tip_m.copy(), first.shaft_m.copy(), run.tissue.copy()
    second = run.record(90)
    assert second.tip_m is first.tip_m
    assert (first.tip_m != tip).any()
    assert (first.shaft_m != shaft).any()
    assert (run.tissue != tissue).any()


@pytest.mark.slow
def test_positions_are_recorded_exactly(kept: tuple[Path, Keeper]) -> None:
    path, keeper = kept
    entities: dict[tuple[str, str], Callable[[StepRecord], Floats]] = {
        ("world/tip", "Points3D:positions"): lambda r: r.tip_m[None],
        ("world/target", "Points3D:positions"): lambda r: r.target_m[None],
        ("world/needle", "LineStrips3D:strips"): lambda r: r.shaft_m[None],
        ("world/points", "Points3D:positions"): lambda r: r.points_m,
        ("world/forces", "Arrows3D:origins"): lambda r: r.points_m,
    }
    for (entity, component), emitted in entities.items():
        rows = recorded(path, entity, component)
        assert list(rows) == list(range(STEPS + 1)), entity
        for record in keeper.records:
            expected = emitted(record).astype(np.float32)
            assert np.array_equal(rows[record.step].reshape(expected.shape), expected), (entity, record.step)


def test_force_arrows_are_the_scaled_forces(kept: tuple[Path, Keeper]) -> None:
    path, keeper = kept
    rows = recorded(path, "world/forces", "Arrows3D:vectors")
    assert len(rows[0]) == 0
    assert len(rows[STEPS]) > 3
    for record in keeper.records:
        expected = record.point_forces_n * FORCE_ARROW_M_PER_N
        assert np.allclose(rows[record.step].reshape(-1, 3), expected, rtol=1e-6, atol=0)


def test_plots_are_recorded_exactly(kept: tuple[Path, Keeper]) -> None:
    path, keeper = kept
    dt_s = keeper.scene.scenario.dt_s
    moments = [Moment.of(record) for record in keeper.records]
    for plot in PLOTS:
        rows = recorded(path, plot.entity, "Scalars:scalars")
        assert list(rows) == list(range(STEPS + 1))
        for record, now, before in zip(keeper.records, moments, moments[:1] + moments, strict=False):
            expected = np.array(plot.values(Step(record, now, before, dt_s)))
            assert np.array_equal(rows[record.step], expected), (plot.entity, record.step)


def test_plotted_numbers_in_their_units(kept: tuple[Path, Keeper]) -> None:
    path, keeper = kept
    middle = STEPS // 2
    before, record = keeper.records[middle - 1 : middle + 1]
    error = recorded(path, "metrics/error", "Scalars:scalars")[middle]
    assert error == pytest.approx([1e3 * np.linalg.norm(record.tip_m - before.target_m), 1e3 * record.rcm_error_m])
    forces = recorded(path, "metrics/forces", "Scalars:scalars")[middle]
    assert forces == pytest.approx([record.base_force_n[2], np.linalg.norm(record.base_force_n[:2])])
    trajectory = keeper.scene.scenario.trajectory
    assert isinstance(trajectory, StraightTrajectory)
    speed = trajectory.speed_mm_s
    assert recorded(path, "metrics/command", "Scalars:scalars")[middle][1] == pytest.approx(speed, rel=0.02)
    depth = recorded(path, "metrics/depth", "Scalars:scalars")[middle]
    assert depth[0] == pytest.approx(1e3 * keeper.scene.scenario.path().length_m / 2)


def test_commanded_and_actual_motion_are_told_apart(kept: tuple[Path, Keeper]) -> None:
    first = FakeRun(short()).record(1)
    start = first.base_position_m.copy()
    moved, commanded = start + np.array([0.0, 0.0, 1e-3]), start + np.array([0.0, 2e-3, 0.0])
    after = replace(first, base_position_m=moved, command_position_m=commanded, limited=True)
    before = Moment.of(replace(first, base_position_m=start))
    command = next(plot for plot in PLOTS if plot.entity == "metrics/command")
    values = command.values(Step(after, Moment.of(after), before, 0.01))
    names = [name for name, _ in command.series]
    assert dict(zip(names, values, strict=True)) == pytest.approx(
        {"commanded speed, mm/s": 200.0, "speed, mm/s": 100.0, "rotation, deg/s": 0.0, "limited, 1 = yes": 1.0}
    )
    assert static(kept[0], command.entity)["SeriesLines:names"] == names


def test_turn_rate_of_a_small_rotation() -> None:
    run = FakeRun(short())
    record, angle = run.record(1), np.radians(0.01)
    before = Moment.of(record)
    turned = np.array([np.cos(angle / 2), np.sin(angle / 2), 0.0, 0.0])
    command = next(plot for plot in PLOTS if plot.entity == "metrics/command")
    for sign in (1.0, -1.0):
        after = replace(record, base_rotation=sign * turned)
        rate = command.values(Step(after, Moment.of(after), before, 0.01))[2]
        assert rate == pytest.approx(1.0, rel=1e-9)


def test_tissue_frames_are_recorded_exactly(kept: tuple[Path, Keeper]) -> None:
    path, keeper = kept
    frames = {r.step: r.tissue_m for r in keeper.records if r.tissue_m is not None}
    nodes = np.unique(keeper.scene.surface_triangles)
    positions = recorded(path, "world/tissue/surface", "Mesh3D:vertex_positions")
    assert list(positions) == list(frames) == [*range(0, STEPS, 10), STEPS]
    for step, tissue in frames.items():
        assert np.array_equal(positions[step], tissue[nodes].astype(np.float32))
    triangles = np.array(static(path, "world/tissue/surface")["Mesh3D:triangle_indices"])
    assert np.array_equal(nodes[triangles], keeper.scene.surface_triangles)


def test_trail_joins_every_tip_once(kept: tuple[Path, Keeper]) -> None:
    path, keeper = kept
    pieces = [strips[0] for strips in recorded(path, "world/trail", "LineStrips3D:strips").values()]
    joined = np.concatenate([pieces[0], *(piece[1:] for piece in pieces[1:])])
    assert np.array_equal(joined, np.array([r.tip_m for r in keeper.records], np.float32))
    assert all(np.array_equal(a[-1], b[0]) for a, b in itertools.pairwise(pieces))


def test_time_is_in_whole_nanoseconds_and_there_is_no_wall_clock(kept: tuple[Path, Keeper]) -> None:
    path, keeper = kept
    times = recorded(path, "world/tip", "Points3D:positions", timeline="t")
    assert list(times) == [round(r.t_s * 1e9) for r in keeper.records]
    timelines = {name for chunk in reader(path).stream() for name in chunk.timeline_names}
    assert timelines == {"step", "t"}


def test_scenario_provenance_and_result_are_properties(kept: tuple[Path, Keeper]) -> None:
    path, keeper = kept
    result = static(path, "__properties/result")
    assert result["digest"] == [keeper.rollout.result()["digest"]]
    assert result["metrics.rmse_commanded_mm"] == [0.25]
    assert "metrics.final_same_time_mm" not in result  # null
    scenario = static(path, "__properties/scenario")
    assert (scenario["seed"], scenario["trajectory.amplitude_mm"]) == ([7.0], [3.0])
    assert static(path, "__properties/provenance")["commit"] == ["abc1234"]
    assert "**completed**" in static(path, "job")["TextDocument:text"][0]


def test_the_layout_shows_entities_that_exist(kept: tuple[Path, Keeper]) -> None:
    path, _ = kept
    entities = {chunk.entity_path for chunk in reader(path).stream()}
    (layout,) = reader(path).blueprints()
    origins = [
        origin
        for chunk in reader(path).stream(store=layout)
        if "ViewBlueprint:space_origin" in chunk.to_record_batch().schema.names
        for (origin,) in chunk.to_record_batch().column("ViewBlueprint:space_origin").to_pylist()
    ]
    assert len(origins) == 11
    for origin in origins:
        assert any(entity == origin or entity.startswith(f"{origin}/") for entity in entities), origin


def content(path: Path) -> dict[tuple[str, str, str], str]:
    """(entity, component, times) -> value of every row, however the rows are cut into chunks."""
    found = {}
    for chunk in reader(path).stream():
        if chunk.entity_path == "/__properties":  # the wall-clock time of its start
            continue
        columns = chunk.to_record_batch().to_pydict()
        for row in range(chunk.num_rows):
            times = str([columns[timeline][row] for timeline in sorted(chunk.timeline_names)])
            for name in columns.keys() - {"rerun.controls.RowId", *chunk.timeline_names}:
                found[chunk.entity_path, name, times] = str(columns[name][row])
    return found


@pytest.mark.slow
def test_the_same_run_gives_the_same_content_however_long_its_steps_take(tmp_path: Path) -> None:
    contents = []
    for name, step_s in (("first", 0.0), ("second", 0.0), ("slow", 0.3)):
        path, clock = tmp_path / f"{name}.rrd", itertools.count()
        with RerunObserver(path, recording_id=name, clock=lambda c=clock, s=step_s: s * next(c)) as recorder:  # type: ignore[misc]
            FakeRun(short()).run(recorder)
        assert recorder.warning is None
        contents.append(content(path))
    assert len(contents[0]) > 14 * STEPS
    assert contents[0] == contents[1] == contents[2]


def test_a_slow_run_is_sent_in_small_blocks(tmp_path: Path) -> None:
    path, now_s = tmp_path / "recording.rrd", itertools.count()
    with pytest.raises(RuntimeError), RerunObserver(path, recording_id="slow", clock=lambda: 0.4 * next(now_s)) as it:
        FakeRun(short(), stop_at=20, error=RuntimeError("here")).run(it)
    chunks = [c for c in reader(path).stream() if c.entity_path == "/world/tip" and not c.is_static]
    assert sum(chunk.num_rows for chunk in chunks) == 21
    assert max(chunk.num_rows for chunk in chunks) <= 3


@pytest.mark.slow
def test_nothing_is_recorded_if_the_scenario_says_so(tmp_path: Path) -> None:
    path = tmp_path / "recording.rrd"
    with RerunObserver(path, recording_id="off") as recorder:
        FakeRun(short(recording={"enabled": False})).run(recorder)
    assert recorder.warning is None
    assert list(tmp_path.iterdir()) == []


def test_colours_go_from_none_to_the_scale_and_no_further() -> None:
    moved = np.array([[0.0, 0, 0], [DISPLACEMENT_SCALE_M, 0, 0], [1.0, 0, 0]])
    first, full, beyond = displacement_colors(moved)
    assert full == beyond != first
    assert (first, full) == (0x3A4C6EFF, 0xF0543CFF)


def test_job_text_marks_what_differs_from_the_defaults() -> None:
    text = job_text(short(), None)
    assert "| trajectory.amplitude_mm | 3 | set |" in text
    assert "| tissue.young_kpa | 6.3 |  |" in text


def test_plain_values() -> None:
    data = {"a": {"b": 1, "c": None, "d": [1, "x"]}, "e": True, "scenario": {"f": 2}, "g": "text"}
    plain = plain_values(data, leave_out=("scenario",))
    assert plain == {"a.b": 1.0, "a.d": '[1, "x"]', "e": True, "g": "text"}
