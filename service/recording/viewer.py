"""The Rerun viewer and its command line, as this project starts them: local, quiet, without analytics."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import warnings
from pathlib import Path

from simcore.errors import NeedlebenchError

LOOPBACK = "127.0.0.1"


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
    except Exception as error:  # noqa: BLE001  (Rerun raises several kinds for a damaged file)
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
