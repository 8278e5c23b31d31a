"""A picture is written once all is loaded and drawn; else there is none, and a sentence."""

from __future__ import annotations

import contextlib
import io
import itertools
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from PIL import Image

from needlebench import Scenario
from service.recording import screenshot as pictures
from service.recording.observer import RerunObserver
from service.recording.screenshot import NEEDS_DRIVER, screenshot, try_viewer
from service.recording.viewer import ViewerError
from tests.service.cli.test_view import VULKAN
from tests.service.fake_run import FakeRun

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

END_S = 1.0


@pytest.fixture(scope="module")
def rrd(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("pictures") / "recording.rrd"
    wanted = {"tissue": {"element_size_mm": 20}, "trajectory": {"kind": "line", "target_mm": [18, 31, 10]}}
    with RerunObserver(path, recording_id="view") as recorder:
        FakeRun(Scenario.load(wanted)).run(recorder)
    return path


def png(seed: int, colours: int = 200) -> bytes:
    n = np.arange(10_000)
    pixels = np.stack([(n * seed) % colours, n % colours, np.full(n.size, seed % 256)], axis=1)
    file = io.BytesIO()
    Image.fromarray(pixels.reshape(100, 100, 3).astype(np.uint8)).save(file, "PNG", compress_level=1)
    return file.getvalue()


class SlowViewer:
    """Loads by and by, and draws something else a few times before it is done."""

    def __init__(self, *, loads: list[float | None], draws: list[bytes], cursor_s: float | None = None) -> None:
        self.loads, self.draws = loads, draws
        self.cursor_s = cursor_s
        self.shots = 0
        self.reports: list[Any] = []

    def open(self, _path: str) -> None:
        pass

    def set_time(self, _timeline: str, *, duration: float, play_state: str) -> None:
        assert play_state == "paused"
        self.cursor_s = duration if self.cursor_s is None else self.cursor_s

    def get_logs(self) -> list[Any]:
        return []

    def get_state(self) -> Any:
        end_s = self.loads.pop(0) if len(self.loads) > 1 else self.loads[0]
        line = SimpleNamespace(name="t", end=None if end_s is None else round(end_s * 1e9))
        cursor_ns = None if self.cursor_s is None else round(self.cursor_s * 1e9)
        recording = SimpleNamespace(timelines=[line], current_timeline="t", current_time=cursor_ns)
        views = [SimpleNamespace(name="3D", reports=self.reports)]
        return SimpleNamespace(loading=[1] if len(self.loads) > 2 else [], recordings=[recording], views=views)

    def take_screenshot(self) -> bytes:
        self.shots += 1
        return self.draws.pop(0) if len(self.draws) > 1 else self.draws[0]


@pytest.fixture
def taken(rrd: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    ticks = itertools.count()
    monkeypatch.setattr(pictures, "time", SimpleNamespace(monotonic=lambda: float(next(ticks)), sleep=lambda _s: None))

    def take(viewer: SlowViewer, at_s: float | None = None) -> Image.Image:
        @contextlib.contextmanager
        def running(_size: tuple[int, int]) -> Iterator[SlowViewer]:
            yield viewer

        monkeypatch.setattr(pictures, "running_viewer", running)
        screenshot(rrd, tmp_path / "a.png", at_s=at_s, size=(100, 100))
        with Image.open(tmp_path / "a.png") as image:
            return image.copy()

    yield take
    assert list(tmp_path.glob(".*")) == []


@pytest.mark.slow
def test_it_waits_for_the_last_step_and_for_two_equal_pictures(taken: Any) -> None:
    viewer = SlowViewer(loads=[None, 0.2, 0.9, END_S], draws=[png(1), png(2), png(3), png(3)])
    image = taken(viewer)
    assert image.size == (100, 63)
    assert viewer.shots == 4
    assert viewer.cursor_s == END_S
    assert image.getpixel((5, 5)) == Image.open(io.BytesIO(png(3))).getpixel((5, 42))


@pytest.mark.parametrize(
    ("viewer", "message"),
    [
        (SlowViewer(loads=[0.9], draws=[png(1)]), "it has it up to 0.9 of 1 s"),
        (SlowViewer(loads=[END_S], draws=[png(n) for n in range(1, 200)]), "it keeps changing"),
        (SlowViewer(loads=[END_S], draws=[png(0, colours=3)]), "its window is empty"),
        (SlowViewer(loads=[END_S], draws=[png(1)], cursor_s=0.3), "its cursor is not at 1 s"),
    ],
)
def test_without_a_right_picture_there_is_none(taken: Any, tmp_path: Path, viewer: SlowViewer, message: str) -> None:
    with pytest.raises(ViewerError, match=message):
        taken(viewer)
    assert not (tmp_path / "a.png").exists()


def test_a_view_with_an_error_is_reported(taken: Any) -> None:
    viewer = SlowViewer(loads=[END_S], draws=[png(1)])
    viewer.reports = [SimpleNamespace(severity="error", summary="no mesh")]
    with pytest.raises(ViewerError, match="the viewer reports: 3D: no mesh"):
        taken(viewer)


def test_a_time_after_the_end_is_refused(taken: Any) -> None:
    with pytest.raises(ViewerError, match=r"--at = 7: must be 0 to 1 s"):
        taken(SlowViewer(loads=[END_S], draws=[png(1)]), at_s=7.0)


@pytest.mark.slow
@pytest.mark.skipif(bool(VULKAN), reason="there is a driver")
def test_without_a_driver_it_says_what_to_install(rrd: Path, tmp_path: Path) -> None:
    with pytest.raises(ViewerError, match=NEEDS_DRIVER):
        screenshot(rrd, tmp_path / "a.png", at_s=None, size=(800, 500))
    with pytest.raises(ViewerError, match=NEEDS_DRIVER):
        try_viewer()
    assert not list(tmp_path.iterdir())
