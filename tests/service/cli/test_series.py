"""The time series of a result as CSV, JSON and Parquet: the same numbers, to the bit."""

from __future__ import annotations

import csv
import io
import json
from typing import TYPE_CHECKING

import numpy as np
import pytest
from click.testing import CliRunner

from service.cli.main import main
from simcore.rollout import artefacts
from simcore.rollout.rollout import run
from simcore.rollout.table import columns_of
from tests.simcore.short_run import short

if TYPE_CHECKING:
    from pathlib import Path

    from click.testing import Result

    from simcore.rollout.result import Rollout


@pytest.fixture(scope="module")
def rollout() -> Rollout:
    return run(short())


@pytest.fixture
def folder(rollout: Rollout, tmp_path: Path) -> Path:
    artefacts.write(rollout, tmp_path)
    return tmp_path


def series(*words: str) -> Result:
    return CliRunner().invoke(main, ["series", *words])


def test_csv_has_a_row_a_step_and_a_column_a_component(rollout: Rollout, folder: Path) -> None:
    done = series(str(folder))
    assert done.exit_code == 0
    rows = list(csv.DictReader(io.StringIO(done.stdout)))
    assert len(rows) == len(rollout.series["t_s"])
    for axis, name in enumerate("xyz"):
        np.testing.assert_array_equal([float(row[f"tip_m_{name}"]) for row in rows], rollout.series["tip_m"][:, axis])
    assert "tissue_m_0" not in rows[0]


def test_json_has_what_is_asked_for(rollout: Rollout, folder: Path) -> None:
    done = series(str(folder / "series.npz"), "--to", "json", "--names", "t_s,tip_m")
    found = json.loads(done.stdout)
    assert set(found) == {"t_s", "tip_m"}
    np.testing.assert_array_equal(found["tip_m"], rollout.series["tip_m"])


def test_parquet_holds_the_same_numbers(rollout: Rollout, folder: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    done = series(str(folder), "--to", "parquet", "--out", str(folder / "run.parquet"))
    assert done.exit_code == 0, done.stderr
    table = parquet.read_table(folder / "run.parquet")
    np.testing.assert_array_equal(table["depth_m"].to_numpy(), rollout.series["depth_m"])
    np.testing.assert_array_equal(table["base_rotation_w"].to_numpy(), rollout.series["base_rotation"][:, 0])


def test_a_data_frame_is_the_same_table(rollout: Rollout) -> None:
    pandas = pytest.importorskip("pandas")
    frame = rollout.to_dataframe()
    assert isinstance(frame, pandas.DataFrame)
    assert frame.index.name == "t_s"
    np.testing.assert_array_equal(frame["tip_m_z"], rollout.series["tip_m"][:, 2])


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["nowhere"], "is no folder with a series.npz"),
        (["FOLDER", "--to", "parquet"], "name a file with --out"),
        (["FOLDER", "--names", "t_s,tipp_m"], "there is no array 'tipp_m'"),
        (["FOLDER", "--names", "t_s,tissue_m"], "must have the same number of rows"),
    ],
)
def test_what_cannot_be_written_is_said(folder: Path, words: list[str], told: str) -> None:
    done = series(*(str(folder) if word == "FOLDER" else word for word in words))
    assert done.exit_code == 2
    assert told in done.stderr


def test_a_damaged_file_is_named(tmp_path: Path) -> None:
    (tmp_path / "series.npz").write_bytes(b"PK\x03\x04 and no more")
    done = series(str(tmp_path))
    assert done.exit_code == 2
    assert "is damaged" in done.stderr


def test_columns_of_vectors_are_named_by_their_axes() -> None:
    found = columns_of({"a": np.zeros(2), "b": np.zeros((2, 3)), "c": np.zeros((2, 4)), "d": np.zeros((2, 2))})
    assert list(found) == ["a", "b_x", "b_y", "b_z", "c_w", "c_x", "c_y", "c_z", "d_0", "d_1"]
