"""`needlebench view`: the viewer on loopback, a picture without a display, what is no recording."""

from __future__ import annotations

import ctypes.util
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from service.recording.observer import RerunObserver
from tests.service.cli.invoked import invoke
from tests.service.fake_run import FakeRun
from tests.service.recording.recorded import short

VULKAN = ctypes.util.find_library("vulkan") and list(Path("/usr/share/vulkan/icd.d").glob("*.json"))


def test_view_of_what_is_no_recording(tmp_path: Path) -> None:
    missing, text = tmp_path / "missing.rrd", tmp_path / "text.rrd"
    text.write_text("no recording")
    cases = {missing: "no such file", text: "not a readable recording", tmp_path: "no such file"}
    for path, told in cases.items():
        result = invoke("view", str(path))
        assert result.exit_code == 1
        assert result.stderr.startswith(f"needlebench: {path}: {told}")


@pytest.fixture(scope="module")
def rrd(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("view") / "recording.rrd"
    with RerunObserver(path, recording_id="view") as recorder:
        FakeRun(short()).run(recorder)
    return path


@pytest.mark.slow
def test_view_without_a_display(rrd: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    result = invoke("view", str(rrd))
    assert result.exit_code == 1
    assert "no display" in result.stderr
    assert "--screenshot" in result.stderr


@pytest.mark.slow
def test_view_starts_the_viewer_on_loopback_without_analytics(rrd: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[Any] = []

    def start(command: list[str], **options: Any) -> subprocess.CompletedProcess[str]:
        started.append((command, options["env"]))
        return subprocess.CompletedProcess(command, 0)

    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setenv("FORCE_RERUN_ANALYTICS", "1")
    monkeypatch.setattr(subprocess, "run", start)
    assert invoke("view", str(rrd)).exit_code == 0
    ((command, environment),) = started
    assert command[command.index("--bind") + 1] == "127.0.0.1"
    assert command[-1] == str(rrd)
    assert environment["CI"] == "1"
    assert "FORCE_RERUN_ANALYTICS" not in environment


@pytest.mark.parametrize("size", ["big", "100x100", "1600", "1600x900x2"])
def test_view_refuses_a_bad_size(rrd: Path, size: str) -> None:
    assert invoke("view", str(rrd), "--size", size).exit_code == 2


@pytest.mark.slow
@pytest.mark.skipif(not VULKAN, reason="needs a Vulkan driver: apt-get install mesa-vulkan-drivers libvulkan1")
def test_view_makes_a_picture_without_a_display(rrd: Path, tmp_path: Path) -> None:
    from PIL import Image

    picture = tmp_path / "picture.png"
    result = invoke("view", str(rrd), "--screenshot", str(picture), "--size", "800x500", "--at", "0.5")
    assert result.exit_code == 0, result.output
    with Image.open(picture) as image:
        assert image.size == (800, 463)
        assert len(image.convert("RGB").getcolors(maxcolors=800 * 480) or []) > 200
