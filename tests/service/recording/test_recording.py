"""What is emitted is what is recorded, whatever happens to the buffers, the run or the process."""

from __future__ import annotations

import copy
import itertools
import os
import signal
import subprocess
import sys
import time
import warnings
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from rerun.chunk import RrdReader
from rerun.error_utils import RerunWarning

from service.display import job_text, plain_values
from service.recording import observer as recording
from service.recording.blocks import BLOCK_STEPS
from service.recording.colors import DISPLACEMENT_SCALE_M, displacement_colors
from service.recording.legend import FORCE_ARROW_M_PER_N
from service.recording.observer import RerunObserver, optimize
from service.recording.plots import PLOTS, Moment, Step
from service.worker.attempt import ObserverGroup
from simcore.scenario.scenario import Scenario, StraightTrajectory
from tests.service.fake_run import FakeRollout, FakeRun

if TYPE_CHECKING:
    from collections.abc import Callable

    from simcore.arrays import Floats
    from simcore.rollout.records import Scene, StepRecord

STEPS = 230  # two full blocks and a part


def short(**changes: Any) -> Scenario:
    """A coarse scenario of STEPS steps."""
    data: dict[str, Any] = {
        "name": "short",
        "seed": 7,
        "tissue": {"element_size_mm": 20.0},
        "interaction": {"spacing_mm": 20.0},
        "trajectory": {"kind": "sine", "amplitude_mm": 3.0, "periods": 0.5, "target_mm": [18, 31, 40]},
    }
    scenario = Scenario.load({**data, **changes})
    speed = scenario.path().length_m * 1e3 / (STEPS * scenario.dt_s)
    data["trajectory"]["speed_mm_s"] = speed
    return Scenario.load({**data, **changes})


class Keeper:
    """Keeps a deep copy of every record at the time it is emitted."""

    def __init__(self) -> None:
        self.records: list[StepRecord] = []

    def begin(self, scene: Scene, first: StepRecord) -> None:
        self.scene = scene
        self.step(first)

    def step(self, record: StepRecord) -> None:
        self.records.append(copy.deepcopy(record))

    def end(self, rollout: Any) -> None:
        self.rollout = rollout


def reader(path: Path) -> RrdReader:
    """Of a complete recording, or of one that was cut short and lacks its footer."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "RRD file has no footer", RerunWarning)
        return RrdReader(path)


def recorded(path: Path, entity: str, component: str, timeline: str = "step") -> dict[int, np.ndarray]:
    """Time -> the values of a component at that time, in the order of the file."""
    rows: dict[int, np.ndarray] = {}
    for chunk in reader(path).stream():
        if chunk.entity_path != f"/{entity}" or chunk.is_static:
            continue
        batch = chunk.to_record_batch()
        if component in batch.schema.names:
            times = batch.column(timeline).cast("int64").to_pylist()
            for time, values in zip(times, batch.column(component).to_pylist(), strict=True):
                assert time not in rows
                rows[time] = np.array(values)
    return rows


def static(path: Path, entity: str) -> dict[str, Any]:
    """The values sent once to an entity, the last of each."""
    found: dict[str, Any] = {}
    for chunk in reader(path).stream():
        if chunk.entity_path == f"/{entity}" and chunk.is_static:
            batch = chunk.to_record_batch()
            found |= {name: batch.column(name).to_pylist()[-1] for name in batch.schema.names}
    return found


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


@pytest.mark.slow
def test_a_run_that_raises_leaves_a_readable_recording(tmp_path: Path) -> None:
    path = tmp_path / "recording.rrd"
    with pytest.raises(RuntimeError, match="stop here"), RerunObserver(path, recording_id="r") as recorder:
        FakeRun(short(), stop_at=77, error=RuntimeError("stop here")).run(recorder)
    assert recorder.warning is None
    assert list(recorded(path, "world/tip", "Points3D:positions")) == list(range(78))


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="counts native threads by /proc")
def test_recordings_leave_no_threads_however_they_end(tmp_path: Path) -> None:
    def ends(name: str, run: FakeRun) -> None:
        with RerunObserver(tmp_path / f"{name}.rrd", recording_id=name) as recorder:
            run.run(recorder)

    class Broken(FakeRun):
        def record(self, step: int) -> StepRecord:
            record = super().record(step)
            return replace(record, shaft_m=np.zeros((step, 2))) if step > 60 else record

    def native() -> int:
        return len(list(Path("/proc/self/task").iterdir()))

    ends("first", FakeRun(short()))  # what Rerun starts once for a process
    before = native()
    ends("whole", FakeRun(short()))
    with pytest.raises(RuntimeError, match="stop here"):
        ends("raised", FakeRun(short(), stop_at=77, error=RuntimeError("stop here")))
    ends("broken", Broken(short()))
    deadline = time.monotonic() + 30
    while native() > before and time.monotonic() < deadline:  # they were told to end
        time.sleep(0.01)
    assert native() <= before


CHILD = """
import os, signal, sys
from pathlib import Path
from service.recording.observer import RerunObserver
from tests.service.fake_run import FakeRun
from tests.service.recording.test_recording import short

signal.signal(signal.SIGTERM, signal.SIG_DFL)  # coverage has a handler of its own where it measures

class Killer:
    def begin(self, scene, first): pass
    def end(self, rollout): pass
    def step(self, record):
        if record.step == 220:
            os.kill(os.getpid(), getattr(signal, sys.argv[2]))

from service.worker.attempt import ObserverGroup
with RerunObserver(Path(sys.argv[1]), recording_id="killed", clock=lambda: 0.0) as recorder:
    FakeRun(short()).run(ObserverGroup((recorder, Killer())))
"""


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
@pytest.mark.parametrize(
    ("sent", "code", "steps"),
    [("SIGTERM", 128 + signal.SIGTERM, range(221)), ("SIGKILL", -9, range(2 * BLOCK_STEPS))],
)
def test_a_killed_run_leaves_a_readable_recording(tmp_path: Path, sent: str, code: int, steps: range) -> None:
    path = tmp_path / "recording.rrd"
    root = Path(recording.__file__).parents[2]
    done = subprocess.run([sys.executable, "-c", CHILD, str(path), sent], cwd=root, check=False)
    assert done.returncode == code
    assert list(recorded(path, "world/tip", "Points3D:positions")) == list(steps)
    optimize(path)  # which also repairs it
    assert list(recorded(path, "world/tip", "Points3D:positions")) == list(steps)


@pytest.mark.slow
def test_the_file_grows_while_the_run_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "recording.rrd"
    seen: list[int] = []

    class Watcher(Keeper):
        def step(self, record: StepRecord) -> None:
            if record.step == 2 * BLOCK_STEPS:
                recorder._recorder.stream.flush()  # type: ignore[union-attr]
                copied = tmp_path / "copy.rrd"
                copied.write_bytes(path.read_bytes())
                seen.extend(recorded(copied, "world/tip", "Points3D:positions"))

    with RerunObserver(path, recording_id="grows", clock=lambda: 0.0) as recorder:
        FakeRun(short()).run(ObserverGroup((recorder, Watcher())))
    assert seen == list(range(2 * BLOCK_STEPS))


@pytest.mark.slow
def test_a_place_that_cannot_be_written_is_a_warning(tmp_path: Path) -> None:
    keeper = Keeper()
    with RerunObserver(tmp_path / "missing" / "recording.rrd", recording_id="w") as recorder:
        FakeRun(short()).run(ObserverGroup((recorder, keeper)))
    assert recorder.warning is not None
    assert "FileNotFoundError" in recorder.warning
    assert len(keeper.records) == STEPS + 1


@pytest.mark.slow
def test_a_record_that_cannot_be_drawn_is_a_warning(tmp_path: Path) -> None:
    class Broken(FakeRun):
        def record(self, step: int) -> StepRecord:
            record = super().record(step)
            return replace(record, shaft_m=np.zeros((step, 2))) if step > 60 else record

    path = tmp_path / "recording.rrd"
    with RerunObserver(path, recording_id="b") as recorder:
        rollout = Broken(short()).run(recorder)
    assert isinstance(rollout, FakeRollout)
    assert recorder.warning is not None
    assert recorder.warning.startswith("recording stopped: ")
    assert list(recorded(path, "metrics/error", "Scalars:scalars")) == list(range(61))


FULL_DISK = """
import resource, sys
from pathlib import Path
from service.recording import observer
from tests.service.fake_run import FakeRun
from tests.service.recording.test_recording import short

limit, unforeseen = int(sys.argv[2]), sys.argv[3] == "unforeseen"
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
if unforeseen:
    observer.check_room, observer._FLUSH_S = lambda path: None, 2.0
with observer.RerunObserver(Path(sys.argv[1]), recording_id="full") as recorder:
    FakeRun(short()).run(recorder)
print(recorder.warning)
"""


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="POSIX limits")
@pytest.mark.parametrize(
    ("limit", "seen", "told"),
    [
        (150_000, "before", "OSError: [Errno 28] 0.1 MB are left for it, and 8 must be free"),
        (8_100_000, "on the way", "OSError: [Errno 28] "),
        pytest.param(150_000, "unforeseen", "RuntimeError: ", marks=pytest.mark.long),  # by a race of Rerun's
    ],
)
def test_a_full_disk_is_a_warning_and_the_process_ends(tmp_path: Path, limit: int, seen: str, told: str) -> None:
    """Rerun's writer ends at a full disk, and what waits for it then may never return."""
    root = Path(recording.__file__).parents[2]
    command = [sys.executable, "-c", FULL_DISK, str(tmp_path / "recording.rrd"), str(limit), seen]
    done = subprocess.run(command, cwd=root, capture_output=True, text=True, check=True, timeout=120)
    assert done.stdout.startswith(f"recording stopped: {told}")


def test_compacting_that_fails_leaves_the_original(tmp_path: Path) -> None:
    path = tmp_path / "recording.rrd"
    path.write_bytes(b"no recording at all")
    with pytest.raises(RuntimeError, match="compacting"):
        optimize(path)
    assert path.read_bytes() == b"no recording at all"
    assert list(tmp_path.iterdir()) == [path]


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


@pytest.mark.slow
@pytest.mark.parametrize(("long_steps", "compacted"), [(STEPS, 1), (STEPS + 1, 0)])
def test_only_long_recordings_are_compacted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, long_steps: int, compacted: int
) -> None:
    calls: list[Path] = []
    monkeypatch.setattr(recording, "LONG_STEPS", long_steps)
    monkeypatch.setattr(recording, "optimize", calls.append)
    path = tmp_path / "a.rrd"
    with RerunObserver(path, recording_id="a") as observer:
        FakeRun(short()).run(observer)
    assert calls == [path] * compacted
