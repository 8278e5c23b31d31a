"""Recordings of several jobs in one file: each scene under its own root, each series with its own name."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from service.recording.observer import RerunObserver
from service.recording.together import TogetherError, combine, distinct
from service.recording.viewer import ViewerError
from tests.service.fake_run import FakeRun
from tests.service.recording.recorded import reader, recorded, short, static

if TYPE_CHECKING:
    from pathlib import Path


def _recording(path: Path, seed: int) -> Path:
    with RerunObserver(path, recording_id=path.stem) as recorder:
        FakeRun(short(seed=seed)).run(recorder)
    assert recorder.warning is None
    return path


@pytest.mark.slow
def test_two_recordings_become_one_with_both_scenes_and_named_series(tmp_path: Path) -> None:
    one, other = _recording(tmp_path / "one.rrd", 1), _recording(tmp_path / "other.rrd", 2)
    both = tmp_path / "both.rrd"
    combine([("I-FEM", one), ("open loop = none", other)], both)
    for number, source in enumerate((one, other), start=1):
        for entity, component in (
            ("world/tip", "Points3D:positions"),
            ("world/tissue/strain", "Mesh3D:vertex_colors"),
            ("metrics/error", "Scalars:scalars"),
        ):
            expected, found = recorded(source, entity, component), recorded(both, f"run{number}/{entity}", component)
            assert expected.keys() == found.keys()
            assert expected
            for step in expected:
                np.testing.assert_array_equal(expected[step], found[step])
    assert static(both, "run1/metrics/error")["SeriesLines:names"][0] == "I-FEM: tip error, mm"
    assert static(both, "run2/metrics/error")["SeriesLines:names"][0] == "open loop = none: tip error, mm"
    first, second = (static(both, f"run{i}/metrics/error")["SeriesLines:colors"][0] for i in (1, 2))
    assert first != second
    assert len(reader(both).recordings()) == 1
    assert len(reader(both).blueprints()) == 1


def test_what_cannot_be_put_together_is_refused(tmp_path: Path) -> None:
    broken = tmp_path / "broken.rrd"
    broken.write_bytes(b"no recording")
    with pytest.raises(ViewerError, match="not a readable recording"):
        combine([("a", broken), ("b", broken)], tmp_path / "out.rrd")
    with pytest.raises(TogetherError, match="must be 2 to 6"):
        combine([("a", broken)], tmp_path / "out.rrd")


def test_equal_names_are_told_apart() -> None:
    assert distinct(["a", "b", "a"]) == ["a (1)", "b", "a (3)"]
