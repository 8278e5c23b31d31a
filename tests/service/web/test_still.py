"""What the still picture of an insertion shows."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from service.web.still import POINTS, still

if TYPE_CHECKING:
    from pathlib import Path

SCENARIO: dict[str, Any] = {"tissue": {"mesh_file": None, "fixed_regions": [{"kind": "sphere"}]}}


def series(steps: int) -> dict[str, Any]:
    way = np.stack([0 * np.arange(steps), 0 * np.arange(steps), 1e-4 * np.arange(steps)], axis=1)
    return {
        "target_m": way,
        "tip_m": np.vstack([way[:-1], [[np.nan] * 3]]),
        "shaft_m": np.array([[[0.0, 0.0, -0.1], [0.0, 0.0, 0.0]], [[0.0, 0.0, -0.05], [0.0, 0.0, 0.05]]]),
        "tissue_rest_m": np.array([[-0.01, 0.0, 0.0], [0.02, 0.03, 0.04], [0.0, 0.01, 0.02]]),
    }


def test_box_ways_and_needle_in_millimetres(tmp_path: Path) -> None:
    path = tmp_path / "series.npz"
    np.savez(path, **series(1000))
    found = still(SCENARIO, ["y_min"], path)
    assert found is not None
    assert (found["origin"], found["size"]) == ([-10.0, 0.0, 0.0], [30.0, 30.0, 40.0])
    assert found["shaft"] == [[0.0, 0.0, -50.0], [0.0, 0.0, 50.0]]
    assert (found["path"][0], found["path"][-1]) == ([0.0, 0.0, 0.0], [0.0, 0.0, 99.9])
    assert len(found["path"]) == POINTS
    assert found["tip"][-1] != [None] * 3  # what is no number is left out
    assert np.isfinite(found["tip"]).all()
    assert (found["faces"], found["regions"], found["mesh"]) == (["y_min"], [{"kind": "sphere"}], False)


def test_a_short_run_has_every_step(tmp_path: Path) -> None:
    path = tmp_path / "series.npz"
    np.savez(path, **series(4))
    found = still(SCENARIO, [], path)
    assert found is not None
    assert [z for _, _, z in found["path"]] == pytest.approx([0.0, 0.1, 0.2, 0.3])


@pytest.mark.parametrize("content", [b"", b"no archive"])
def test_a_damaged_series_has_no_picture(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "series.npz"
    path.write_bytes(content)
    assert still(SCENARIO, [], path) is None
    assert still(SCENARIO, [], tmp_path / "nothing") is None
