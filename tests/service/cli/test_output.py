"""What the command does where its output goes to: a reader that leaves, a locale without letters."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from service.cli.campaign_request import campaign_request
from service.cli.main import BROKEN_PIPE


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="there are no broken pipes on Windows")
@pytest.mark.parametrize("arguments", [["scenario", "--fields"], ["scenario"]])
def test_a_reader_that_leaves_is_no_crash(arguments: list[str]) -> None:
    """Whether the output fills the pipe or not, nothing is said about it."""
    reading, writing = os.pipe()
    os.close(reading)
    command = [sys.executable, "-m", "service.cli", *arguments]
    done = subprocess.run(command, stdout=writing, stderr=subprocess.PIPE, check=False)
    os.close(writing)
    assert (done.returncode, done.stderr) == (BROKEN_PIPE, b"")


@pytest.mark.slow
@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "utf-8"])
def test_a_locale_without_some_letters_is_no_crash(encoding: str) -> None:
    env = {**os.environ, "LC_ALL": "POSIX", "PYTHONIOENCODING": encoding, "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    name = "\u6c34\u00e9"
    command = [sys.executable, "-c", f"from service.cli.main import main; main(['scenario', {name!a}])"]
    done = subprocess.run(command, capture_output=True, env=env, check=False)
    assert done.returncode == 2
    assert b"is not a built-in scenario" in done.stderr
    assert b"Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("3,6.3", [3, 6.3]),
        ("ifem,open_loop", ["ifem", "open_loop"]),
        ("[3,6.3]", [3, 6.3]),
        ('[["y_min"],["z_max","x_min"]]', [["y_min"], ["z_max", "x_min"]]),
        ('["y_min"],["z_max","x_min"]', [["y_min"], ["z_max", "x_min"]]),
        ("[18,31,60],[18,31,80]", [[18, 31, 60], [18, 31, 80]]),
        ('{"kind":"none"},{"kind":"breathing","period_s":5}', [{"kind": "none"}, {"kind": "breathing", "period_s": 5}]),
        ('"a,b",c', ["a,b", "c"]),
    ],
)
def test_an_axis_of_a_grid_may_have_lists_and_objects(text: str, values: list[object]) -> None:
    request = campaign_request(None, {"axes": [f"field={text}"], "source": None})
    assert request["grid"] == {"field": values}
