"""Table I from a series by hand; draws and splits; files that are whole and nothing else."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from simcore.rollout.dataset import VARIABLES, Dataset, DatasetError, gathered, load_dataset, save_dataset, table_one

if TYPE_CHECKING:
    from pathlib import Path


def table(rows: int, seed: int = 0) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    return {name: rng.normal(size=(rows, 3)) for name in VARIABLES}


def small(samples: int = 60, seed: int = 4) -> Dataset:
    tables = [table(10, k) for k in range(10)]
    return gathered(tables, np.arange(30.0).reshape(10, 3), samples=samples, seed=seed, provenance={"from": "a test"})


def test_a_row_holds_what_the_controller_saw_and_what_it_answered() -> None:
    """Row i of a series is the state after step i, its command the one that led there: step 0 saw row 0, and its
    command stands in row 1."""
    numbers = np.arange(9.0).reshape(3, 3)
    series = {
        "base_position_m": numbers,
        "command_position_m": 100.0 + numbers,
        "tip_seen_m": 10.0 * numbers,
        "target_noisy_m": 20.0 * numbers,
    }
    found = table_one(series)
    assert tuple(found) == VARIABLES
    np.testing.assert_array_equal(found["base_position_m"], [[0, 1, 2], [3, 4, 5]])
    np.testing.assert_array_equal(found["command_position_m"], [[103, 104, 105], [106, 107, 108]])
    np.testing.assert_array_equal(found["base_step_m"], np.full((2, 3), 103.0))
    np.testing.assert_array_equal(found["tip_error_m"], [[0, 10, 20], [30, 40, 50]])


def test_rows_know_their_insertion_and_step() -> None:
    data = gathered([table(3), table(2, 1)], np.zeros((2, 3)), samples=5, seed=0, provenance={})
    np.testing.assert_array_equal(data.trajectory, [0, 0, 0, 1, 1])
    np.testing.assert_array_equal(data.step, [0, 1, 2, 0, 1])
    np.testing.assert_array_equal(data.variables["tip_m"][3:], table(2, 1)["tip_m"])
    np.testing.assert_array_equal(data.inputs(np.array([4]))[0, 3:], table(2, 1)["tip_error_m"][1])
    np.testing.assert_array_equal(data.outputs(np.array([4]))[0], table(2, 1)["base_step_m"][1])


def test_the_draw_is_without_repetition_and_by_the_seed() -> None:
    data = small()
    assert len(np.unique(data.drawn)) == 60
    np.testing.assert_array_equal(data.drawn, small().drawn)
    assert not np.array_equal(data.drawn, small(seed=5).drawn)
    assert len(small(samples=10_000).drawn) == 100


def test_both_splits_divide_the_drawn_rows_nine_to_one() -> None:
    data = small()
    for split in (data.by_sample, data.by_trajectory):
        np.testing.assert_array_equal(np.sort(np.concatenate([split.train, split.test])), data.drawn)
    assert len(data.by_sample.train) == 54
    held_out = set(data.trajectory[data.by_trajectory.test])
    assert len(held_out) == 1
    assert not held_out & set(data.trajectory[data.by_trajectory.train])
    assert len(set(data.trajectory[data.by_sample.train]) & set(data.trajectory[data.by_sample.test])) > 1


def test_without_a_step_there_is_no_data_set() -> None:
    with pytest.raises(DatasetError, match="nothing to learn from"):
        gathered([table(0)], np.zeros((1, 3)), samples=10, seed=0, provenance={})


def test_a_file_comes_back_as_it_was_written(tmp_path: Path) -> None:
    data = small()
    save_dataset(data, tmp_path / "data.npz")
    again = load_dataset(tmp_path / "data.npz")
    for name, array in data.arrays().items():
        np.testing.assert_array_equal(again.arrays()[name], array)
    assert again.provenance == {"from": "a test"}
    with np.load(tmp_path / "data.npz", allow_pickle=False) as file:
        np.testing.assert_array_equal(file["train_by_trajectory"], data.by_trajectory.train)


FAULTS: dict[str, tuple[dict[str, Any], str]] = {
    "another format": ({"format": np.array("other/1")}, "its format is other/1"),
    "another width": ({"tip_m": np.zeros((100, 2))}, r"tip_m is float64 \(100, 2\), not float64 \(100, 3\)"),
    "rows that are not finite": ({"tip_m": np.full((100, 3), np.nan)}, "tip_m has 100 rows that are not finite"),
    "rows that are not there": ({"drawn": np.array([3, 100])}, "row numbers, 0 to 99"),
    "no list of insertions": ({"trajectory": np.array(3)}, "trajectory must hold 1 whole numbers"),
    "insertions that are not there": ({"trajectory": np.full(100, 77)}, "names more insertions than the"),
    "steps that are no numbers": ({"step": np.full(100, 0.5)}, "step must hold 100 whole numbers from 0"),
    "another seed": ({"seed": np.array([1, 2])}, "seed must be a whole number"),
    "an end point that is not finite": (
        {"end_point_m": np.full((10, 3), np.nan)},
        "end_point_m must be a finite table",
    ),
    "no provenance": ({"provenance": np.array("{")}, "provenance must be a JSON object"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_each_fault_of_a_file_is_one_clear_message(tmp_path: Path, fault: str) -> None:
    changes, message = FAULTS[fault]
    np.savez(tmp_path / "data.npz", **{**small().arrays(), **changes})
    with pytest.raises(DatasetError, match=message):
        load_dataset(tmp_path / "data.npz")


def test_arrays_that_are_missing_are_named(tmp_path: Path) -> None:
    arrays: dict[str, Any] = small().arrays()
    del arrays["tip_m"], arrays["drawn"]
    np.savez(tmp_path / "data.npz", **arrays)
    with pytest.raises(DatasetError, match="lacks the arrays tip_m, drawn"):
        load_dataset(tmp_path / "data.npz")


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04broken", b"\x80\x04]q\x00."])
def test_what_is_no_npz_is_refused_and_never_unpickled(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "data.npz").write_bytes(content)
    with pytest.raises(DatasetError, match="cannot be read as a data set") as caught:
        load_dataset(tmp_path / "data.npz")
    assert "pickle" not in str(caught.value)  # numpy advises to unpickle it
