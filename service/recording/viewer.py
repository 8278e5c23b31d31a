"""The Rerun viewer and its command line, as this project starts them: local, quiet, without analytics."""

from __future__ import annotations

import contextlib
import importlib.util
import io
import os
import socket
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import IO, TYPE_CHECKING

from simcore.errors import NeedlebenchError

if TYPE_CHECKING:
    from rerun.experimental import ViewerClient

LOOPBACK = "127.0.0.1"
_START_TIMEOUT_S = 60.0
_LOAD_TIMEOUT_S = 120.0
_SETTLE_S = 6.0  # until the messages that a new viewer shows over its panels are gone
_MENU_PX = 37  # height of the window's own bar at the top of a picture


class ViewerError(NeedlebenchError):
    """The viewer cannot show the recording; the message says what to do."""


def program() -> str:
    """Rerun's command line, of the version that writes the recordings. Raises ViewerError if it is missing."""
    package = importlib.util.find_spec("rerun_cli")
    folder = Path(package.origin).parent if package and package.origin else Path()
    for name in ("Rerun.app/Contents/MacOS/Rerun", "rerun", "rerun.exe"):
        if (folder / name).is_file():
            return str(folder / name)
    raise ViewerError("the program of the viewer is missing: pip install --force-reinstall rerun-sdk")


def environment() -> dict[str, str]:
    """The environment in which Rerun sends no usage data and changes no settings of the user.

    Its off switch is a file in the user's settings; with CI set it is off without one.
    """
    kept = {key: value for key, value in os.environ.items() if key != "FORCE_RERUN_ANALYTICS"}
    return {**kept, "CI": "1"}


def check_readable(path: Path) -> None:
    """Raises ViewerError unless the file holds a recording, complete or cut short."""
    from rerun.chunk import RrdReader

    if not path.is_file():
        raise ViewerError(f"{path}: no such file")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a recording that was cut short lacks its footer
            nonempty = bool(RrdReader(path).recordings())
    except Exception as error:
        raise ViewerError(f"{path}: not a readable recording: {error}") from None
    if not nonempty:
        raise ViewerError(f"{path}: holds no recording")


def show(path: Path) -> int:
    """Open a recording in a window, until it is closed; its exit code. Listens on loopback only."""
    check_readable(path)
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise ViewerError(
            "this machine has no display. Copy the recording to one that has one and view it there, "
            "or make a picture here: needlebench view FILE --screenshot PICTURE.png"
        )
    done = subprocess.run([program(), "--bind", LOOPBACK, "--port", "auto", str(path)], env=environment(), check=False)
    return done.returncode


def screenshot(path: Path, picture: Path, *, at_s: float | None, size: tuple[int, int]) -> None:
    """Render a recording into a PNG without a display, at a simulated time (default: its end).

    size: width and height in pixels of the window; the picture lacks the window's menu bar. Needs a Vulkan driver;
    one in software will do (Debian: mesa-vulkan-drivers libvulkan1). Raises ViewerError.
    """
    check_readable(path)
    started = time.monotonic()
    with _headless(size) as (process, port, log):
        client = _connect(port, process, log)
        client.open(str(path.resolve()))
        end_s = _wait_until_loaded(client)
        client.set_time("t", duration=end_s if at_s is None else min(at_s, end_s), play_state="paused")
        time.sleep(max(1.0, started + _SETTLE_S - time.monotonic()))
        problems = [entry.message for entry in client.get_logs() if entry.level == "ERROR"]
        if problems:
            raise ViewerError(f"the viewer reports: {'; '.join(problems)}")
        _save_without_menu(client.take_screenshot(), picture)


def _save_without_menu(png: bytes, picture: Path) -> None:
    from PIL import Image

    with Image.open(io.BytesIO(png)) as image:
        image.crop((0, _MENU_PX, image.width, image.height)).save(picture, optimize=True)


@contextlib.contextmanager
def _headless(size: tuple[int, int]) -> Iterator[tuple[subprocess.Popen[str], int, IO[str]]]:
    """A viewer without a window: its process, its port on loopback and what it prints."""
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
            yield process, port, log
        finally:
            process.kill()
            process.wait()


def _connect(port: int, process: subprocess.Popen[str], log: IO[str]) -> ViewerClient:
    from rerun.experimental import ViewerClient

    deadline = time.monotonic() + _START_TIMEOUT_S
    while process.poll() is None and time.monotonic() < deadline:
        if not _listens(port):
            time.sleep(0.1)
            continue
        with contextlib.suppress(Exception):  # it listens a little before it answers
            client = ViewerClient.connect(f"rerun+http://{LOOPBACK}:{port}/proxy")
            client.get_state()
            return client
        time.sleep(0.1)
    log.seek(0)
    output = log.read().strip() or "nothing"
    raise ViewerError(
        "the viewer did not start. It needs a Vulkan driver; on Debian: "
        f"apt install mesa-vulkan-drivers libvulkan1. Its output: {output[-1000:]}"
    )


def _wait_until_loaded(client: ViewerClient) -> float:
    """The end of the recording on the timeline `t`, seconds."""
    deadline = time.monotonic() + _LOAD_TIMEOUT_S
    while time.monotonic() < deadline:
        state = client.get_state()
        ends = [line.end for recording in state.recordings for line in recording.timelines if line.name == "t"]
        if not state.loading and ends and ends[0] is not None:
            return ends[0] * 1e-9
        time.sleep(0.1)
    raise ViewerError("the viewer could not load the recording, or it has no timeline `t`")


def _listens(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex((LOOPBACK, port)) == 0


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind((LOOPBACK, 0))
        return int(probe.getsockname()[1])
