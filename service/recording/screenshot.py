"""Pictures of recordings, by a viewer without a window: taken once everything is loaded and drawn, or not at all."""

from __future__ import annotations

import contextlib
import io
import socket
import subprocess
import tempfile
import time
import warnings
from dataclasses import dataclass
from typing import IO, TYPE_CHECKING, Any

from service.recording.viewer import LOOPBACK, ViewerError, check_readable, environment, program

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from PIL.Image import Image
    from rerun.experimental import ViewerClient

NEEDS_DRIVER = (
    "It needs a Vulkan driver; one in software will do, on Debian: apt install mesa-vulkan-drivers libvulkan1"
)
TIMELINE, _TIMED = "t", "/world/tip"  # a timeline, s, and an entity that is recorded at every step
_START_TIMEOUT_S = 60.0
_LOAD_TIMEOUT_S = 120.0
_DRAW_TIMEOUT_S = 60.0
_SETTLE_S = 6.0  # until the messages that a new viewer shows over its panels are gone
_LOOK_S = 0.5
_END_S = 3.0  # that a viewer which fails takes to end
_MENU_PX = 37  # height of the window's own bar at the top of a picture
_FEWEST_COLOURS = 50  # of a picture with something in it: edges are smoothed


def screenshot(path: Path, picture: Path, *, at_s: float | None, size: tuple[int, int]) -> None:
    """Render a recording into a PNG without a display, at a simulated time (default: its end).

    size: width and height in pixels of the window; the picture lacks the window's menu bar. Needs a Vulkan driver.
    Nothing is written unless all is loaded, shown at that time and drawn. Raises ViewerError.
    """
    check_readable(path)
    end_s = _end_of(path)
    if at_s is not None and not 0.0 <= at_s <= end_s:
        raise ViewerError(f"--at = {at_s:g}: must be 0 to {end_s:g} s, where the recording ends")
    if not picture.absolute().parent.is_dir():
        raise ViewerError(f"{picture}: its folder is not there")
    with running_viewer(size) as client:
        begun_s = time.monotonic()
        client.open(str(path.resolve()))
        _wait_until_loaded(client, end_s)
        client.set_time(TIMELINE, duration=end_s if at_s is None else at_s, play_state="paused")
        time.sleep(max(0.0, begun_s + _SETTLE_S - time.monotonic()))
        drawn = _drawn(client, end_s if at_s is None else at_s)
    draft = picture.with_name(f".{picture.name}.part")
    drawn.save(draft, format="PNG", optimize=True)
    draft.replace(picture)


def try_viewer() -> None:
    """Start a viewer and have it draw its empty window. Raises ViewerError."""
    with running_viewer((400, 300)) as client:
        client.take_screenshot()


@contextlib.contextmanager
def running_viewer(size: tuple[int, int]) -> Iterator[ViewerClient]:
    """A client of a viewer without a window, which ends with the block. Raises ViewerError, also if it ends before."""
    with _headless(size) as viewer:
        try:
            yield viewer.connect()
        except ViewerError:
            raise
        except Exception as error:  # (whatever Rerun's client raises: its viewer may have ended)
            raise viewer.failure(str(error)) from error


@dataclass(frozen=True)
class _Viewer:
    """The process, its port on loopback, and what it prints."""

    process: subprocess.Popen[str]
    port: int
    log: IO[str]

    def connect(self) -> ViewerClient:
        from rerun.experimental import ViewerClient

        deadline = time.monotonic() + _START_TIMEOUT_S
        while self.process.poll() is None and time.monotonic() < deadline:
            if not _listens(self.port):
                time.sleep(0.1)
                continue
            with contextlib.suppress(Exception):  # it listens a little before it answers
                client = ViewerClient.connect(f"rerun+http://{LOOPBACK}:{self.port}/proxy")
                client.get_state()
                return client
            time.sleep(0.1)
        raise self.failure("it did not answer")

    def failure(self, reason: str) -> ViewerError:
        """What to say when it does not answer: whether it has ended, and what it said."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.process.wait(_END_S)
        self.log.seek(0)
        output = self.log.read().strip() or "nothing"
        if self.process.poll() is None:
            return ViewerError(f"the viewer stopped answering: {reason}. Its output: {output[-1000:]}")
        return ViewerError(f"the viewer did not start. {NEEDS_DRIVER}. Its output: {output[-1000:]}")


@contextlib.contextmanager
def _headless(size: tuple[int, int]) -> Iterator[_Viewer]:
    """A viewer without a window."""
    port = _free_port()
    arguments = ["--headless", "--hide-welcome-screen", "--bind", LOOPBACK, "--port", str(port)]
    arguments += ["--window-size", f"{size[0]}x{size[1]}"]
    with tempfile.TemporaryFile("w+") as log:
        process = subprocess.Popen(
            [program(), *arguments],
            env=environment(),
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
            text=True,
        )
        try:
            yield _Viewer(process, port, log)
        finally:
            process.kill()
            process.wait()


def _end_of(path: Path) -> float:
    """The last simulated time of a recording, s, from the file itself. Raises ViewerError."""
    from rerun.chunk import RrdReader

    last_ns = -1
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a recording that was cut short lacks its footer
        for chunk in RrdReader(path).stream():
            if chunk.entity_path == _TIMED and not chunk.is_static:
                times = chunk.to_record_batch().column(TIMELINE).cast("int64").to_pylist()
                last_ns = max([last_ns, *times])
    if last_ns < 0:
        raise ViewerError(f"{path}: no step of an insertion is in this recording")
    return last_ns * 1e-9


def _wait_until_loaded(client: ViewerClient, end_s: float) -> None:
    """Until the viewer has the recording up to its end, s."""
    deadline = time.monotonic() + _LOAD_TIMEOUT_S
    loaded_s = -1.0
    while time.monotonic() < deadline:
        state: Any = client.get_state()
        ends = [line.end for one in state.recordings for line in one.timelines if line.name == TIMELINE]
        loaded_s = max([1e-9 * end for end in ends if end is not None], default=-1.0)
        if not state.loading and loaded_s >= end_s - 1e-9:
            return
        time.sleep(0.1)
    raise ViewerError(
        f"the viewer did not load the recording in {_LOAD_TIMEOUT_S:g} s: it has it up to {loaded_s:g} of {end_s:g} s"
    )


def _drawn(client: ViewerClient, at_s: float) -> Image:
    """The window without its menu, once it shows this time, does not change any more, and has something in it."""
    deadline = time.monotonic() + _DRAW_TIMEOUT_S
    before: Image | None = None
    reason = "it keeps changing"
    while time.monotonic() < deadline:
        state: Any = client.get_state()
        _check_views(client, state)
        now = _without_menu(client.take_screenshot())
        cursors = [one.current_time for one in state.recordings if one.current_timeline == TIMELINE]
        if not any(time_ns is not None and abs(1e-9 * time_ns - at_s) < 1e-6 for time_ns in cursors):
            reason = f"its cursor is not at {at_s:g} s"
        elif now.getcolors(maxcolors=_FEWEST_COLOURS) is not None:
            reason = "its window is empty"
        elif before is not None and before.tobytes() == now.tobytes():
            return now
        before = now
        time.sleep(_LOOK_S)
    raise ViewerError(f"the viewer did not draw the recording within {_DRAW_TIMEOUT_S:g} s: {reason}")


def _check_views(client: ViewerClient, state: Any) -> None:
    """Raises ViewerError for what the viewer or one of its views calls an error."""
    problems = [entry.message for entry in client.get_logs() if entry.level == "ERROR"]
    problems += [
        f"{view.name}: {one.summary}" for view in state.views for one in view.reports if one.severity == "error"
    ]
    if problems:
        raise ViewerError(f"the viewer reports: {'; '.join(problems)}")


def _without_menu(png: bytes) -> Image:
    from PIL import Image

    with Image.open(io.BytesIO(png)) as image:
        return image.convert("RGB").crop((0, _MENU_PX, image.width, image.height))


def _listens(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex((LOOPBACK, port)) == 0


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind((LOOPBACK, 0))
        return int(probe.getsockname()[1])
