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
from service.files.series_formats import load
from simcore.metric_definitions import SERIES, UNITS
from simcore.rollout import artefacts
from simcore.rollout.rollout import run
from simcore.rollout.table import columns_of, rows_of
from tests.docs.sources import program
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
    shapes = {"a": (2,), "b": (2, 3), "c": (2, 4), "turn_rotation": (2, 4), "d": (2, 2, 2), "e": (2, 1, 3)}
    found = columns_of({name: np.arange(2 * np.prod(shape[1:])).reshape(shape) for name, shape in shapes.items()})
    turns = [f"turn_rotation_{axis}" for axis in "wxyz"]
    pairs = ["d_x_x", "d_x_y", "d_y_x", "d_y_y"]
    assert list(found) == [
        "a",
        "b_x",
        "b_y",
        "b_z",
        "c_0",
        "c_1",
        "c_2",
        "c_3",
        *turns,
        *pairs,
        "e_0_x",
        "e_0_y",
        "e_0_z",
    ]
    np.testing.assert_array_equal(found["d_y_x"], [2, 6])
    np.testing.assert_array_equal(found["e_0_z"], [2, 5])
    assert list(columns_of({"none": np.zeros((0, 3))})) == ["none_x", "none_y", "none_z"]


def test_the_table_has_every_array_with_a_row_a_step_and_no_other_one(tmp_path: Path) -> None:
    """Each step is a frame here, so that frames and rows are as many; written, read and described alike."""
    done = run(short(recording={"every_steps": 1}, trajectory={"target_mm": [12, 20.5, 10], "amplitude_mm": 0.2}))
    assert len(done.series["strain_energy_j"]) == len(done.series["t_s"])
    artefacts.write(done, tmp_path)
    described = {array.name for array in SERIES if array.shape[0] == "rows"}
    assert set(rows_of(done.series)) == set(load(tmp_path / "series.npz")) == described
    head = series(str(tmp_path)).stdout.splitlines()[0].split(",")
    assert {name for name in described if not any(column.startswith(name) for column in head)} == set()
    assert "rcm_authority_x_y" in head
    assert not {"strain_energy_j", "tissue_frame_step"} & set(head)


def test_the_file_holds_what_the_page_describes_with_its_shapes(rollout: Rollout, folder: Path) -> None:
    """Every array of series.npz is on the page of metrics, and every one there is in the file."""
    with np.load(folder / "series.npz") as file:
        held = {name: file[name] for name in file.files}
    assert {name: array.dtype for name, array in held.items()} == {n: a.dtype for n, a in rollout.series.items()}
    rows = program("page_tables").part("series").splitlines()[2:]
    cells = [[cell.strip() for cell in row.strip("|").split("|")] for row in rows]
    page = {name.strip("`"): (unit, shape.split(" × ")) for name, unit, shape, *_ in cells}
    assert set(page) == set(held)
    sizes: dict[str, int] = {}
    for name, (unit, shape) in page.items():
        assert len(shape) == held[name].ndim, name
        for word, size in zip(shape, held[name].shape, strict=True):
            assert size == (int(word) if word.isdigit() else sizes.setdefault(word, size)), (name, word)
        assert unit in UNITS, name
