"""Series files that were cut off: one sentence, whatever the archive's reader says."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from service.files.series_formats import DamagedSeriesError, load
from service.local.verify import CannotVerifyError, load_series
from simcore.rollout.dataset import DatasetError, load_dataset

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture
def whole(tmp_path: Path) -> Path:
    path = tmp_path / "series.npz"
    rows = np.random.default_rng(1).random((500, 3))
    np.savez_compressed(path, allow_pickle=False, t_s=rows[:, 0], tip_m=rows)
    return path


@pytest.mark.parametrize("part", [0.0, 0.01, 0.3, 0.9, 0.999])
def test_a_series_that_was_cut_off_is_damaged(whole: Path, part: float) -> None:
    assert set(load(whole)) == {"t_s", "tip_m"}
    data = whole.read_bytes()
    whole.write_bytes(data[: int(part * len(data))])
    with pytest.raises(DamagedSeriesError, match="is damaged"):
        load(whole)
    with pytest.raises(CannotVerifyError, match="cannot be read"):
        load_series(whole)
    with pytest.raises(DatasetError, match="cannot be read as a data set"):
        load_dataset(whole)


def test_a_series_whose_bytes_changed_is_damaged(whole: Path) -> None:
    """The directory at the end is whole: the fault shows when an array is unpacked."""
    data = bytearray(whole.read_bytes())
    data[200:400] = bytes(200)
    whole.write_bytes(data)
    with pytest.raises(DamagedSeriesError, match="is damaged"):
        load(whole)
    with pytest.raises(DatasetError, match="cannot be read as a data set"):
        load_dataset(whole)


def test_an_unknown_array_is_no_damage(whole: Path) -> None:
    with pytest.raises(ValueError, match="there is no array 'tip'; there are t_s, tip_m"):
        load(whole, ["tip"])
