from __future__ import annotations

import subprocess
import sys

import pytest

import needlebench


def test_the_documented_names_are_there() -> None:
    from needlebench import (
        Client,
        CommandError,
        Controller,
        Episode,
        Observation,
        Pose,
        Scenario,
        Snapshot,
        register_controller,
        rotation_towards,
        run,
    )

    assert all(map(callable, (run, register_controller, rotation_towards)))
    assert all(isinstance(known, type) for known in (CommandError, Controller, Episode, Observation, Pose, Snapshot))
    assert Scenario.load({}).name == "unnamed"
    with Client("http://127.0.0.1:1/") as client:
        assert client.url == "http://127.0.0.1:1"
    assert needlebench.__version__
    assert dir(needlebench) == sorted(needlebench.__all__)
    assert {"Client", "Controller", "Scenario", "__version__", "run"} <= set(dir(needlebench))


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        needlebench.nothing  # noqa: B018


def test_the_import_is_light_and_asks_for_one_thread() -> None:
    code = (
        "import os, sys, needlebench; "
        "assert not {'numpy', 'numba', 'httpx2', 'fastapi'} & set(sys.modules); "
        "assert os.environ['OMP_NUM_THREADS'] == '1'"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
