"""Poses of a replay out of a file: a path here, read once, checked row by row, told apart by their digest."""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from simcore.controllers.replay import ReplayController
from simcore.errors import ScenarioError
from simcore.scenario.scenario import Replay, Scenario

if TYPE_CHECKING:
    from pathlib import Path

ROWS = np.array([[18.0, 31.0, -180.0 + 0.5 * i, 1.0, 0.0, 0.0, 0.0] for i in range(12)])


def replayed(**fields: Any) -> Scenario:
    return Scenario.load({"controller": {"kind": "replay", **fields}})


def saved(path: Path, rows: Any = ROWS) -> str:
    np.save(path, np.asarray(rows))
    return str(path)


def test_a_file_gives_the_same_steps_as_its_rows_inline(tmp_path: Path) -> None:
    name = saved(tmp_path / "poses.npy")
    by_file, inline = replayed(poses_file=name), replayed(poses=ROWS.tolist())
    assert by_file.steps == inline.steps == 12
    assert isinstance(by_file.controller, Replay)
    assert isinstance(inline.controller, Replay)
    assert by_file.controller.poses_sha256 == hashlib.sha256((tmp_path / "poses.npy").read_bytes()).hexdigest()
    first, second = ReplayController(by_file.controller), ReplayController(inline.controller)
    np.testing.assert_array_equal(first.positions_m, second.positions_m)
    np.testing.assert_array_equal(first.quaternions, second.quaternions)
    assert by_file.resolved()["controller"]["poses"] is None


@pytest.mark.parametrize("heading", ["", "x_mm,y_mm,z_mm,qw,qx,qy,qz\n"])
def test_a_log_may_be_comma_separated(tmp_path: Path, heading: str) -> None:
    path = tmp_path / "log.csv"
    path.write_text(heading + "\n".join(",".join(map(repr, row)) for row in ROWS.tolist()) + "\n")
    assert replayed(poses_file=str(path)).steps == 12


def test_a_resolved_scenario_refuses_a_file_that_was_changed(tmp_path: Path) -> None:
    name = saved(tmp_path / "poses.npy")
    kept = replayed(poses_file=name).resolved()
    other = ROWS + np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0])
    digest = kept["controller"]["poses_sha256"]
    saved(tmp_path / "poses.npy", other)
    with pytest.raises(ScenarioError, match=r"controller\.poses_sha256 = '?0{64}"):
        replayed(poses_file=name, poses_sha256="0" * 64)
    assert replayed(poses_file=name).controller.poses_sha256 != digest  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (ROWS[:, :6], "rows of 7 numbers, and is 12 x 6"),
        (ROWS[:0], "1 to 1000000 rows of 7 numbers, and is 0 x 7"),
        (np.where(np.arange(12)[:, None] == 4, np.nan, ROWS), "row 5 must hold a unit quaternion"),
        (ROWS * [1, 1, 1, 2, 1, 1, 1], "row 1 must hold a unit quaternion qw, qx, qy, qz; its norm is 2"),
        (ROWS + np.array([2e4, 0, 0, 0, 0, 0, 0]), r"row 1 must lie within \+-10000 mm"),
        (ROWS.astype(complex), "must be real"),
    ],
)
def test_a_wrong_row_is_named(tmp_path: Path, rows: Any, message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        replayed(poses_file=saved(tmp_path / "poses.npy", rows))


def test_a_pickle_is_never_loaded(tmp_path: Path) -> None:
    np.save(tmp_path / "poses.npy", np.array([{"a": 1}], dtype=object), allow_pickle=True)
    with pytest.raises(ScenarioError, match="is no table of numbers"):
        replayed(poses_file=str(tmp_path / "poses.npy"))


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({}, r"controller\.poses = .*is missing .*controller\.poses_file"),
        ({"poses": ROWS.tolist(), "poses_file": "log.npy"}, "controller.poses_file = .*must be left out"),
        ({"poses": ROWS.tolist(), "poses_sha256": "0" * 64}, "controller.poses_sha256 = .*must be left out"),
        ({"poses_file": "absent.npy"}, "controller.poses_file = .*cannot be read"),
        ({"poses_file": "log.txt"}, r"controller.poses_file = .*must end in .npy or .csv"),
    ],
)
def test_either_poses_or_a_file_of_them(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        replayed(**fields)
